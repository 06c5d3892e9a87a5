"""How each kind of result prints, draws and is written: what `twin.shown.Shown` asks for."""

from collections.abc import Mapping, Sequence
from functools import singledispatch
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from twin.campaigns.answers import Answers
from twin.campaigns.merit import METRICS
from twin.campaigns.replay import Replayed
from twin.comparison import Comparison
from twin.diagnosis import Diagnosis, Validation
from twin.errors import UsageError
from twin.experiments.calibration import Calibration
from twin.experiments.design import Design
from twin.experiments.isolation import Isolation
from twin.experiments.routine import Trend, Trim
from twin.experiments.tuning import Tuning
from twin.files import whole, write_whole
from twin.flight import Run
from twin.formation import FormationRun
from twin.identification import Identification
from twin.platform import Platform, platform_or_reason
from twin.procedures.session import Balanced
from twin.recording import Recording, write_folder
from twin.report.campaign_page import campaign_page, campaign_parts, spread_figure
from twin.report.campaign_words import (
    campaign_document,
    conclusion,
    fixed_words,
    summary,
    verdicts,
)
from twin.report.contents import (
    Contents,
    contents_document,
    contents_of,
    contents_words,
    with_prediction,
)
from twin.report.diagnosed import diagnosed, validated
from twin.report.diagnosis_page import (
    diagnosis_document,
    diagnosis_page,
    diagnosis_parts,
    prediction_figure,
)
from twin.report.document import document
from twin.report.experiment_pages import (
    calibration_document,
    calibration_figure,
    calibration_sentences,
    design_document,
    design_figure,
    design_page,
    design_sentences,
    isolation_document,
    isolation_figure,
    isolation_page,
    isolation_parts,
    isolation_sentences,
    trend_document,
    trend_figure,
    trend_page,
    trend_sentences,
    trim_document,
    trim_sentences,
    tuning_document,
    tuning_figure,
    tuning_sentences,
)
from twin.report.figures import motion_figure
from twin.report.outcome_pages import (
    balance_page,
    balance_parts,
    identification_page,
    identification_parts,
    parameters_figure,
    residual_torque_figure,
    run_page,
    run_parts,
    sentences_page,
    tracking_figure,
)
from twin.report.outcomes import (
    balanced,
    flown,
    flown_together,
    gyro_document,
    gyro_sentences,
    identified,
)
from twin.report.page import comparison_page, comparison_parts
from twin.report.picture import contents_figure, contents_page
from twin.report.style import FIGURE, Part, write_parts
from twin.report.words import sentences
from twin.shown import as_json
from twin.strapdown import GyroComparison
from twin.stream.runfile import write_recording
from twin.units import printed

TITLES: dict[type, str] = {
    FormationRun: "Several machines in one run",
    Tuning: "Gains tuned over dispersions",
    Calibration: "A sensor calibrated",
    Trim: "Trim weights",
    GyroComparison: "The gyro compared with the attitude",
    Replayed: "A run of a campaign, flown again",
    Validation: "The gain on another log",
}
"""Of pages that have no other."""
DRAWN = (".png", ".svg", ".pdf")
ENDINGS = (".html", ".json", ".txt", *DRAWN)


@singledispatch
def sentences_of(result: object) -> Sequence[str]:
    """The lines that the command line prints of a result."""
    raise NotImplementedError(type(result).__name__)


@singledispatch
def document_of(result: object) -> Mapping[str, Any]:
    """What it prints with `--json`.

    Raises:
        UsageError: it has none.
    """
    raise UsageError(f"a {type(result).__name__} has no document; print it, or save it as .txt")


@singledispatch
def figure_of(result: object) -> Figure:
    """The main figure of a result.

    Raises:
        UsageError: it has none.
    """
    raise UsageError(f"a {type(result).__name__} has no figure; print it, or save it as .txt")


@singledispatch
def page_of(result: object) -> str:
    """A page about a result that has none of its own: its figure, if it has one, and its lines."""
    drawn = figure_of.dispatch(type(result)) is not figure_of.dispatch(object)
    title = TITLES.get(type(result), type(result).__name__)
    return sentences_page(title, sentences_of(result), figure_of(result) if drawn else None)


