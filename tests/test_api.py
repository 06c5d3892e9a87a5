"""The Python interface says what the command line says, and its results show themselves."""

import ast
import dataclasses
import importlib
import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import twin
from twin.cli.main import VERBS, main
from twin.flight import Run
from twin.library import library

SWING = library("models") / "dfki_pendulum" / "logs" / "energy_shaping"


def test_importing_twin_imports_nothing_else():
    code = "import sys, twin; print('numpy' in sys.modules, 'mujoco' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


@pytest.mark.parametrize("name", twin.__all__)
def test_every_name_of_the_interface_is_there_and_described(name: str):
    assert name in dir(twin)
    assert getattr(twin, name).__doc__


def test_the_page_about_python_has_each_function_and_no_other():
    page = (Path(__file__).parents[1] / "docs" / "python.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `twin\.(\w+)\(", page, re.MULTILINE)
    functions = [name for name in twin.__all__ if not isinstance(getattr(twin, name), type)]
    assert sorted(listed) == sorted(functions)


def test_a_name_that_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'balanse'"):
        twin.balanse  # noqa: B018


@pytest.fixture(scope="module")
def run() -> Run:
    return twin.fly("sads", "quaternion_pd", duration=4.0, seed=5)


def test_a_flight_says_what_twin_run_says(run, capsys):
    words = ["--controller", "quaternion_pd", "--duration", "4", "--seed", "5"]
    assert main(["run", "sads", *words]) == 0
    assert capsys.readouterr().out.strip() == str(run)
    assert main(["run", "sads", *words, "--json"]) == 0
    printed, own = (
        json.loads(capsys.readouterr().out),
        json.loads(twin.shown.as_json(run.document())),
    )
    for changing in ("seconds", "recording", "records"):
        printed.pop(changing, None)
        own.pop(changing, None)
    assert printed == own


def test_a_flight_is_the_same_bits_as_in_the_file_that_it_records(tmp_path: Path):
    path = tmp_path / "new" / "run.rrd"
    flown = twin.fly("sads", "quaternion_pd", duration=2.0, seed=7, rrd=path)
    again = twin.read(path)
    assert set(again) == set(flown.recording)
    for name, series in flown.recording.items():
        np.testing.assert_array_equal(again[name].value, series.value)
        np.testing.assert_array_equal(again[name].time, series.time)
    saved = twin.read(flown.save(tmp_path / "saved.rrd"))
    np.testing.assert_array_equal(saved["gyro"].value, again["gyro"].value)
    tables = twin.read(flown.save(tmp_path / "tables"))
    np.testing.assert_allclose(tables["gyro"].value, again["gyro"].value)


def test_a_law_a_machine_and_a_motion_may_be_objects():
    from twin.controller import load_controller
    from twin.reference import Hold

    machine = twin.load("sads", "gyro_bias=1e-3/0/0")
    law = load_controller("quaternion_pd", {"proportional": 6.0})
    by_object = twin.fly(machine, law, reference=Hold(yaw=0.1), duration=1.0)
    by_name = twin.fly(
        "sads",
        "quaternion_pd",
        gains={"proportional": 6.0},
        effects="gyro_bias=1e-3/0/0",
        reference=f"hold:0,0,{np.degrees(0.1)}",
        duration=1.0,
    )
    np.testing.assert_allclose(
        by_object.recording["gyro"].value, by_name.recording["gyro"].value, atol=1e-12
    )
    with pytest.raises(twin.TwinError, match="set the fields of this one"):
        twin.fly(machine, law, gains={"proportional": 6.0}, duration=1.0)


def test_a_log_says_what_twin_show_says(capsys):
    main(["show", str(SWING)])
    printed = capsys.readouterr().out
    assert str(twin.show(SWING)) in printed
    assert str(twin.read(SWING)) in printed


def test_an_identification_and_a_comparison_say_what_their_verbs_say(capsys):
    part = {"start": 0.0, "stop": 4.0}
    log = twin.read(SWING, **part)
    assert main(["identify", str(SWING), "--start", "0", "--stop", "4"]) == 0
    assert capsys.readouterr().out.strip() == str(twin.identify(log))
    assert main(["compare", str(SWING), "--start", "0", "--stop", "4", "--as-built"]) == 0
    said = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert set(str(twin.compare(log, as_built=True)).splitlines()) <= set(said)


def test_a_result_is_saved_in_the_format_of_its_ending(run, tmp_path: Path):
    found = twin.identify(run.recording)
    for ending, begins in (
        (".html", b"<!doctype html>"),
        (".json", b"{"),
        (".txt", str(found).encode()[:20]),
        (".png", b"\x89PNG"),
        (".svg", b"<?xml"),
        (".pdf", b"%PDF"),
    ):
        path = found.save(tmp_path / "deep" / f"found{ending}")
        assert path.read_bytes().startswith(begins), ending
    with pytest.raises(twin.TwinError, match=r"saved as one of \.html"):
        found.save(tmp_path / "found.docx")
    frame = found._repr_html_()
    assert frame.startswith("<iframe srcdoc=")


