"""Sentences, documents and pages of experiments: isolability, excitation, checks, calibration."""

from collections.abc import Mapping, Sequence
from html import escape
from itertools import groupby
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from twin.diagnosis.screen import TIED
from twin.experiments.calibration import Calibration
from twin.experiments.design import Design
from twin.experiments.isolation import Alternative, CauseIsolation, Isolation
from twin.experiments.routine import FEWEST, UNITS, Trend, Trim
from twin.experiments.tuning import Tuning
from twin.interval import Interval
from twin.reference import Tabulated
from twin.report.style import (
    FIGURE,
    PALETTE,
    SOFT,
    Drawing,
    PageTable,
    Part,
    foot,
    opened,
    page,
    rendered,
)
from twin.rotation import to_euler_zyx
from twin.units import fitting, listed, printed, three_digits

MOST_PAIRS = 4
"""Tied pairs that the text lists."""
ROUGH = 1.5
"""Misfit above which a free float shows more than what its fit has."""
DRAWN_POINTS = 2000
"""Of a long calibration."""
CELL = 0.19
"""Of the matrix [in]."""


def isolation_sentences(result: Isolation) -> list[str]:
    """What `twin isolate` prints."""
    run, shown = result.run, [c for c in result.causes if np.isfinite(c.detectable)]
    lines = [
        f"{run.platform.name}: {run.words}, {run.duration:g} s, with {listed(result.streams)}",
        "95 % half widths with no further cause: " + ", ".join(_base(result)),
        "",
        f"{'cause':<32}  {'detectable from':<24}  {'separable from':<24}  confused with",
    ]
    for cause in shown:
        separable = "at no size" if np.isinf(cause.separable) else _size(cause, cause.separable)
        ties = ", ".join(cause.ties) or "-"
        size = _size(cause, cause.detectable)
        lines.append(f"{cause.label:<32}  {size:<24}  {separable:<24}  {ties}")
    hidden = [cause.label for cause in result.causes if np.isinf(cause.detectable)]
    lines += ["", f"Detectable means an evidence of {result.evidence:g}, of each component alike."]
    if hidden:
        lines.append("Not detectable at any size: " + ", ".join(_grouped(hidden)) + ".")
    lines.append(_ties(result))
    better = [a for a in result.alternatives if a.kind != "without" and (a.separates or _finer(a))]
    if better:
        lines += ["", "What would help:"]
        lines += [f"  {sentence}" for sentence in map(_alternative, better)]
    needed = [a for a in result.alternatives if a.kind == "without"]
    if needed:
        lines += ["", "What each sensor is worth:"]
        lines += [f"  {_without(item)}" for item in needed]
    return lines


def _finer(item: Alternative) -> bool:
    return item.ratio < 0.9


def _base(result: Isolation) -> list[str]:
    return [f"{name} {printed(half, unit)}" for name, (half, unit) in result.base.items()]


def _size(cause: CauseIsolation, multiple: float) -> str:
    """Of the first amplitude of each unit."""
    kinds = dict.fromkeys(cause.units)
    first = [cause.units.index(unit) for unit in kinds]
    return ", ".join(printed(multiple * float(cause.usual[i]), cause.units[i]) for i in first)


def _grouped(labels: Sequence[str]) -> list[str]:
    """`nozzle_gain (16 targets)` for many targets of one effect."""
    result: list[str] = []
    for name, group in groupby(labels, key=lambda label: label.partition(":")[0]):
        several = list(group)
        result.append(f"{name} ({len(several)} targets)" if len(several) > 3 else listed(several))
    return result


def _ties(result: Isolation) -> str:
    pairs = result.ties
    if not pairs:
        return "No two detectable causes are confused."
    some = "; ".join(" with ".join(pair) for pair in pairs[:MOST_PAIRS])
    more = f"; and {len(pairs) - MOST_PAIRS} more" if len(pairs) > MOST_PAIRS else ""
    noun = "pair" if len(pairs) == 1 else "pairs"
    return f"{len(pairs)} {noun} confused at the detectable size: {some}{more}."