@singledispatch
def parts_of(result: object) -> Sequence[Part]:
    """The figures and tables of a result's page.

    Raises:
        UsageError: it has none.
    """
    raise UsageError(f"a {type(result).__name__} has no figures; print it, or save it as .txt")


def save(result: object, path: Path) -> Path:
    """Write a result into a file; a run or a log as `.rrd`, too, or into a folder of tables; the
    figures and tables of another result's page into a folder.

    Raises:
        UsageError: no format has that ending, or the file cannot be written.
        RecordingError: of a recording.
    """
    ending = path.suffix.lower()
    log = _recording_of(result)
    tables = not ending and isinstance(result, Run | Recording)
    if log is not None and (ending == ".rrd" or tables):
        recording, platform = log
        if ending:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_recording(recording, path, platform)
        else:
            write_folder(recording, path)
        return path
    if ending and ending not in ENDINGS:
        known = (*ENDINGS, "a folder") if log is None else (*ENDINGS, ".rrd", "a folder")
        raise UsageError(f"{path}: a result is saved as one of {', '.join(known)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not ending:
            write_figures(result, path)
        elif ending == ".html":
            write_whole(path, page_of(result))
        elif ending == ".json":
            write_whole(path, as_json(document_of(result)) + "\n")
        elif ending == ".txt":
            write_whole(path, "\n".join(sentences_of(result)) + "\n")
        else:
            with mpl.rc_context(FIGURE), whole(path) as file:
                figure_of(result).savefig(file, format=ending[1:], dpi=130)
    except OSError as problem:
        raise UsageError(f"{path} cannot be written ({problem.strerror})") from None
    return path


def write_figures(result: object, folder: Path) -> None:
    """Write the figures of a result's page as SVG and PDF, and its tables as CSV.

    Raises:
        UsageError: it has none, or the folder cannot be written.
    """
    try:
        write_parts(folder, parts_of(result))
    except OSError as problem:
        raise UsageError(f"{folder} cannot be written ({problem.strerror})") from None


def _recording_of(result: object) -> tuple[Recording, Platform | None] | None:
    """The recording of a run or a log, or of a log beside its prediction; and its machine."""
    if isinstance(result, Run):
        return result.recording, result.platform
    if isinstance(result, Comparison):
        return with_prediction(result.best.explained), result.platform
    if isinstance(result, Diagnosis):
        return with_prediction(result.explained.account), result.platform
    if not isinstance(result, Recording):
        return None
    return result, platform_or_reason(result)[0]


def contents(recording: Recording, platform: Platform | None = None) -> Contents:
    """What is in a recording, held against a machine, by default the one that it names."""
    machine, problem = platform_or_reason(recording) if platform is None else (platform, "")
    return contents_of(recording.source, recording, machine, problem)


sentences_of.register(Diagnosis, diagnosed)
figure_of.register(Diagnosis, prediction_figure)
page_of.register(Diagnosis, diagnosis_page)
sentences_of.register(Comparison, sentences)
figure_of.register(Comparison, motion_figure)
sentences_of.register(Identification, identified)
document_of.register(Run, Run.document)
document_of.register(FormationRun, FormationRun.document)
sentences_of.register(FormationRun, flown_together)
document_of.register(Contents, contents_document)
figure_of.register(Contents, contents_figure)
page_of.register(Contents, contents_page)
document_of.register(Answers, campaign_document)
figure_of.register(Answers, spread_figure)
page_of.register(Answers, campaign_page)
parts_of.register(Answers, campaign_parts)
parts_of.register(Diagnosis, diagnosis_parts)
figure_of.register(Identification, parameters_figure)
page_of.register(Identification, identification_page)
parts_of.register(Identification, identification_parts)
figure_of.register(Balanced, residual_torque_figure)
page_of.register(Balanced, balance_page)
parts_of.register(Balanced, balance_parts)
page_of.register(Run, run_page)
parts_of.register(Run, run_parts)
sentences_of.register(GyroComparison, gyro_sentences)
sentences_of.register(Isolation, isolation_sentences)
sentences_of.register(Design, design_sentences)
document_of.register(Design, design_document)
figure_of.register(Design, design_figure)
page_of.register(Design, design_page)
sentences_of.register(Trend, trend_sentences)
document_of.register(Trend, trend_document)
figure_of.register(Trend, trend_figure)
page_of.register(Trend, trend_page)
sentences_of.register(Trim, trim_sentences)
sentences_of.register(Calibration, calibration_sentences)
document_of.register(Calibration, calibration_document)
figure_of.register(Calibration, calibration_figure)
sentences_of.register(Tuning, tuning_sentences)
document_of.register(Tuning, tuning_document)
figure_of.register(Tuning, tuning_figure)
document_of.register(Trim, trim_document)
document_of.register(Isolation, isolation_document)
figure_of.register(Isolation, isolation_figure)
page_of.register(Isolation, isolation_page)
parts_of.register(Isolation, isolation_parts)


@document_of.register
def _(result: Diagnosis) -> Mapping[str, Any]:
    return diagnosis_document(result, None)


@document_of.register
def _(result: Comparison) -> Mapping[str, Any]:
    return document([result], [])


@page_of.register
def _(result: Comparison) -> str:
    return comparison_page([result])


@parts_of.register
def _(result: Comparison) -> Sequence[Part]:
    return comparison_parts([result])


@document_of.register
def _(result: Identification) -> Mapping[str, Any]:
    return result.document()


@sentences_of.register
def _(result: Contents) -> Sequence[str]:
    return contents_words(result).splitlines()


@sentences_of.register
def _(result: Recording) -> Sequence[str]:
    return sentences_of(contents(result))


@document_of.register
def _(result: Recording) -> Mapping[str, Any]:
    return document_of(contents(result))


@figure_of.register
def _(result: Recording) -> Figure:
    return contents_figure(contents(result))


@page_of.register
def _(result: Recording) -> str:
    return contents_page(contents(result))


@sentences_of.register
def _(result: Run) -> Sequence[str]:
    warned = [f"warning: {warning}" for warning in result.warnings]
    return [*warned, *flown(result.platform, result.outcome, result.metrics, result.settle)]


@figure_of.register
def _(result: Run) -> Figure:
    return tracking_figure(result.recording) or figure_of(result.recording.without_truth())


@sentences_of.register
def _(result: Balanced) -> Sequence[str]:
    lines: list[str] = []
    for run in range(result.session.runs):
        told = result.run(run)
        which = f"run {run}: " if result.session.runs > 1 else ""
        end = f"{which}{told['ended']} after {told['duration']:.0f} s"
        end += f", offset identified {told['identified']} times"
        lines.append(f"{end}: {told['reason']}" if told["reason"] else end)
        statement = result.statements[run]
        if statement is not None:
            lines += balanced(statement, result.platform, result.target)
    if result.rrd is not None:
        lines.append(f"recorded in {result.rrd}: look at it with `twin view {result.rrd}`")
    return lines


@document_of.register
def _(result: Balanced) -> Mapping[str, Any]:
    runs = [result.run(run) for run in range(result.session.runs)]
    return runs[0] if len(runs) == 1 else {"runs": runs}


@sentences_of.register
def _(result: Answers) -> Sequence[str]:
    return [*conclusion(result), *summary(result), *fixed_words(result), *verdicts(result)]


@sentences_of.register
def _(result: Replayed) -> Sequence[str]:
    came = result.came
    end = f"run {result.run}, {result.arm}: {came.ended} after {came.duration:g} s"
    lines = [f"{end}: {came.reason}" if came.reason else end]
    lines += [f"  {name} {printed(v, result.units[name])}" for name, v in result.values.items()]
    lines += [
        f"  {name} {printed(v, METRICS[name].unit) if v == v else 'none'}"
        for name, v in came.metrics.items()
    ]
    if result.differs is None:
        lines.append("the campaign has not written this run yet")
    elif result.differs:
        lines.append("not what the campaign wrote: " + ", ".join(result.differs))
    else:
        lines.append("to the last bit what the campaign wrote")
    return lines


@document_of.register
def _(result: Replayed) -> Mapping[str, Any]:
    return {
        "run": result.run,
        "arm": result.arm,
        "ended": result.came.ended,
        "reason": result.came.reason or None,
        "duration": result.came.duration,
        "factors": result.values,
        "metrics": result.came.metrics,
        "same_bits": None if result.differs is None else not result.differs,
    }


@document_of.register
def _(result: GyroComparison) -> Mapping[str, Any]:
    return gyro_document("", result)


@sentences_of.register
def _(result: Validation) -> Sequence[str]:
    return [validated(result)]
