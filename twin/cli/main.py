"""`twin VERB ...`: finds the verb, reads its command line, turns errors into sentences.

The help of `twin` itself comes from the table below, so that it needs neither the verbs nor the
command-line library. Exit codes: 0 done, 1 failed, 2 wrong use; 130, 143 or 129 where SIGINT,
SIGTERM or SIGHUP ended it. A verb whose usual end is Ctrl-C (`run`, `emulate`) is done by it.
"""

import importlib
import math
import os
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Any, Protocol, Union, get_args, get_origin, get_type_hints

from twin import stop
from twin.errors import TwinError, UnknownName, UsageError

VERBS: dict[str, tuple[str, str, str]] = {
    "run": ("twin.cli.flights", "RunVerb", "fly a platform under a control law and record it"),
    "balance": ("twin.cli.flights", "BalanceVerb", "bring the CM into the CR, to a stated torque"),
    "emulate": ("twin.cli.hardware", "Emulate", "emulate a platform's devices on pseudo-terminals"),
    "hardware": (
        "twin.cli.hardware",
        "Hardware",
        "show status of a machine on its bench, home and jog it",
    ),
    "doctor": ("twin.cli.hardware", "Doctor", "check that this computer is fit to fly a machine"),
    "import": ("twin.cli.logs", "Import", "make a log from recorded files of any program"),
    "show": ("twin.cli.logs", "Show", "print what is in a log: rates, gaps, ranges, noise"),
    "identify": ("twin.cli.fits", "Identify", "identify inertia and mass moment from logs"),
    "compare": ("twin.cli.fits", "Compare", "compare a model's prediction with a log"),
    "diagnose": ("twin.cli.fits", "Diagnose", "name the causes of model error, and their sizes"),
    "isolate": (
        "twin.cli.experiments",
        "Isolate",
        "predict which causes a run detects and distinguishes",
    ),
    "excite": (
        "twin.cli.experiments",
        "Excite",
        "design the motion that best identifies J or a cause",
    ),
    "verify": (
        "twin.cli.experiments",
        "Verify",
        "compare a free float with the earlier ones",
    ),
    "trim": ("twin.cli.experiments", "TrimVerb", "compute which trim weight goes where"),
    "history": (
        "twin.cli.experiments",
        "History",
        "plot the trend of a machine over its recordings",
    ),
    "calibrate": (
        "twin.cli.experiments",
        "Calibrate",
        "estimate bias, scale and noise of a sensor from logs",
    ),
    "tune": ("twin.cli.experiments", "Tune", "tune the gains of a law over dispersed runs"),
    "campaign": ("twin.cli.campaigns", "Campaign", "fly thousands of dispersed runs"),
    "replay": (
        "twin.cli.campaigns",
        "ReplayVerb",
        "fly one run of a campaign again, to the same bits",
    ),
    "report": (
        "twin.cli.campaigns",
        "Report",
        "evaluate a campaign, with intervals and figures",
    ),
    "reproduce": ("twin.cli.reproduce", "Reproduce", "reproduce the papers' tables and figures"),
    "check": ("twin.cli.check", "Check", "check a platform's or a control law's files"),
    "export": ("twin.cli.logs", "Export", "write a log as a folder of CSV, Parquet or MAT files"),
    "view": ("twin.cli.logs", "View", "open a recording in the Rerun viewer"),
    "platforms": ("twin.cli.library", "Platforms", "list the shipped machines"),
    "new": ("twin.cli.library", "New", "write a folder for a new machine, ready to fly"),
    "effects": (
        "twin.cli.library",
        "Effects",
        "list the effects: possible departures from a model",
    ),
    "controllers": ("twin.cli.library", "Controllers", "list the shipped control laws"),
}
"""Module, class and summary of each verb."""

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""What the linear algebra under NumPy reads on first import. Ours are many small factorisations, in
which its threads only wait for each other."""

FAILED = 1
WRONG_USE = 2
BROKEN_PIPE = 141
"""As the shell counts a program that SIGPIPE ended."""


class Verb(Protocol):
    """A dataclass whose fields are the verb's arguments.

    One that keeps something when it is stopped has a method `kept`, which says what, and how to go
    on, in a sentence.
    """

    def run(self) -> int:
        """Do it; the exit code."""
        ...


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (default: the process's own); the exit code."""
    if argv is None:
        stop.listen()
        code = _main(sys.argv[1:])
        stop.over(code)
        return code
    with stop.listening():
        return _main(list(argv))