def test_mistakes_are_twin_errors_with_the_sentence_of_the_command_line():
    with pytest.raises(twin.TwinError, match="did you mean 'sads'"):
        twin.load("sad")
    with pytest.raises(twin.TwinError, match="there is no such log"):
        twin.read("nowhere.rrd")
    with pytest.raises(twin.TwinError, match="no log is given"):
        twin.diagnose([])
    with pytest.raises(twin.TwinError, match="give a torque above zero"):
        twin.balance("cubesat", target=-1.0)


CALLED = {
    "run": {"fly"},
    "balance": {"balance"},
    "import": {"imported", "show"},
    "show": {"show", "check_log"},
    "identify": {"identify", "identify_by_all"},
    "compare": {"compare", "transfer"},
    "diagnose": {"diagnose", "extend", "validate", "machine_of"},
    "campaign": {"fly_campaign", "forecast"},
    "replay": {"replay"},
    "report": {"results"},
    "new": {"new"},
}
"""Functions of the interface that each verb calls."""
BELOW = re.compile(
    r"twin\.(flight|loop|bench|clock|estimators|identification|comparison|strapdown|intake"
    r"|campaigns|procedures|conventions)\b"
)
"""What the interface puts together, so that verbs need not."""
MAY = {("twin.identification", "Settings"), ("twin.loop", "Ended"), ("twin.flight", "Run")}
"""What they take from there all the same: types of options and results."""


@pytest.mark.parametrize("verb", CALLED)
def test_a_verb_calls_the_interface_and_puts_nothing_together_itself(verb: str):
    module, class_name, _ = VERBS[verb]
    tree = ast.parse(inspect.getsource(importlib.import_module(module)))
    (body,) = (
        node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == class_name
    )
    taken = {
        (node.module, alias.name)
        for node in ast.walk(body)
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
    assert CALLED[verb] <= {name for source, name in taken if source == "twin.api"}
    itself = {(s, n) for s, n in taken if BELOW.match(s)} - MAY
    # a campaign that was stopped counts the shards that it wrote
    assert itself <= {("twin.campaigns.folder", "METRICS")}


def test_a_run_that_is_not_kept_is_read_from_its_file_or_not_at_all(run, tmp_path: Path):
    words = {"duration": 4.0, "seed": 5, "keep": False}
    recorded = twin.fly("sads", "quaternion_pd", rrd=tmp_path / "run.rrd", **words)
    np.testing.assert_array_equal(recorded.recording["gyro"].value, run.recording["gyro"].value)
    assert str(recorded) == str(run)
    with pytest.raises(twin.TwinError, match="fly it with keep=True"):
        _ = twin.fly("sads", "quaternion_pd", **words).recording


def test_a_file_of_another_kind_is_written_over_by_no_function(tmp_path: Path):
    notes = tmp_path / "notes.md"
    notes.write_text("precious")
    for refused in (
        lambda: twin.fly("sads", duration=1.0, rrd=notes),
        lambda: twin.balance("cubesat", rrd=notes),
        lambda: twin.replay(tmp_path, 0, rrd=notes),
    ):
        with pytest.raises(twin.TwinError, match=r"say .*notes\.rrd"):
            refused()
    assert notes.read_text() == "precious"


def test_a_forecast_says_what_a_dry_run_says(tmp_path: Path, capsys):
    spec = tmp_path / "campaign.toml"
    spec.write_text(
        'platform = "sads"\ncontroller = "quaternion_pd"\nruns = 2\nseed = 1\nduration = 1.0\n'
    )
    assert main(["campaign", str(spec), "--dry-run", "--workers", "1"]) == 0
    printed = capsys.readouterr().out.splitlines()
    said = str(twin.forecast(spec)).splitlines()
    assert [line for line in printed if not line.startswith("about")] == [
        line for line in said if not line.startswith("about")
    ]
    assert json.loads(twin.shown.as_json(twin.forecast(spec).document()))["runs"] == 2


def test_a_comparison_is_saved_with_its_prediction(tmp_path: Path):
    log = twin.read(SWING, start=0.0, stop=4.0)
    saved = twin.read(twin.compare(log, as_built=True).save(tmp_path / "swing.rrd"))
    assert {"joint_angle", "predicted_joint_angle"} <= set(saved)


def test_a_log_that_identify_would_refuse_is_refused_by_a_check(run):
    twin.check_log(run.recording)
    empty = dataclasses.replace(
        run.recording, streams={**run.recording, "gyro": run.recording["gyro"].between(90.0, 91.0)}
    )
    with pytest.raises(twin.TwinError, match="gyro holds no rows"):
        twin.check_log(empty)
