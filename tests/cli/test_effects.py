"""`twin effects` tells what an effect is, how large, where from and how it shows; and shows it."""

import json

import pytest

from twin.cli.main import main
from twin.effects import catalogue


def said(capsys, *words: str) -> str:
    assert main(["effects", *words]) == 0
    return capsys.readouterr().out


def test_the_list_names_every_effect_with_size_source_and_what_shows_it(capsys):
    text = said(capsys)
    for kind in catalogue():
        assert f"  {kind.name}" in text
        assert kind.meaning() in text
        assert f"seen in: {', '.join(kind.streams)}; {kind.observable}" in text
        for known in kind.parameters():
            assert f"({known.source})" in text


def test_a_script_reads_the_same(capsys):
    facts = json.loads(said(capsys, "--json"))
    assert [one["name"] for one in facts] == [kind.name for kind in catalogue()]
    lag = next(one for one in facts if one["name"] == "clock_lag")
    assert lag["target"] == "stream"
    assert lag["parameters"][0]["name"] == "lag"
    assert lag["parameters"][0]["unit"] == "s"
    assert lag["parameters"][0]["typical"] == 0.17


def test_one_effect_is_told_in_full(capsys):
    text = said(capsys, "wheel_friction")
    assert "aimed at a wheel" in text
    assert "viscous [N m s]" in text
    assert "dry [N m]" in text
    assert "between 0 and 10" in text


@pytest.fixture
def in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_late_stream_shows_in_itself_and_nowhere_else(capsys, in_folder):
    shown = json.loads(said(capsys, "clock_lag:wheel_speed=0.17", "--show", "sads", "--json"))
    changed = {one["stream"] for one in shown["differences"] if one["worst"] > 0.0}
    assert changed == {"wheel_speed"}
    assert (in_folder / shown["picture"]).stat().st_size > 10_000


def test_a_torque_on_the_body_shows_in_all_that_turns(capsys, in_folder):
    text = said(capsys, "bearing_swirl_torque", "--show", "sads")
    rows = {line.split()[0]: line for line in text.splitlines() if line}
    assert all("unchanged" not in rows[name] for name in ("gyro", "attitude", "wheel_speed"))
    assert "unchanged" in rows["stage_position"]


WRONG = {
    ("clock_lg",): "did you mean 'clock_lag'",
    ("--show",): "--show takes one effect",
    ("gyro_bias=1/0/0",): "values are for --show",
    ("residual_dipole", "--show", "sads"): "sads cannot have residual_dipole: its environment has",
    ("wheel_friction", "--show", "dfki_pendulum"): "the platform has no wheel",
}


@pytest.mark.parametrize("words", WRONG)
def test_what_cannot_be_shown_is_refused_with_a_sentence(capsys, in_folder, words):
    assert main(["effects", *words]) == 2
    assert WRONG[words] in capsys.readouterr().err
