"""A campaign that is killed goes on where it was, and its results are those of one that was not."""

import json
import os
import random
import signal
import subprocess
import sys
import time
import tracemalloc
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.campaigns.conftest import GOOD, shards, silent
from tests.signals import hear
from twin.campaigns import execute as executing
from twin.campaigns.execute import execute
from twin.campaigns.folder import Folder
from twin.campaigns.read import read_spec
from twin.campaigns.results import schema_of
from twin.campaigns.spec import Spec
from twin.campaigns.worker import Done, fly_shard
from twin.cli.main import main
from twin.errors import CampaignError
from twin.recording import open_log


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("spec") / "spec.toml"
    path.write_text(GOOD, encoding="utf-8")
    return path


def test_one_row_a_run_with_units_in_the_schema(undisturbed, file):
    spec = read_spec(file)
    assert list(shards(undisturbed)) == [f"shard-{n:07d}.parquet" for n in range(4)]
    table = pq.read_table(undisturbed / "metrics")
    assert table["run"].to_pylist() == list(range(24))
    assert set(table["ended"].to_pylist()) == {"done"}
    assert table.schema.equals(schema_of(spec), check_metadata=True)
    assert table.schema.field("gravity_torque").metadata[b"unit"] == b"N m"
    assert table.schema.field("gains.derivative").metadata[b"unit"] == b"N m s"


def test_results_do_not_depend_on_the_number_of_processes(undisturbed, file, tmp_path):
    said: list[str] = []
    progress = execute(read_spec(file), Folder(tmp_path), workers=2, tell=said.append)
    assert shards(tmp_path) == shards(undisturbed)
    assert (progress.flown, progress.failed) == (24, 0)
    assert said[0] == "0 of 24 runs"
    assert said[-1].startswith("24 of 24 runs, ")
    assert "runs/s" in said[-1]
    assert " left" in said[-1]


def test_what_is_done_is_not_flown_again(undisturbed, file, tmp_path):
    spec, folder = read_spec(file), Folder(tmp_path)
    assert execute(spec, folder, workers=1, tell=silent, resume=True).flown == 24
    assert execute(spec, folder, workers=1, tell=silent, resume=True).flown == 0
    folder.shard(2).unlink()
    (tmp_path / "metrics" / ".shard-0000002.parquet.123").write_bytes(b"half")
    assert execute(spec, folder, workers=1, tell=silent, resume=True).flown == 6
    assert shards(tmp_path) == shards(undisturbed)


def test_a_folder_that_holds_something_else_is_refused(undisturbed, file, tmp_path):
    spec = read_spec(file)
    with pytest.raises(CampaignError, match="4 of 4 shards; say --resume"):
        execute(spec, Folder(undisturbed), workers=1, tell=silent)
    other = tmp_path / "other.toml"
    other.write_text(GOOD.replace("seed = 3", "seed = 4"), encoding="utf-8")
    with pytest.raises(CampaignError, match="another specification: other seed; name another"):
        execute(read_spec(other), Folder(undisturbed), workers=1, tell=silent, resume=True)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()
    with pytest.raises(CampaignError, match=r"holds 'thesis.tex' and no campaign"):
        execute(spec, Folder(tmp_path / "full"), workers=1, tell=silent, resume=True)


def test_results_of_another_program_are_not_mixed_in(file, tmp_path):
    spec, folder = read_spec(file), Folder(tmp_path)
    execute(spec, folder, workers=1, tell=silent)
    facts = json.loads((tmp_path / "campaign.json").read_text())
    facts["versions"]["mujoco"] = "1.0"
    (tmp_path / "campaign.json").write_text(json.dumps(facts))
    with pytest.raises(CampaignError, match="begun with another mujoco"):
        execute(spec, folder, workers=1, tell=silent, resume=True)


def test_one_process_owns_the_folder(file, tmp_path):
    folder = Folder(tmp_path)
    with folder.owned(), pytest.raises(CampaignError, match="flown by another process"):
        execute(read_spec(file), folder, workers=1, tell=silent)


