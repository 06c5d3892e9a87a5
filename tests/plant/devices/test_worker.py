"""The thread of a session and its queue: bounded, counted, and never silently dead."""

import re
import time

import pytest

from twin.errors import DeviceError
from twin.plant.devices.device import Counters, Sample, SampleQueue, Worker


def sample(number: float) -> Sample:
    return Sample("gyro", (number,), host_time=number)


def test_a_queue_that_nobody_empties_loses_the_oldest_and_counts_them():
    counters = Counters()
    queue = SampleQueue(counters, limit=3)
    for number in range(5):
        queue.put(sample(number))
    assert [each.value[0] for each in queue.take()] == [2, 3, 4]
    assert counters.overflows == 2
    assert queue.take() == []


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (DeviceError("imu", "lost /dev/x", "plug it in"), "imu: lost /dev/x; plug it in"),
        (
            ZeroDivisionError("by zero"),
            r"imu: stopped by ZeroDivisionError at test_worker.py:\d+: by zero; please report it",
        ),
    ],
)
def test_work_that_fails_ends_the_thread_and_says_why(error, sentence):
    said = []

    def work() -> None:
        raise error

    worker = Worker("imu", work, said.append)
    worker.stop()
    assert re.fullmatch(sentence, said[0])
    assert not worker.alive


def test_stopping_waits_for_the_piece_of_work():
    done = []

    def work() -> None:
        time.sleep(0.02)
        done.append(True)

    worker = Worker("imu", work, done.append)
    time.sleep(0.01)
    worker.stop()
    assert done
    assert not worker.alive
