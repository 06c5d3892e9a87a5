"""Several machines in one run, as their user meets them: one recording, each log as if alone."""

import json
from pathlib import Path

import numpy as np
import pytest

import twin
from twin.cli.main import main
from twin.errors import RecordingError, TwinError
from twin.formation import FormationRun, fly_formation
from twin.rotation import conjugate, multiply, tilt
from twin.stream.blueprint import Scene, layout_of_several
from twin.stream.rows import Placed


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[FormationRun, Path]:
    path = tmp_path_factory.mktemp("formation") / "three.rrd"
    run = fly_formation(
        {"whorl1": "whorl1", "whorl2": "whorl2", "station": "whorl1:captured"},
        "relative_tracking",
        radio="delay=0.1,loss=0.1,rate=10",
        each={
            "whorl2": {"attitude": (0.0, 0.0, float(np.radians(6.0)))},
            "station": {"controller": "free_float"},
        },
        duration=4.0,
        rrd=path,
    )
    return run, path


def test_each_machine_is_read_from_the_one_file_as_it_was_flown(flown):
    run, path = flown
    for name in ("whorl1", "whorl2", "station"):
        kept, read = run.runs[name].recording, twin.read(f"{path}#{name}")
        assert set(kept) == set(read)
        for stream, series in kept.items():
            assert np.array_equal(series.time, read[stream].time)
            assert np.array_equal(series.value, read[stream].value)
        source = {"source": f"{path}#{name}"}
        assert {**kept.provenance, **source} == {**read.provenance, "name": name}
    assert twin.machine_of(f"{path}#station").name == "whorl1:captured"


def test_a_file_of_several_machines_asks_for_one_of_them(flown):
    _, path = flown
    name = path.name
    with pytest.raises(RecordingError) as refused:
        twin.read(path)
    listed = f"{name}#whorl1, {name}#whorl2, {name}#station"
    assert f"holds several machines; name one of {listed}" in str(refused.value)
    with pytest.raises(RecordingError, match=f"has no machine 'whorl3'; name one of {name}#"):
        twin.read(f"{path}#whorl3")


def test_a_file_that_is_cut_still_has_each_machine(flown, tmp_path: Path):
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(flown[1].read_bytes()[:-40])
    whole, left = flown[0].runs["whorl2"].recording, twin.read(f"{cut}#whorl2")
    assert "was cut short" in left.repairs[0]
    assert np.array_equal(left["gyro"].value, whole["gyro"].value)


def test_true_relative_motion_is_that_of_the_two_logs(flown):
    first, second = (flown[0].runs[name].recording for name in ("whorl1", "whorl2"))
    turn = multiply(conjugate(first["truth_attitude"].value), second["truth_attitude"].value)
    assert np.allclose(second["truth_relative_attitude_to_whorl1"].value, turn)
    back = first["truth_relative_attitude_to_whorl2"].value
    assert np.allclose(conjugate(back), turn)
    # messages of 10 Hz, 0.1 s late: 0.1 to 0.2 s old, but for the lost ones
    age = second["relative_age_to_whorl1"].value
    assert age.min() == pytest.approx(0.1)
    assert np.median(age) < 0.2 < age.max()


def test_a_captured_machine_stands_still(flown):
    station = flown[0].runs["station"].recording
    assert tilt(station["truth_attitude"].value).max() < 1e-9
    assert np.abs(station["truth_rate"].value).max() < 1e-9


def test_the_run_tells_how_each_machine_and_each_pair_went(flown):
    run, _ = flown
    document = run.document()
    assert list(document["machines"]) == ["whorl1", "whorl2", "station"]
    assert [entry["of"] for entry in document["relative"]] == [
        ["whorl2", "whorl1"],
        ["station", "whorl1"],
        ["station", "whorl2"],
    ]
    assert document["radio"] == {"delay": 0.1, "loss": 0.1, "rate": 10.0, "hears": {}}
    lines = str(run).splitlines()
    assert "whorl1: done after 4 s" in lines
    assert any(line.startswith("whorl2 relative to whorl1: ") for line in lines)