def test_memory_does_not_grow_with_the_number_of_runs(tmp_path):
    peaks: list[int] = []
    for runs in (6, 24, 96):  # the first flight imports what all of them keep
        spec = tmp_path / f"{len(peaks)}.toml"
        text = GOOD.replace("runs = 24", f"runs = {runs}").replace(
            "duration = 1.0", "duration = 0.1"
        )
        spec.write_text(text, encoding="utf-8")
        read = read_spec(spec)
        tracemalloc.start()
        execute(read, Folder(tmp_path / f"out{len(peaks)}"), workers=1, tell=silent)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] < 1.1 * peaks[1], f"{peaks} B: something is kept of each shard"


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="nobody lists processes there")
def test_a_worker_that_dies_loses_no_run(undisturbed, file, tmp_path):
    spec, folder = read_spec(file), Folder(tmp_path)
    with folder.owned():
        folder.begin(spec, resume=False)
        flying = executing._by_processes(folder, range(4), 2)
        next(iter(flying))
        (tmp_path / "metrics" / ".shard-0000003.parquet.1").write_bytes(b"half")
        child = _children(os.getpid())[-1]
        os.kill(child, signal.SIGKILL)
        list(flying)
    assert shards(tmp_path) == shards(undisturbed)


class Breaking:
    """A pool that flies in this process; the first one breaks over a shard."""

    def __init__(self, spec: Spec, folder: Folder, shard: int, *, written: bool) -> None:
        """It breaks as it is asked for the shard, or as the shard is `written` and not told."""
        self.spec, self.folder, self.shard, self.written = spec, folder, shard, written
        self.broken = False

    def __call__(self, *_: object, **__: object) -> "Breaking":
        return self

    def submit(self, _: object, shard: int) -> Future[Done]:
        future = Future[Done]()
        breaks = shard == self.shard and not self.broken
        self.broken |= breaks
        if breaks and not self.written:
            raise BrokenProcessPool("a process died")
        future.set_result(fly_shard(self.spec, self.folder, shard))
        if breaks:
            future = Future[Done]()
            future.set_exception(BrokenProcessPool("a process died"))
        return future

    def end(self) -> None:
        """Nobody is there."""


@pytest.mark.parametrize("written", [False, True])
@pytest.mark.parametrize("shard", [1, 3])
def test_a_pool_that_breaks_at_any_moment_loses_no_shard_and_tells_each_once(
    undisturbed, file, tmp_path, monkeypatch, shard, written
):
    spec, folder = read_spec(file), Folder(tmp_path)
    pool = Breaking(spec, folder, shard, written=written)
    monkeypatch.setattr(executing, "Pool", pool)
    progress = execute(spec, folder, workers=2, tell=silent)
    assert pool.broken
    assert shards(tmp_path) == shards(undisturbed), "a shard was not flown"
    assert progress.flown == 24, "a shard that is written was told by nobody, or twice"