def _alternative(item: Alternative) -> str:
    said = f"{item.words}: detectable sizes x {three_digits(item.ratio)} in the median"
    if item.separates:
        some = "; ".join(" from ".join(pair) for pair in item.separates[:3])
        more = f" and {len(item.separates) - 3} more pairs" if len(item.separates) > 3 else ""
        said += f", separates {some}{more}"
    if item.lost:
        said += f", but does not detect {', '.join(_grouped(item.lost))}"
    return said


def _without(item: Alternative) -> str:
    lost = f", {', '.join(_grouped(item.lost))} undetectable" if item.lost else ""
    return f"{item.words}: detectable sizes x {three_digits(item.ratio)}, {item.ties} ties{lost}"


def isolation_document(result: Isolation) -> Mapping[str, Any]:
    """For `--json`; SI."""
    labels = [cause.label for cause in result.causes]
    return {
        "platform": result.run.platform.name,
        "command": result.run.command,
        "duration": result.run.duration,
        "streams": result.streams,
        "evidence": result.evidence,
        "base_half_widths": {name: half for name, (half, _) in result.base.items()},
        "causes": [
            {
                "cause": cause.label,
                "parameters": cause.parameters,
                "units": cause.units,
                "detectable": cause.size,
                "detectable_alone": cause.each,
                "usual": cause.usual,
                "separable": cause.separable * cause.usual,
                "confused_with": cause.ties,
            }
            for cause in result.causes
        ],
        "behind": {"causes": labels, "evidence": result.behind},
        "not_asked": dict(result.not_asked),
        "alternatives": [
            {
                "words": item.words,
                "kind": item.kind,
                "detected": item.detected,
                "ties": item.ties,
                "ratio": item.ratio,
                "separates": item.separates,
                "undetected": item.lost,
            }
            for item in result.alternatives
        ],
    }


def isolation_figure(result: Isolation) -> Figure:
    """The matrix of evidence by which one cause in place of another is behind."""
    shown = [i for i, cause in enumerate(result.causes) if np.isfinite(cause.detectable)]
    labels = [result.causes[i].label for i in shown]
    behind = result.behind[np.ix_(shown, shown)]
    with mpl.rc_context(FIGURE):
        edge = max(CELL * len(shown) + 3.4, 5.5)
        figure = Figure(figsize=(edge + 0.8, edge))
        panel = figure.subplots()
        panel.grid(visible=False)
        drawn = panel.imshow(
            np.ma.masked_invalid(behind), cmap="viridis", vmin=0.0, vmax=result.evidence
        )
        places = np.arange(len(shown))
        panel.set_xticks(places, labels, rotation=90, fontsize=7)
        panel.set_yticks(places, labels, fontsize=7)
        panel.set_xlabel("explained by")
        panel.set_ylabel("true cause, at its detectable size")
        bar = figure.colorbar(drawn, ax=panel, shrink=0.6)
        bar.set_label("evidence by which it is behind")
        return figure


def isolation_parts(result: Isolation) -> list[Part]:
    """What the page is made of."""
    run = result.run
    shown = [cause for cause in result.causes if np.isfinite(cause.detectable)]
    rows = [
        [
            cause.label,
            _size(cause, cause.detectable),
            _size(cause, 1.0),
            "at no size" if np.isinf(cause.separable) else _size(cause, cause.separable),
            ", ".join(cause.ties),
        ]
        for cause in shown
    ]
    others = [
        [
            item.words,
            str(item.detected),
            str(item.ties),
            three_digits(item.ratio),
            "; ".join(" from ".join(pair) for pair in item.separates),
        ]
        for item in result.alternatives
    ]
    hidden = [cause.label for cause in result.causes if np.isinf(cause.detectable)]
    under = f"{run.platform.title} · {run.words} · {run.duration:g} s"
    answer = f"{len(shown)} of {len(result.causes)} causes are detectable. {_ties(result)}"
    rest = [f"95 % half widths with no further cause: {', '.join(_base(result))}."]
    if hidden:
        rest.append(f"Not detectable at any size: {', '.join(_grouped(hidden))}.")
    return [
        *opened(f"What this experiment detects on {run.platform.name}", under, answer, rest),
        "<h2>Which causes it confuses</h2>",
        Drawing(
            "isolation",
            isolation_figure(result),
            "Evidence by which a cause (column) in place of the true one (row) is behind. Dark: "
            "the experiment does not distinguish them.",
        ),
        "<h2>Detectable sizes</h2>",
        PageTable(
            "detectable",
            [
                "cause",
                f"detectable (evidence {result.evidence:g})",
                "usual",
                "separable from",
                "confused with",
            ],
            rows,
        ),
        "<h2>Other sensors and motions</h2>",
        PageTable(
            "alternatives",
            ["experiment", "causes detected", "ties", "sizes x", "separates"],
            others,
        ),
    ]