def test_the_verb_flies_the_same_bits_as_the_function_and_names_the_logs(flown, tmp_path, capsys):
    out = tmp_path / "again.rrd"
    words = ["run", "whorl1", "whorl2", "station=whorl1:captured", "--rrd", str(out), "--json"]
    words += ["--controller", "relative_tracking", "--radio", "delay=0.1,loss=0.1,rate=10"]
    words += ["--duration", "4", "--each", "whorl2.attitude=0,0,6"]
    assert main([*words, "station.controller=free_float"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["ended"] == "done"
    again = twin.read(f"{out}#whorl2")
    for stream, series in flown[0].runs["whorl2"].recording.items():
        assert np.array_equal(series.value, again[stream].value), stream


def test_view_shows_all_machines_of_a_file_as_it_is(flown, monkeypatch):
    shown: list[Path] = []
    monkeypatch.setattr("twin.cli.logs._show", lambda path: shown.append(path) or 0)
    assert main(["view", str(flown[1])]) == 0
    assert main(["view", f"{flown[1]}#whorl2"]) == 0
    assert shown[0] == flown[1]
    assert shown[1] != flown[1]


def test_two_on_one_floor_know_where_the_other_is():
    run = fly_formation(
        {"a": "astros:mode_c", "b": "astros:mode_c"},
        "thruster_five",
        each={"a": {"origin": (0.0, 0.0, 0.0)}, "b": {"origin": (2.0, 1.0, 0.0)}},
        reference="move:0.1,0",
        duration=3.0,
    )
    first, second = (run.runs[name].recording for name in "ab")
    true = second["truth_relative_position_to_a"].value
    apart = second["truth_position"].value - first["truth_position"].value + (2.0, 1.0, 0.0)
    assert np.allclose(true, apart)
    known = second["relative_position_to_a"].value
    assert np.abs(known - true[-len(known) :])[:, :2].max() < 0.01
    assert run.relative["b", "a"]["distance_min_m"] == pytest.approx(np.sqrt(5.0), abs=0.05)
    # not the same noise twice
    assert not np.array_equal(first["gyro"].value, second["gyro"].value)


def test_machines_stand_side_by_side_in_one_scene_with_a_tab_each():
    whorls = [twin.load(name) for name in ("whorl1", "whorl2")]
    machines = {p.name: Placed(p, (0.0, float(i), 0.0)) for i, p in enumerate(whorls)}
    scene, shown = layout_of_several(machines).root_container.contents
    assert scene.name == "whorl1, whorl2"
    assert [tab.name for tab in shown.contents] == ["relative", "whorl1", "whorl2"]
    (view,) = shown.contents[0].contents
    assert view.name == "attitude of whorl2 relative to whorl1 [deg]"
    for path, _ in Scene(whorls[1], "world/whorl2").shapes():
        assert path.startswith("world/whorl2/") or path == "world/whorl2"


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["whorl1", "whorl1"], "two machines are called 'whorl1': name each, as in a=whorl1"),
        (["whorl1", "world=whorl2"], "a machine cannot be called 'world'"),
        (["whorl1", "dfki_pendulum"], "dfki_pendulum turns about one axis"),
        (["whorl1", "whorl2", "--plant", "pty"], "--plant pty is for one machine"),
        (["whorl1", "whorl2", "--arm", "floating"], "--arm is for one machine"),
        (["whorl1", "--radio", "off"], "--radio is for several machines"),
        (["whorl1", "whorl2", "--radio", "late"], "'late' is not understood"),
        (["whorl1", "whorl2", "--each", "x.rate=0,0,1"], "no machine named 'x'"),
        (["whorl1", "whorl2", "--each", "whorl1.rte=0"], "no setting of a machine named 'rte'"),
        (["whorl1", "whorl2", "--each", "whorl1.rate=0"], "give three numbers"),
        (["whorl1", "whorl2", "--each", "rate=0"], "give NAME.OPTION=VALUE"),
        (["whorl1", "whorl2", "--each", "whorl1.hears=x"], "no machine named 'x'"),
        (["whorl1", "whorl2", "--controller", "tcp://:1"], "is not told what the radio brings"),
    ],
)
def test_what_cannot_fly_together_is_refused_with_the_remedy(words, what, capsys):
    assert main(["run", *words, "--duration", "1"]) == 2
    assert what in capsys.readouterr().err


def test_one_machine_is_no_formation():
    with pytest.raises(TwinError, match="two or more"):
        fly_formation(["whorl1"])
