"""Advice on a log's conventions, and the lines of log.toml that correct them."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.conventions.correction import Correction, stated
from twin.conventions.evidence import ConventionFinding, opened
from twin.conventions.search import check_conventions
from twin.platform import Platform
from twin.recording import Recording

Array = NDArray[np.float64]

FILE_ORDER = {"xyzw": (3, 0, 1, 2)}
"""Where w, x, y, z stand in the file."""


def corrected_lines(recording: Recording, corrections: Iterable[Correction]) -> list[str]:
    """Of every stream with corrections: its table's head, and the keys to add or to change.

    For a recording of our own they belong into the log.toml that `twin export` writes.
    """
    by_stream: dict[str, list[Correction]] = {}
    for correction in (c for c in corrections if c.kind != "no_fit"):
        by_stream.setdefault(correction.stream, []).append(correction)
    lines: list[str] = []
    for stream, wrong in by_stream.items():
        keys = _keys(stated(recording, stream), recording[stream].columns, wrong)
        lines += [f"[streams.{stream}]", *(f"{key} = {text}" for key, text in keys.items())]
    return lines


def _keys(
    facts: Mapping[str, object], names: Sequence[str], wrong: Sequence[Correction]
) -> dict[str, str]:
    keys: dict[str, str] = {}
    columns = facts.get("columns")
    listed = [str(name) for name in columns] if isinstance(columns, list) else list(names)
    lag, layout = _number(facts, "clock_lag"), str(facts.get("format"))
    for correction in wrong:
        keys |= {key: _value(key, text) for key, text in correction.keys}
        if correction.kind == "time_unit" and _number(facts, "rate"):
            rate = _number(facts, "rate") / correction.time_factor
            keys = {key: text for key, text in keys.items() if not key.startswith("time")}
            keys["rate"] = f"{rate:.9g}"
        if correction.kind == "order" and set(map(str.lower, listed)) == set("wxyz"):
            keys["columns"] = json.dumps(listed)  # their names are wrong, too
        if correction.kind == "order":
            layout = dict(correction.keys)["format"]
        if correction.kind == "angles":
            listed = _turned(listed, np.array(correction.axes), (0, 1, 2))
            keys["columns"] = json.dumps(listed)
        if correction.kind in ("axes", "frame"):
            listed = _turned(listed, *_of_columns(np.array(correction.axes), layout))
            keys["columns"] = json.dumps(listed)
        if correction.lag:
            lag += correction.lag
            keys["clock_lag"] = f"{lag:.3f}"
    return keys


def _of_columns(axes: Array, layout: str) -> tuple[Array, Sequence[int]]:
    """What axes of a stream do to the columns of its file, and where these stand.

    Of an attitude, `axes` (4, 4) turn the vector part of its quaternion. Angles about axes that
    keep their place change signs with them; the entries of a matrix go by pairs of axes.
    """
    turn = axes[1:, 1:]
    if layout.startswith("euler"):
        about = ["xyz".index(letter) for letter in layout.removeprefix("euler_")]
        axes = np.diag(np.diag(turn)[about])
    elif layout == "rotation_vector":
        axes = turn
    elif layout == "matrix":
        axes = np.asarray(np.kron(turn, turn), dtype=np.float64)
        if np.linalg.det(turn) < 0.0:  # a mirror is a turn and the inverse
            axes = axes[np.arange(9).reshape(3, 3).T.ravel()]
    return axes, FILE_ORDER.get(layout, tuple(range(len(axes))))


def _turned(listed: list[str], axes: Array, order: Sequence[int]) -> list[str]:
    """The columns of the file that give axes @ what they gave before."""
    turned = list(listed)
    for row, place in zip(axes, order, strict=True):
        source = int(np.argmax(np.abs(row)))
        name = listed[order[source]]
        turned[place] = name if row[source] > 0.0 else _minus(name)
    return turned


def _value(key: str, text: str) -> str:
    return text if key == "time_scale" else json.dumps(text)


def _minus(name: str) -> str:
    return name[1:] if name.startswith("-") else f"-{name}"


def _number(facts: Mapping[str, object], key: str) -> float:
    value = facts.get(key)
    return float(value) if isinstance(value, int | float) else 0.0


@dataclass(frozen=True)
class ConventionAdvice:
    """Nothing in it: the log looks read rightly."""

    findings: tuple[ConventionFinding, ...]
    sentences: tuple[str, ...]
    """One for each thing that is wrong; one for all that several readings explain equally well."""
    log_toml: str
    """Lines to add to log.toml, or to change there; empty where none is sure."""
    exported: bool
    """Whether the log has a log.toml only after `twin export`."""

    @property
    def text(self) -> str:
        """Sentences and lines, as they are printed; empty without findings."""
        lines = list(self.sentences)
        if self.log_toml:
            where = "log.toml"
            if self.exported:
                where = "the log.toml that `twin export` writes of it"
            lines += [f"To read it so, write in {where}:"]
            lines += [f"  {line}" for line in self.log_toml.splitlines()]
        return "\n".join(lines)

    @property
    def warning(self) -> str:
        """One sentence for those who asked for something else; empty without findings."""
        if not self.sentences:
            return ""
        said = " ".join(self.sentences)
        return f"The log looks misread, so what follows may be wrong: {said} `twin show` says more."


def convention_advice(recording: Recording, platform: Platform | None) -> ConventionAdvice:
    """Look at a log's conventions, and say what to do; without a platform the wheels are not
    checked."""
    findings = check_conventions(recording, platform)
    sure = [finding for finding in findings if not finding.ambiguous]
    open_ones = [finding for finding in findings if finding.ambiguous]
    sentences = [finding.sentence for finding in sure]
    for others in dict.fromkeys(finding.alternatives for finding in open_ones):
        together = [f.correction.words for f in open_ones if f.alternatives == others]
        words = "; or ".join([", and ".join(together), *others])
        sentences.append(f"{opened(words)}: the log does not tell which.")
    lines = corrected_lines(recording, (c for finding in sure for c in finding.corrections))
    exported = recording.provenance.get("kind") != "log"
    return ConventionAdvice(tuple(findings), tuple(sentences), "\n".join(lines), exported)