def isolation_page(result: Isolation) -> str:
    """The page as text."""
    title = f"What an experiment detects on {result.run.platform.name}"
    return page(title, rendered([*isolation_parts(result), foot([], [result.run.platform])]))


def design_sentences(result: Design) -> list[str]:
    """What `twin excite` prints."""
    run, wanted = result.run, listed(result.wanted)
    if result.behind:
        wanted = " against ".join(result.wanted)
    lines = [
        f"{run.platform.name}: {run.duration:g} s for {wanted}, of {result.evaluations} trials"
    ]
    if result.numbers:
        lines.append(f"{'':<32}  {'95 % half width':<18}  usual experiment")
        for number in result.numbers:
            half, usual = (
                printed(v, number.unit, number.half) for v in (number.half, number.usual)
            )
            lines.append(f"{number.name:<32}  {half:<18}  {usual}")
        lines.append(f"Intervals are {three_digits(result.narrower)} times narrower in the mean.")
    for label, (behind, usual) in result.behind.items():
        other = next(name for name in result.wanted if name != label)
        size = ", ".join(f"{value:.3g}" for value in result.sizes[label])
        lines.append(
            f"If {label} ({size}) is the truth, {other} is {three_digits(behind)} of evidence "
            f"behind; after the usual experiment {three_digits(usual)}."
        )
    if result.behind and min(new for new, _ in result.behind.values()) < TIED:
        lines.append(f"No trial separates them: a tie ends at {TIED:g} of evidence.")
    used = ", ".join(f"{name} {share:.0%}" for name, share in result.used.items())
    lines.append(f"Limits used: {used}." if used else "It has no limits to keep.")
    lines += _checked(result)
    if result.file is not None:
        lines.append(f"wrote {result.file}")
    if run.motion is not None and result.file is None:
        lines.append("Name a file, OUT.csv, and the motion is written for `twin run --reference`.")
    else:
        lines.append(f"Fly it: {run.command}")
    return lines


def _checked(result: Design) -> list[str]:
    if not result.flights:
        return ["The forecast was not compared with noisy flights (--flights)."]
    many = f"In {result.flights} simulated flights with noise"
    if result.observed:
        parts = [
            f"{three_digits(mean)} +- {three_digits(spread)} where {label} was the truth"
            for label, (mean, spread) in result.observed.items()
        ]
        return [f"{many} the evidence was {listed(parts)}."]
    return [
        f"{many} the errors were {result.scatter:.2f} of the forecast standard deviations (rms)."
    ]


def design_document(result: Design) -> Mapping[str, Any]:
    """For `--json`; SI."""
    return {
        "platform": result.run.platform.name,
        "for": result.wanted,
        "command": result.run.command,
        "file": result.file,
        "duration": result.run.duration,
        "evaluations": result.evaluations,
        "half_widths": {
            number.name: {"value": number.half, "usual": number.usual, "unit": number.unit}
            for number in result.numbers
        },
        "behind": {
            label: {"value": new, "usual": old} for label, (new, old) in result.behind.items()
        },
        "sizes": dict(result.sizes),
        "narrower": result.narrower,
        "limits_used": dict(result.used),
        "flights": result.flights,
        "scatter": result.scatter,
        "observed": {
            label: {"mean": mean, "standard_deviation": spread}
            for label, (mean, spread) in result.observed.items()
        },
    }


