"""A signal is a request: nothing raises where it arrives, and what hears it ends in time."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest

from tests.signals import hear
from twin import stop
from twin.files import whole, whole_folder
from twin.processes import Pool, first_completed, run

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are other signals there")


@pytest.mark.parametrize("number", stop.SIGNALS)
def test_a_signal_raises_nothing_until_the_loop_polls(hears, number):
    with stop.listening():
        os.kill(os.getpid(), number)
        assert stop.requested() == number
        with pytest.raises(stop.Stopped) as ended:
            stop.check()
        assert ended.value.status == 128 + number
    assert stop.requested() is None
    stop.check()


def test_a_wait_ends_within_a_poll_of_the_request(hears):
    with stop.listening():
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGTERM)).start()
        started = time.monotonic()
        with pytest.raises(stop.Stopped, match="stopped by SIGTERM"):
            stop.sleep(60.0)
    assert time.monotonic() - started < 30.0


def test_a_wait_is_over_when_what_it_waits_for_is_there_or_its_time_is_over():
    assert stop.until(lambda: True, 0.0)
    assert not stop.until(lambda: False, 0.05)


def test_handlers_are_those_of_before_when_nobody_listens(hears):
    before = [signal.getsignal(number) for number in stop.SIGNALS]
    with stop.listening(), stop.listening():
        assert [signal.getsignal(number) for number in stop.SIGNALS] != before
    assert [signal.getsignal(number) for number in stop.SIGNALS] == before


def test_a_signal_that_was_ignored_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop.listening():
            os.kill(os.getpid(), signal.SIGHUP)
            assert stop.requested() is None
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_second_signal_interrupts_a_caller_of_ours_at_once(hears):
    with stop.listening():
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


STUCK = """
import sys, time
from pathlib import Path
from twin import stop
from twin.files import whole

stop.GRACE, stop.SHIELDED = float(sys.argv[1]), 0.5
stop.listen()
stop.keeps(lambda: "nothing is kept")
with whole(Path("out.txt")) as file:
    file.write(b"half")
    file.flush()
    print("begun", flush=True)
    while True:
        try:
            time.sleep(1.0)
        except BaseException:
            pass
"""
"""A program that never polls."""


def stuck(folder: Path, grace: float, signals: int) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", STUCK, str(grace)]
    with subprocess.Popen(
        command,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hear,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        for _ in range(signals):
            process.send_signal(signal.SIGTERM)
            time.sleep(0.2)
        out, said = process.communicate(timeout=60.0)
    return subprocess.CompletedProcess(command, process.returncode, out, said)


@pytest.mark.parametrize(("grace", "signals"), [(0.3, 1), (1000.0, 2)])
def test_a_program_that_does_not_poll_ends_after_its_grace_or_at_the_second_signal(
    tmp_path, grace, signals
):
    done = stuck(tmp_path, grace, signals)
    assert done.returncode == 143
    assert done.stderr == "twin: stopped at once by SIGTERM; nothing is kept\n"
    assert list(tmp_path.iterdir()) == [], "half a file is left"


def test_a_file_or_folder_is_whole_or_absent(tmp_path):
    with suppress(stop.Stopped), whole(tmp_path / "file") as file:
        file.write(b"half")
        raise stop.Stopped(signal.SIGINT)
    with suppress(stop.Stopped), whole_folder(tmp_path / "folder") as part:
        (part / "half").touch()
        raise stop.Stopped(signal.SIGINT)
    assert list(tmp_path.iterdir()) == []
    with whole_folder(tmp_path / "folder") as part:
        (part / "all").touch()
    assert [path.name for path in tmp_path.rglob("*")] == ["folder", "all"]


def idle(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def test_workers_hear_no_signal_and_end_with_their_pool():
    with Pool(1) as pool:
        worker = pool.submit(idle, 0.0).result(timeout=60.0)
        for number in stop.SIGNALS:
            os.kill(worker, number)
        assert pool.submit(idle, 0.0).result(timeout=60.0) == worker
        pool.submit(idle, 600.0)
    assert_gone(worker)


def test_a_pool_whose_work_is_waited_for_ends_when_a_stop_is_requested(hears):
    with stop.listening(), Pool(1) as pool:
        worker = pool.submit(idle, 0.0).result(timeout=60.0)
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
        with pytest.raises(stop.Stopped):
            first_completed([pool.submit(idle, 600.0)])
    assert_gone(worker)


PARENT = """
import os, sys, time
from twin.processes import Pool

if __name__ == "__main__":
    pool = Pool(1)
    print(pool.submit(os.getpid).result(), flush=True)
    pool.submit(time.sleep, 600.0)
    time.sleep(600.0)
"""


def test_a_worker_ends_with_a_parent_that_is_killed(tmp_path):
    program = tmp_path / "parent.py"
    program.write_text(PARENT, encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, str(program)],
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
    ) as process:
        assert process.stdout is not None
        worker = int(process.stdout.readline())
        process.kill()
        process.wait(timeout=60.0)
    assert_gone(worker)


OWN_WORK = """
from twin.processes import Pool

def doubled(number):
    return 2 * number

if __name__ == "__main__":
    with Pool(1) as pool:
        print(pool.submit(doubled, 21).result())
"""


def test_a_pool_does_work_that_a_script_defines(tmp_path):
    program = tmp_path / "own_work.py"
    program.write_text(OWN_WORK, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(program)],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
        timeout=60.0,
    )
    assert (done.returncode, done.stdout) == (0, "42\n"), done.stderr


TRACKED = """
import os, signal, time
from twin import stop
from twin.processes import Pool

if __name__ == "__main__":
    with stop.listening(), Pool(1) as pool:
        pool.submit(os.getpid).result()
        os.killpg(0, signal.SIGHUP)
        time.sleep(0.5)
"""


def test_the_tracker_of_a_pools_locks_survives_a_signal_to_the_group(tmp_path):
    """Begun again, it would print a traceback for each lock that it never had."""
    program = tmp_path / "tracked.py"
    program.write_text(TRACKED, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(program)],
        capture_output=True,
        text=True,
        start_new_session=True,
        preexec_fn=hear,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
        timeout=60.0,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_another_program_ends_with_all_it_has_started_when_a_stop_is_requested(hears, tmp_path):
    mark = tmp_path / "child"
    script = f"sleep 600 & echo $! > {mark}; wait"
    with stop.listening():

        def interrupt() -> None:
            while not (mark.exists() and mark.read_text().strip()):
                time.sleep(0.01)
            os.kill(os.getpid(), signal.SIGINT)

        threading.Thread(target=interrupt, daemon=True).start()
        with pytest.raises(stop.Stopped):
            run(["sh", "-c", script])
    assert_gone(int(mark.read_text()))


def test_the_exit_code_of_another_program_is_given_back():
    assert run([sys.executable, "-c", "raise SystemExit(7)"]) == 7


def assert_gone(process: int) -> None:
    """It has ended, or does within a while; one that nobody has waited for yet has ended too."""
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        try:
            status = Path(f"/proc/{process}/stat").read_text(encoding="ascii")
        except (FileNotFoundError, ProcessLookupError):
            return
        if status.rpartition(")")[2].split()[0] in "ZX":
            return
        time.sleep(0.02)
    pytest.fail(f"process {process} is left")
