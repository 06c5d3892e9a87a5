"""Logs as a diagnosis takes them: calibrated, and read rightly where they were not."""

from twin.conventions import ConventionFinding, check_conventions, corrected
from twin.identify.calibrate import calibrated
from twin.platform import Platform
from twin.recording import Recording


def read_rightly(
    recording: Recording, platform: Platform
) -> tuple[Recording, tuple[ConventionFinding, ...]]:
    """One of a log's parts between its pauses, and what it was misread by.

    A late clock is left as it is: it is a cause, and is fitted beside the others.
    """
    log = calibrated(recording.without_truth(), platform)
    found = tuple(one for one in check_conventions(log, platform) if one.kind != "clock_lag")
    return corrected(log, list(found)), found