def design_figure(result: Design) -> Figure:
    """The reference over time; without one, the intervals."""
    motion = result.run.motion
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 4.8))
        if isinstance(motion, Tabulated):
            time = motion.table.time
            panels = figure.subplots(2, 1, sharex=True)
            angles = np.degrees(to_euler_zyx(motion.table.attitude))[:, ::-1]
            rates = np.degrees(motion.at(time).rate_body)
            for k, (name, axis) in enumerate(zip(("roll", "pitch", "yaw"), "xyz", strict=True)):
                panels[0].plot(time, angles[:, k], color=PALETTE[k], label=name)
                panels[1].plot(time, rates[:, k], color=PALETTE[k], label=axis)
            panels[0].set_ylabel("angle [deg]")
            panels[1].set_ylabel("rate [deg/s]")
            panels[1].set_xlabel("time [s]")
            for panel in panels:
                panel.legend(ncols=3, loc="upper right")
            return figure
        panel = figure.subplots()
        names = [number.name for number in result.numbers] or list(result.behind)
        ratios = [number.usual / number.half for number in result.numbers] or [
            new / max(old, 1e-9) for new, old in result.behind.values()
        ]
        panel.barh(names, ratios, color=PALETTE[0])
        panel.axvline(1.0, color=SOFT)
        panel.set_xlabel("times better than the usual experiment")
        return figure


def design_page(result: Design) -> str:
    """The page as text."""
    first, *rest = design_sentences(result)
    rows = [
        [n.name, printed(n.half, n.unit, n.half), printed(n.usual, n.unit, n.half)]
        for n in result.numbers
    ]
    title = f"An experiment for {result.run.platform.name}"
    said = [line.strip() for line in rest if not line.startswith(" ")]
    said = [line for line in said if not any(line.startswith(n.name) for n in result.numbers)]
    said = [line for line in said if not line.startswith("Fly it")]
    parts = [
        *opened(title, result.run.platform.title, f"{first}.", said),
        "<h2>The motion</h2>",
        Drawing("motion", design_figure(result), "The reference, from rest to rest."),
        PageTable("half_widths", ["number", "95 % half width", "usual experiment"], rows),
        "<h2>To fly it</h2>",
        f"<pre>{escape(result.run.command)}</pre>",
        foot([], [result.run.platform]),
    ]
    return page(title, rendered(parts))


def trend_sentences(result: Trend) -> list[str]:
    """What `twin verify` and `twin history` print."""
    last = result.floats[-1]
    what = "a simulation of it as stated" if result.simulated else last.source
    lines = [
        f"{result.platform.name}: {what}, {last.duration:.0f} s"
        + ("" if result.simulated else f", of {last.when:%Y-%m-%d %H:%M}"),
        f"{'':<26}  {'95 % interval':<34}  {'stated':<12}  control limits",
    ]
    for name, interval in last.numbers.items():
        unit = UNITS[name]
        half = 0.5 * (interval.high - interval.low)
        size = max(abs(interval.value), half)
        value = f"{printed(interval.value, unit, size)} +- {printed(half, unit, size)}"
        stated = printed(last.stated[name], unit, size) if name in last.stated else "0"
        limit = result.limits.get(name)
        band = "-"
        if limit is not None:
            band = " to ".join(printed(x, unit, size) for x in (limit.low, limit.high))
            band += "" if limit.inside else "  OUT OF CONTROL"
        lines.append(f"{name:<26}  {value:<34}  {stated:<12}  {band}")
    if last.periods:
        swings = listed([f"{period:.1f} s" for period in last.periods])
        lines.append(f"It swings freely with periods of {swings}.")
    else:
        lines.append(
            "Its centre of mass is not below the bearing: it does not swing, it falls over."
        )
    if last.misfit > ROUGH:
        lines.append(
            f"The residual is {last.misfit:.1f} times the sensors' noise: something else acts; "
            "ask `twin diagnose`."
        )
    lines.append(_verdict(result))
    lines += [f"skipped {name}: {why}" for name, why in result.skipped.items()]
    return lines


