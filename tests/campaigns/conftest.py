"""Small campaigns on the CubeSat table."""

from collections.abc import Callable
from pathlib import Path

import pytest

from twin.campaigns.execute import execute
from twin.campaigns.folder import Folder
from twin.campaigns.read import read_spec
from twin.campaigns.spec import Spec

GOOD = """
platform = "cubesat"
estimator = "passthrough"
controller = "mass_magnetic_pid"
runs = 24
duration = 1.0
seed = 3
sampling = "sobol"
shard = 6

[gains]
derivative = { grid = [1e-3, 2e-3] }

[initial]
hangs = true
center_of_mass_offset = { uniform = [[-2e-5, -2e-5, -1.4e-4], [2e-5, 2e-5, -1e-4]] }

[effects.stage_backlash]
width = { uniform = [5e-6, 2e-5] }

[effects.gyro_bias]

[effects.bearing_viscous_friction]
"""


def silent(said: str) -> None:
    """Told of progress, says nothing."""
    del said


def shards(folder: Path) -> dict[str, bytes]:
    """Files of a campaign's rows, by name."""
    return {path.name: path.read_bytes() for path in sorted((folder / "metrics").iterdir())}


@pytest.fixture
def spec_of(tmp_path: Path) -> Callable[..., Spec]:
    """A specification from the good one, with texts replaced."""

    def made(*changes: tuple[str, str], text: str = GOOD, name: str = "spec.toml") -> Spec:
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return read_spec(path)

    return made


@pytest.fixture(scope="module")
def undisturbed(file, tmp_path_factory) -> Path:
    """The results of the module's `file`, flown at once."""
    folder = tmp_path_factory.mktemp("undisturbed") / "out"
    execute(read_spec(file), Folder(folder), workers=1, tell=silent)
    return folder
