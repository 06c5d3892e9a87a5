"""Logs that differ in what they hold are one body of evidence, in whatever order they are named."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.diagnosis import diagnose, extend
from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.engine import Engine, SearchState
from twin.diagnosis.explanation import explain
from twin.effects import parse_effects
from twin.library import library
from twin.platform import load_platform
from twin.recording import Recording
from twin.report.diagnosed import diagnosed

FIELD = np.array([2.2e-5, 0.0, -4.2e-5])


def without(log: Recording, *names: str) -> Recording:
    return replace(log, streams={k: s for k, s in log.items() if k not in names})


def test_what_is_left_of_each_stream_is_its_own_in_any_order_of_the_logs(
    flight_of: Callable[..., Recording], drawn_seed: int
):
    fly = "sads", "quaternion_pd", "multisine:8", 12.0
    one, other = (flight_of(*fly, drawn_seed + i) for i in (0, 1))
    logs = [without(one, "wheel_speed"), without(other, "gyro")]
    left = [
        baseline_of(order, load_platform("sads")).account.misfits for order in (logs, logs[::-1])
    ]
    forth, back = ({(m.stream, m.column): m.chi2 for m in one} for one in left)
    assert set(forth) == set(back)
    assert {stream for stream, _ in forth} >= {"gyro", "attitude", "wheel_speed"}
    for place, chi2 in forth.items():
        assert back[place] == pytest.approx(chi2, rel=1e-4)


@pytest.fixture
def in_a_field(tmp_path: Path) -> Callable[[np.ndarray], str]:
    """A copy of `sads` in a field that the shipped one does not state."""

    def write(field: np.ndarray) -> str:
        folder = tmp_path / f"sads{len(list(tmp_path.iterdir()))}"
        shutil.copytree(library("models") / "sads", folder)
        path = folder / "platform.toml"
        text, stated = path.read_text(), f"magnetic_field = {field.tolist()}"
        path.write_text(text.replace("[environment]\n", f"[environment]\n{stated}\n"))
        return str(folder)

    return write


@pytest.fixture
def with_a_dipole(
    flight_of: Callable[..., Recording], in_a_field: Callable[[np.ndarray], str]
) -> Callable[[int], tuple[np.ndarray, list[Recording]]]:
    """A moment [A m^2] drawn from a seed, and two logs that hide it, in opposite fields."""

    def fly(seed: int) -> tuple[np.ndarray, list[Recording]]:
        rng = np.random.default_rng(seed)
        moment = rng.uniform(20.0, 40.0, 3) * rng.choice([-1.0, 1.0], 3)
        hidden = "residual_dipole=" + "/".join(map(str, moment))
        logs = [
            replace(
                flight_of(
                    in_a_field(field), "quaternion_pd", "multisine:8", 20.0, seed + i, hidden
                ),
                provenance={
                    "source": f"log {i}",
                    "environment": {"magnetic_field": field.tolist()},
                },
            )
            for i, field in enumerate((FIELD, -FIELD))
        ]
        return moment, logs

    return fly


@pytest.mark.slow(80)
def test_a_dipole_is_found_in_the_fields_that_the_logs_state_each_its_own(
    with_a_dipole, drawn_seed: int, tmp_path: Path
):
    moment, logs = with_a_dipole(drawn_seed)
    found = diagnose(logs, load_platform("sads"))
    (cause,) = found.causes
    print(moment, cause.effect.values, cause.half_widths)
    assert cause.effect.label == "residual_dipole"
    assert np.all(np.abs(cause.effect.values - moment) < 2.0 * cause.half_widths)
    assert "Free runs of the first stretch of log, before" in " ".join(diagnosed(found))
    alone = diagnose(logs[:1], load_platform("sads"))
    assert "Free runs, before" in " ".join(diagnosed(alone))
    extended = extend(alone, tmp_path / "extended")
    np.testing.assert_array_equal(extended.magnetic_field, FIELD)


@pytest.mark.slow
def test_a_second_cause_that_another_base_makes_good_is_dropped_whatever_its_columns_promise(
    with_a_dipole,
):
    # fitted together they lead to another base, from where no column leads back
    _, logs = with_a_dipole(1821617198)
    plain = baseline_of(logs, load_platform("sads"))
    both = parse_effects("residual_dipole=-36.2/-32.9/31.2,wheel_misalignment:w3=-0.05/0.05/0")
    there = explain(plain.bodies, plain.base, both, plain.at)
    state = SearchState(there)
    assert len(state.search.best()) == 2
    fewer = Engine((), lambda _: None).without_one(state)
    assert fewer is not None
    (left,) = fewer.explanation.effects
    assert left.label == "residual_dipole"