def _verdict(result: Trend) -> str:
    earlier = len(result.floats) - 1
    if result.simulated:
        return (
            "This is what a free float can show; give recordings to hold them against each other."
        )
    if not result.limits:
        return f"Control limits need {FEWEST} earlier recordings; there {_are(earlier)}."
    if result.departures:
        return f"Out of control against {earlier} earlier ones: {listed(result.departures)}."
    return f"In control: no number departs from the {earlier} earlier ones."


def _are(count: int) -> str:
    return "is 1" if count == 1 else f"are {count or 'none'}"


def trend_document(result: Trend) -> Mapping[str, Any]:
    """For `--json`; SI."""
    return {
        "platform": result.platform.name,
        "simulated": result.simulated,
        "recordings": [
            {
                "source": item.source,
                "when": item.when.isoformat(),
                "duration": item.duration,
                "numbers": {name: value.document() for name, value in item.numbers.items()},
                "periods": item.periods,
                "misfit": item.misfit,
            }
            for item in result.floats
        ],
        "stated": dict(result.floats[-1].stated),
        "limits": {
            name: {
                "middle": limit.middle,
                "spread": limit.spread,
                "low": limit.low,
                "high": limit.high,
                "inside": limit.inside,
            }
            for name, limit in result.limits.items()
        },
        "departures": result.departures,
        "skipped": dict(result.skipped),
    }


def trend_figure(result: Trend) -> Figure:
    """Control charts: each number of each recording with its interval, and the limits."""
    names = list(result.floats[-1].numbers)
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 0.8 + 1.5 * len(names)))
        panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        places = np.arange(1, len(result.floats) + 1)
        for panel, name in zip(panels, names, strict=True):
            shown = [item.numbers.get(name) for item in result.floats]
            size = max(max(abs(i.low), abs(i.high)) for i in shown if i is not None)
            factor, unit = fitting(size, UNITS[name])
            for place, interval in zip(places, shown, strict=True):
                if interval is None:
                    continue
                limit = result.limits.get(name)
                out = place == places[-1] and limit is not None and not limit.inside
                color = PALETTE[1] if out else PALETTE[0]
                ends = [(interval.value - interval.low), (interval.high - interval.value)]
                panel.errorbar(
                    place,
                    interval.value / factor,
                    np.array(ends)[:, None] / factor,
                    fmt="o",
                    color=color,
                    capsize=3,
                )
            limit = result.limits.get(name)
            if limit is not None:
                panel.axhspan(limit.low / factor, limit.high / factor, color="#e8edf1", zorder=0)
                panel.axhline(limit.middle / factor, color=SOFT, lw=0.8)
            panel.ticklabel_format(axis="y", useOffset=False)
            panel.set_ylabel(f"{name}\n[{unit}]", fontsize=7)
        panels[-1].set_xticks(places)
        panels[-1].set_xlabel("recording, by time")
        return figure


def trend_page(result: Trend) -> str:
    """The page as text."""
    title = f"Free floats of {result.platform.name}"
    first, *rest = trend_sentences(result)
    said = [line for line in rest if not line.startswith((" ", *UNITS))]
    rows = [
        [str(place), item.source, f"{item.when:%Y-%m-%d %H:%M}", f"{item.duration:.0f} s"]
        for place, item in enumerate(result.floats, start=1)
    ]
    parts = [
        *opened(
            title, first, _verdict(result), [line for line in said if line != _verdict(result)]
        ),
        "<h2>Control charts</h2>",
        Drawing(
            "control",
            trend_figure(result),
            "Each recording with its 95 % interval; the band is three standard deviations of a new "
            "recording about the mean of the earlier ones.",
        ),
        PageTable("recordings", ["number", "recording", "when", "length"], rows),
        foot([], [result.platform]),
    ]
    return page(title, rendered(parts))


