"""What `twin` itself promises: help at once, clear sentences, exit codes that scripts can trust."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.processes import PATIENCE
from twin import errors
from twin.cli import main as cli
from twin.cli.output import print_json
from twin.library import library
from twin.stop import Stopped

HEAVY = ("matplotlib", "mujoco", "numpy", "pyarrow", "rerun", "scipy", "tyro")


def twin(*words: str, **options: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "twin", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, **options)


def modules_after(*words: str) -> set[str]:
    code = (
        "import sys; from twin.cli.main import main\n"
        f"code = main({list(words)!r})\n"
        "print(code, *sys.modules, file=sys.stderr)"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE)
    code_and_modules = done.stderr.split()
    assert code_and_modules[0] == "0"
    return set(code_and_modules[1:])


@pytest.fixture
def verb(monkeypatch: pytest.MonkeyPatch) -> Callable[[BaseException | int], None]:
    """Replace what any verb does by an exit code or an exception."""

    def replace(outcome: BaseException | int) -> None:
        def run(name: str, words: list[str]) -> int:
            if isinstance(outcome, int):
                return outcome
            raise outcome

        monkeypatch.setattr(cli, "_run", run)

    return replace


def test_help_names_every_verb():
    done = twin("--help")
    assert done.returncode == 0
    assert all(f"  {name} " in done.stdout for name in cli.VERBS)


@pytest.mark.parametrize("checked", ["sads", "quaternion_pd"])
def test_a_verb_that_draws_nothing_keeps_mujoco_from_loading_opengl(
    checked: str, monkeypatch: pytest.MonkeyPatch
):
    """GLFW, which MuJoCo loads where there is a screen, starts a process that Ctrl-C reaches."""
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    loaded = modules_after("check", checked)
    assert "mujoco" in loaded
    assert not loaded & {"glfw", "mujoco.glfw", "OpenGL"}


def test_help_of_twin_imports_nothing_heavy():
    assert modules_after("--help").isdisjoint(HEAVY)


@pytest.mark.parametrize("name", cli.VERBS)
def test_help_of_a_verb_imports_only_the_command_line_library(name: str):
    assert modules_after(name, "--help").isdisjoint(set(HEAVY) - {"tyro"})


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("doctor", "[PLATFORM]"),
        ("reproduce", "[PAPER]"),
        ("campaign", "SPEC.toml [DIR]"),
        ("hardware", "[STAGE] [MM]"),
        ("identify", "LOG [LOG ...]"),
        ("compare", "LOG [LOG ...]"),
        ("diagnose", "LOG [LOG ...]"),
        ("check", "PLATFORM|LAW"),
    ],
)
def test_usage_shows_in_brackets_what_may_be_left_out(
    name: str, arguments: str, capsys: pytest.CaptureFixture[str]
):
    assert cli.main([name, "--help"]) == 0
    usage = capsys.readouterr().out.partition("\n\n")[0]
    assert f" {arguments}" in " ".join(usage.split()).replace("[-h]", "")


@pytest.mark.parametrize("name", cli.VERBS)
def test_every_verb_has_json_but_those_that_tell_nothing(
    name: str, capsys: pytest.CaptureFixture[str]
):
    assert cli.main([name, "--help"]) == 0
    assert ("--json" in capsys.readouterr().out) == (name not in ("new", "emulate", "view"))


def test_version_is_the_distributions():
    from importlib.metadata import version

    assert twin("--version").stdout == f"twin {version('airbearing-twin')}\n"


def test_no_verb_is_wrong_use_and_shows_the_help():
    done = twin()
    assert done.returncode == 2
    assert "usage: twin VERB" in done.stderr
    assert done.stdout == ""


def test_unknown_verb_is_wrong_use_and_asks_which_one_was_meant():
    done = twin("platform")
    assert done.returncode == 2
    assert "no verb named 'platform' (did you mean 'platforms'" in done.stderr
    assert "Traceback" not in done.stderr


def test_unknown_argument_is_wrong_use_and_asks_which_one_was_meant():
    done = twin("platforms", "--jsno")
    assert done.returncode == 2
    assert "--json" in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("outcome", "code", "sentence"),
    [
        (errors.TwinError("the air is off"), 1, "twin: the air is off\n"),
        (errors.UsageError("--a and --b exclude each other"), 2, "twin: --a and --b exclude"),
        (errors.UnknownName("platform", "sasd", ["sads"]), 2, "did you mean 'sads'?"),
        (errors.RecordingError("a.rrd", "is empty", "record again"), 1, "a.rrd: is empty"),
        (Stopped(signal.SIGINT), 130, "twin: stopped by Ctrl-C; nothing was written; the same"),
        (Stopped(signal.SIGTERM), 143, "twin: stopped by SIGTERM; nothing was written; the same"),
        (3, 3, ""),
    ],
)
def test_an_error_is_one_sentence_and_an_exit_code(
    verb: Callable[[BaseException | int], None],
    capsys: pytest.CaptureFixture[str],
    outcome: BaseException | int,
    code: int,
    sentence: str,
):
    verb(outcome)
    assert cli.main(["run"]) == code
    printed = capsys.readouterr()
    assert sentence in printed.err
    assert printed.err.count("\n") == (1 if sentence else 0)
    assert printed.out == ""


def test_a_bug_of_ours_is_not_dressed_up_as_the_users_mistake(
    verb: Callable[[BaseException | int], None],
):
    verb(ZeroDivisionError())
    with pytest.raises(ZeroDivisionError):
        cli.main(["run"])


def test_a_reader_that_leaves_early_is_no_error():
    command = f"{sys.executable} -m twin --help | true; exit ${{PIPESTATUS[0]}}"
    command = ["bash", "-c", command]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert done.stderr == ""
    assert done.returncode in (0, cli.BROKEN_PIPE), "141 if `true` was gone before the help came"


def test_a_closed_pipe_stays_quiet():
    read_end, write_end = os.pipe()
    os.close(read_end)
    with os.fdopen(write_end, "wb") as closed:
        done = subprocess.run(
            [sys.executable, "-m", "twin", "--help"],
            stdout=closed,
            stderr=subprocess.PIPE,
            timeout=PATIENCE,
        )
    assert done.returncode == cli.BROKEN_PIPE
    assert done.stderr == b""


def test_platforms_as_json_is_one_document_with_names():
    done = twin("platforms", "--json", check=True)
    names = [platform["name"] for platform in json.loads(done.stdout)]
    assert names == sorted(names)
    assert "sads" in names


def test_controllers_as_json_is_one_document_with_names_and_gains():
    laws = json.loads(twin("controllers", "--json", check=True).stdout)
    assert "quaternion_pd" in [law["name"] for law in laws]
    assert all(law["summary"] for law in laws)
    gains = next(law["gains"] for law in laws if law["name"] == "quaternion_pd")
    assert {"name", "value", "unit"} == set(gains[0])
    usual = {law["name"]: law["reference"] for law in laws}
    assert usual["quaternion_pd"] == "multisine"
    assert usual["mass_pid"] == "hold"


@pytest.mark.parametrize("name", ["platforms", "controllers"])
def test_a_list_as_text_names_what_the_json_names(name: str):
    documents = json.loads(twin(name, "--json", check=True).stdout)
    text = twin(name, check=True).stdout
    assert all(f"{document['name']}: " in text for document in documents)


def test_json_has_null_for_what_is_not_known(capsys: pytest.CaptureFixture[str]):
    import numpy as np

    print_json({"a": np.array([1.0, np.nan]), "b": (np.float64(np.inf), np.int64(3), None)})
    assert json.loads(capsys.readouterr().out) == {"a": [1.0, None], "b": [None, 3, None]}


def test_nothing_that_moves_the_cursor_reaches_the_terminal_from_a_file(tmp_path, capsys):
    """Notes that clear the screen, set the window's name and write into the clipboard."""
    log = tmp_path / "log"
    shutil.copytree(library("models") / "vnucec_cubesat" / "logs" / "first_step", log)
    escapes = r"\u001b[2J\u001b]0;owned\u0007\u001b]52;c;cm0=\u0007\u009b31m"
    file = log / "log.toml"
    file.write_text(file.read_text().replace('experiment = "', f'experiment = "{escapes}'))
    assert cli.main(["show", str(log)]) == 0
    told = capsys.readouterr()
    assert "\\x1b[2J" in told.out
    assert cli.main(["show", "\x1b[2J.rrd"]) != 0
    both = told.out + told.err + "".join(capsys.readouterr())
    assert not any(ord(c) < 32 and c not in "\n\t" or 127 <= ord(c) < 160 for c in both)


def test_positional_words_may_follow_options_that_take_one_value():
    hints: dict[str, object] = {"platform": str | None, "json": bool, "attitude": tuple[float, ...]}
    words = ["a.csv", "--platform", "sads", "--json", "out", "--attitude", "1", "2", "3"]
    moved = ["a.csv", "out", "--platform", "sads", "--json", "--attitude", "1", "2", "3"]
    assert cli.positional_first(words, hints) == moved
    # what follows an option of many values, or one that is not known, is theirs
    for option in ("--attitude", "--other"):
        assert cli.positional_first([option, "1", "b"], hints) == [option, "1", "b"]


def test_the_folder_of_an_imported_log_may_stand_last(tmp_path: Path):
    rows = "\n".join(f"{0.01 * i:.2f},{np.sin(0.1 * i):.6f}" for i in range(200))
    (tmp_path / "swing.csv").write_text(f"t,angle\n{rows}\n")
    words = [str(tmp_path / "swing.csv"), "--platform", "dfki_pendulum", str(tmp_path / "log")]
    assert cli.main(["import", *words]) == 0
    assert (tmp_path / "log" / "log.toml").is_file()