def test_command_line_flies_reports_and_replays(undisturbed, file, tmp_path, capsys):
    folder = tmp_path / "out"
    spec = tmp_path / "kept.toml"
    keep = '[keep]\nworst = 1\nby = "in_plane_rms"\n\n[gains]'
    spec.write_text(GOOD.replace("[gains]", keep), encoding="utf-8")
    assert main(["campaign", str(spec), str(folder), "--workers", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["runs"], told["flown"], told["ended"]) == (24, 24, {"done": 24})
    table = pq.read_table(folder / "metrics")
    worst = sorted(zip(table["in_plane_rms"].to_pylist(), table["run"].to_pylist(), strict=True))
    (kept,) = (folder / "recordings").iterdir()
    assert kept.name == f"run-{worst[-1][1]}.rrd"
    recording = open_log(kept)
    assert recording.stop == pytest.approx(1.0, abs=0.06)
    assert recording.provenance["run"] == worst[-1][1]
    assert main(["replay", str(folder), "17", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["same_bits"] is True
    assert told["metrics"]["in_plane_rms"] == table["in_plane_rms"][17].as_py()
    assert main(["replay", str(folder), "24"]) == 2
    assert "runs 0 to 23" in capsys.readouterr().err


def test_a_replay_that_is_not_what_was_written_is_told(undisturbed, tmp_path, capsys):
    folder = tmp_path / "out"
    (folder / "metrics").mkdir(parents=True)
    for name in ("campaign.toml", "campaign.json"):
        (folder / name).write_bytes((undisturbed / name).read_bytes())
    table = pq.read_table(undisturbed / "metrics" / "shard-0000000.parquet")
    values = table["tilt_rms"].to_pylist()
    values[3] *= 1.0 + 1e-15
    index = table.schema.get_field_index("tilt_rms")
    changed = table.set_column(index, table.schema.field(index), pa.array(values))
    pq.write_table(changed, folder / "metrics" / "shard-0000000.parquet")
    assert main(["replay", str(folder), "3"]) == 1
    assert "not what the campaign wrote: tilt_rms" in capsys.readouterr().out


def test_a_dry_run_says_how_many_how_long_how_much_and_flies_nothing(file, tmp_path, capsys):
    assert main(["campaign", str(file), str(tmp_path / "out"), "--dry-run", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["runs"], told["shards"], told["points"], told["samples"]) == (24, 4, 2, 12)
    assert told["seconds"] > 0.0
    assert not (tmp_path / "out").exists()


def test_the_disk_that_a_dry_run_names_is_about_what_is_used(undisturbed, file, capsys):
    assert main(["campaign", str(file), "--dry-run", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    used = sum(len(content) for content in shards(undisturbed).values())
    assert 0.5 < told["bytes"] / used < 2.0


def _children(parent: int) -> list[int]:
    """Processes that a process of ours started and that take part in a campaign."""
    found: list[int] = []
    for entry in Path("/proc").iterdir():
        try:
            status = (entry / "stat").read_text().rpartition(")")[2].split()
            command = (entry / "cmdline").read_text()
        except OSError:
            continue
        if int(status[1]) == parent and "spawn_main" in command:
            found.append(int(entry.name))
    return sorted(found)


def begun(file: Path, folder: Path, workers: int) -> subprocess.Popen[bytes]:
    """A campaign that begins or goes on in a process of its own, as a terminal starts it."""
    command = [sys.executable, "-m", "twin", "campaign", str(file), str(folder), "--resume"]
    return subprocess.Popen(
        [*command, "--workers", str(workers)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=hear,
    )


@pytest.mark.skipif(sys.platform == "win32", reason="nobody is killed with -9 there")
def test_a_campaign_killed_in_its_middle_is_byte_for_byte_the_undisturbed_one(
    undisturbed, file, tmp_path
):
    folder = tmp_path / "out"
    with begun(file, folder, workers=1) as process:
        wait_for_a_shard(process, folder)
        process.send_signal(signal.SIGKILL)
    spec = read_spec(file)
    left = Folder(folder).missing(spec)
    execute(spec, Folder(folder), workers=1, tell=silent, resume=True)
    assert len(left) < 4
    assert shards(folder) == shards(undisturbed)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no process groups there")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_without_a_run_that_was_cut_short(undisturbed, file, tmp_path, number):
    folder, spec = tmp_path / "out", read_spec(file)
    with begun(file, folder, workers=2) as process:
        wait_for_a_shard(process, folder)
        os.killpg(process.pid, number)
        _, said = process.communicate(timeout=60.0)
    assert process.returncode in (128 + number, 0), "0: it was done before it heard of it"
    assert b"Traceback" not in said
    assert process.returncode == 0 or b"--resume` goes on" in said
    assert shards(folder).items() <= shards(undisturbed).items()
    execute(spec, Folder(folder), workers=1, tell=silent, resume=True)
    assert shards(folder) == shards(undisturbed)


def wait_for_a_shard(process: subprocess.Popen[bytes], folder: Path) -> None:
    """Until one is written, or the campaign has ended."""
    end = time.monotonic() + 120.0
    while process.poll() is None and not any((folder / "metrics").glob("*.parquet")):
        assert time.monotonic() < end, "nothing is written"
        time.sleep(0.002)


@pytest.mark.slow
def test_a_campaign_killed_again_and_again_is_byte_for_byte_the_undisturbed_one(tmp_path):
    spec = tmp_path / "spec.toml"
    text = GOOD.replace("runs = 24", "runs = 160").replace("duration = 1.0", "duration = 6.0")
    spec.write_text(text.replace("shard = 6", "shard = 12"), encoding="utf-8")
    execute(read_spec(spec), Folder(tmp_path / "whole"), workers=2, tell=silent)
    folder, draw = tmp_path / "out", random.Random(2)
    killed, kills = 0, 6
    for _ in range(kills):
        with begun(spec, folder, workers=2) as process:
            with suppress(subprocess.TimeoutExpired):
                process.wait(draw.uniform(0.5, 2.5))
            killed += process.poll() is None
            process.send_signal(signal.SIGKILL)
    print(f"{killed} of {kills} were killed at work")
    assert killed > kills // 2, "else it was done before"
    while Folder(folder).missing(read_spec(spec)):
        with begun(spec, folder, workers=2) as process:
            process.wait(timeout=300.0)
    assert shards(folder) == shards(tmp_path / "whole")