def trim_sentences(result: Trim) -> list[str]:
    """What `twin trim` prints."""
    platform, lines = result.platform, list[str]()
    for item in result.added:
        place = ", ".join(f"{value:g}" for value in item.position)
        lines.append(f"With {item.mass:g} kg more at ({place}) m:")
    xx, yy, zz = np.diag(platform.inertia)
    xy, xz, yz = platform.inertia[0, 1], platform.inertia[0, 2], platform.inertia[1, 2]
    entries = zip(("xx", "yy", "zz", "xy", "xz", "yz"), (xx, yy, zz, xy, xz, yz), strict=True)
    lines += [
        f"mass {platform.mass:.6g} kg, J "
        + ", ".join(f"{name} {value:.6g}" for name, value in entries)
        + " kg m^2",
        f"m r {_vector(result.moment)} kg m ({result.source}), wanted {_vector(result.target)}",
    ]
    if platform.stages:
        reach = ", ".join(
            f"{axis} {low:.3g} to {high:.3g}"
            for axis, (low, high) in zip("xyz", result.reach, strict=True)
        )
        lines.append(f"The masses change m r by {reach} kg m.")
        where = ", ".join(
            f"{stage.name} {1e3 * value:.3f} mm"
            for stage, value in zip(platform.stages, result.stages, strict=True)
        )
        lines.append(f"They come nearest at {where}.")
    if not result.weights:
        lines.append("That reaches it: no weight is needed.")
    else:
        lines.append(f"They leave {_vector(result.rest)} kg m. One of these weights takes it away:")
        for item in result.weights:
            far = float(np.linalg.norm(item.position))
            place = ", ".join(f"{value:.3f}" for value in np.round(item.position, 6) + 0.0)
            lines.append(
                f"  {item.mass:g} kg at ({place}) m, {far:.3f} m from the centre of rotation"
            )
    if result.periods:
        swings = listed([f"{period:.1f} s" for period in result.periods])
        lines.append(f"It then swings freely with periods of {swings}.")
    return lines


def _vector(values: Sequence[float] | Any) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in np.round(values, 12) + 0.0) + ")"


def trim_document(result: Trim) -> Mapping[str, Any]:
    """For `--json`; SI."""
    return {
        "platform": result.platform.name,
        "added": [{"mass": i.mass, "position": i.position} for i in result.added],
        "mass": result.platform.mass,
        "inertia": result.platform.inertia,
        "moment": result.moment,
        "source": result.source,
        "target": result.target,
        "reach": result.reach,
        "stages": result.stages,
        "rest": result.rest,
        "weights": [{"mass": i.mass, "position": i.position} for i in result.weights],
        "periods": result.periods,
    }


def calibration_sentences(result: Calibration) -> list[str]:
    """What `twin calibrate` prints."""
    lines = [f"{result.kind} of {', '.join(result.sources)}: {'; '.join(result.remarks)}"]
    for number in result.numbers:
        interval, unit = number.interval, number.unit
        if unit == "T":
            values = (1e6 * x for x in (interval.value, interval.low, interval.high))
            interval, unit = Interval(*values), "uT"
        if np.isfinite(interval.low):
            half = 0.5 * (interval.high - interval.low)
            size = max(abs(interval.value), half)
            said = f"{printed(interval.value, unit, size)} +- {printed(half, unit, size)}"
        else:
            said = printed(interval.value, unit)
        lines.append(f"  {number.name:<22}  {said}")
    if np.isfinite(result.after):
        before, after = (
            three_digits(100.0 * x / result.length) for x in (result.before, result.after)
        )
        lines.append(
            f"The length that it shows is off by {before} % rms as it is, by {after} % calibrated."
        )
    return lines


def calibration_document(result: Calibration) -> Mapping[str, Any]:
    """For `--json`; SI."""
    allan = result.allan
    return {
        "sensor": result.kind,
        "sources": result.sources,
        "numbers": {
            number.name: {**number.interval.document(), "unit": number.unit}
            for number in result.numbers
        },
        "length": result.length,
        "length_error_before": result.before,
        "length_error_after": result.after,
        "allan": None if allan is None else {"tau": allan.tau, "deviation": allan.deviation},
        "remarks": result.remarks,
    }