def _main(words: list[str]) -> int:
    for variable in BLAS_THREADS:
        os.environ.setdefault(variable, "1")
    # MuJoCo reads it on import. With a screen it would load GLFW, which probes its library in a
    # process of its own, and that answers Ctrl-C with a traceback.
    os.environ.setdefault("MUJOCO_GL", "disable")
    stop.keeps(_nothing_kept)
    try:
        code, sentence = _dispatch(words), ""
        if code == WRONG_USE:
            sentence = "the arguments do not parse; stderr says which"
        sys.stdout.flush()
    except (UsageError, UnknownName) as error:
        code, sentence = WRONG_USE, str(error)
        _complain(sentence)
    except TwinError as error:
        code, sentence = FAILED, str(error)
        _complain(sentence)
    except stop.Stopped as request:
        code, sentence = request.status, f"{request}; {stop.kept()}"
        _complain(sentence)
    except BrokenPipeError:
        return _broken_pipe()
    if sentence and "--json" in words:
        from twin.cli.output import print_json_of_error

        try:
            print_json_of_error(sentence, code)
            sys.stdout.flush()
        except BrokenPipeError:
            return _broken_pipe()
    return code


def _complain(sentence: str) -> None:
    from twin.cli.output import printable

    print(f"twin: {printable(sentence)}", file=sys.stderr)


def _broken_pipe() -> int:
    # The interpreter flushes once more at exit; let it do so into nothing.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return BROKEN_PIPE


def _dispatch(words: list[str]) -> int:
    if not words:
        print(_help(), file=sys.stderr)
        return WRONG_USE
    name, *rest = words
    if name in ("-h", "--help"):
        print(_help())
        return 0
    if name == "--version":
        from twin import __version__

        print(f"twin {__version__}")
        return 0
    if name not in VERBS:
        raise UnknownName("verb", name, VERBS)
    return _run(name, rest)


def _run(name: str, words: list[str]) -> int:
    import tyro

    from twin.cli.output import begin_output, plain_streams

    begin_output()
    module, class_name, _ = VERBS[name]
    arguments: type[Verb] = getattr(importlib.import_module(module), class_name)
    words = positional_first(words, get_type_hints(arguments))
    try:
        verb = tyro.cli(
            arguments,
            args=words,
            prog=f"twin {name}",
            config=(tyro.conf.FlagCreatePairsOff,),
        )
    except SystemExit as ended:  # help was printed, or the arguments do not parse
        return ended.code if isinstance(ended.code, int) else WRONG_USE
    check_numbers(verb)
    stop.keeps(getattr(verb, "kept", _nothing_kept))
    stop.check()
    with plain_streams():
        return verb.run()


def positional_first(words: Sequence[str], hints: Mapping[str, Any]) -> list[str]:
    """The same command line with its positional words in front: `FILE --platform P OUT` too.

    Only words behind options whose values are counted are moved: flags, which have none, and
    texts, numbers and paths, which have one. From any other option on, all stays as it is.

    Args:
        words: behind the verb.
        hints: types of the verb's arguments, by name.
    """
    first, options = list[str](), list[str]()
    queue = deque(words)
    while queue:
        word = queue.popleft()
        if not word.startswith("-") or word == "-":
            first.append(word)
            continue
        name, stated, _ = word.partition("=")
        hint = hints.get(name.lstrip("-").replace("-", "_"))
        either = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
        kinds = [kind for kind in either if kind is not type(None)]
        if stated or kinds == [bool]:
            options.append(word)
        elif len(kinds) == 1 and kinds[0] in (str, int, float, Path) and queue:
            options += [word, queue.popleft()]
        else:
            options += [word, *queue]
            break
    return [*first, *options]


def _nothing_kept() -> str:
    return "nothing was written; the same command begins anew"


def _help() -> str:
    width = max(map(len, VERBS))
    verbs = "\n".join(f"  {name:<{width}}  {summary}" for name, (_, _, summary) in VERBS.items())
    return (
        "usage: twin VERB [ARGUMENTS]\n\n"
        "The digital twin of an air-bearing spacecraft simulator.\n\n"
        f"verbs:\n{verbs}\n\n"
        "`twin VERB --help` prints the arguments of a verb, `twin --version` the version."
    )


def check_numbers(verb: object) -> None:
    """Refuse numbers that are not finite, or a seed below 0, before the verb meets them.

    Raises:
        UsageError: which argument, and what it is.
    """
    for name, value in vars(verb).items():
        numbers = _numbers(value)
        if not all(map(math.isfinite, numbers)):
            given = " ".join(f"{number:g}" for number in numbers)
            wanted = "finite numbers" if len(numbers) > 1 else "a finite number"
            raise UsageError(f"{_written(verb, name)} is {given}; give {wanted}")
        if name == "seed" and value < 0:
            raise UsageError(f"--seed is {value}; give 0 or more")


def _numbers(value: Any) -> tuple[float, ...]:
    """Those of an argument: itself, or its entries."""
    entries = value if isinstance(value, tuple) else (value,)
    return tuple(entry for entry in entries if isinstance(entry, int | float))


def _written(verb: object, name: str) -> str:
    """How the command line calls a field."""
    import tyro

    marks: tuple[Any, ...] = getattr(type(verb).__annotations__[name], "__metadata__", ())
    if tyro.conf.Positional in marks:
        return next(mark.metavar for mark in marks if hasattr(mark, "metavar")).strip("[]")
    return "--" + name.replace("_", "-")