def calibration_figure(result: Calibration) -> Figure:
    """The Allan deviation of a gyro; of others the length that they show, before and after."""
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 4.8))
        panel = figure.subplots()
        if result.kind == "gyro":
            if result.allan is not None:
                for k, axis in enumerate("xyz"):
                    deviation = result.allan.deviation[:, k]
                    panel.loglog(
                        result.allan.tau, deviation, "o-", ms=3, color=PALETTE[k], label=axis
                    )
                panel.legend()
            panel.set_xlabel("averaging time [s]")
            panel.set_ylabel("Allan deviation [rad/s]")
            return figure
        stride = max(len(result.directions) // DRAWN_POINTS, 1)
        for values, color, label in (
            (result.directions, PALETTE[1], "as shown"),
            (result.corrected, PALETTE[0], "calibrated"),
        ):
            ratio = np.linalg.norm(values, axis=1)[::stride] / result.length
            panel.plot(np.arange(len(ratio)), ratio, ".", color=color, label=label)
        panel.axhline(1.0, color=SOFT, lw=0.8)
        panel.legend()
        panel.set_xlabel("pose" if result.kind == "accelerometer" else "sample, in time")
        panel.set_ylabel("length over that of the truth")
        return figure


def tuning_sentences(result: Tuning) -> list[str]:
    """What `twin tune` prints."""
    unit = result.unit
    lines = [
        f"{result.law} on {result.platform.name}: {result.merit} over {result.runs} dispersed runs "
        f"of {result.duration:g} s, {len(result.trials)} sets of gains"
    ]
    for name, value in result.usual.items():
        lines.append(f"  {name:<24}  {value:.4g} -> {result.tuned[name]:.4g}")
    size = max(abs(result.before), abs(result.after))
    before, after = (printed(value, unit, size) for value in (result.before, result.after))
    low, high = (printed(x, unit, size) for x in (result.difference.low, result.difference.high))
    lines.append(
        f"On {result.held_out} held-out runs: {before} as it was, {after} as tuned; "
        f"paired difference {printed(result.difference.value, unit, size)} (95 %: {low} to {high})."
    )
    if any(result.lost):
        lines.append(f"Of these {result.lost[0]} failed as it was, {result.lost[1]} as tuned.")
    if result.better:
        words = " ".join(f"{name}={value:.4g}" for name, value in result.tuned.items())
        lines.append(
            f"Better beyond chance: twin run ... --controller {result.law} --gains {words}"
        )
    else:
        lines.append("Not better beyond chance: keep the gains as they are.")
    return lines


def tuning_document(result: Tuning) -> Mapping[str, Any]:
    """For `--json`; SI."""
    return {
        "platform": result.platform.name,
        "law": result.law,
        "merit": result.merit,
        "unit": result.unit,
        "runs": result.runs,
        "held_out": result.held_out,
        "duration": result.duration,
        "usual": dict(result.usual),
        "tuned": dict(result.tuned),
        "before": result.before,
        "after": result.after,
        "difference": result.difference.document(),
        "failed": {"before": result.lost[0], "after": result.lost[1]},
        "better": result.better,
        "trials": [{"gains": dict(trial.gains), "merit": trial.merit} for trial in result.trials],
    }


def tuning_figure(result: Tuning) -> Figure:
    """Merit against each gain, of all sets that were flown."""
    names = list(result.usual)
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.4))
        panels = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
        merits = [trial.merit for trial in result.trials]
        for panel, name in zip(panels, names, strict=True):
            values = [abs(trial.gains[name]) for trial in result.trials]
            panel.loglog(values, merits, "o", ms=4, color=PALETTE[0])
            panel.axvline(abs(result.usual[name]), color=SOFT, lw=0.8)
            panel.axvline(abs(result.tuned[name]), color=PALETTE[1])
            panel.set_xlabel(name)
        panels[0].set_ylabel(f"{result.merit} [{result.unit}]")
        return figure
