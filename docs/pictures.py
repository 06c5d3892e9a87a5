"""The pictures of the README and of these pages, made by the twin: `python docs/pictures.py`.

That of the viewer needs a Vulkan driver (`apt-get install mesa-vulkan-drivers`).
"""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.image
import numpy as np

import twin
from twin.recording import Series
from twin.report import with_prediction
from twin.stream.runfile import write_recording

IMAGES = Path(__file__).parent / "images"
PENDULUM = Path(__file__).parents[1] / "models" / "dfki_pendulum" / "logs" / "energy_shaping"
MOMENT = 6.35
"""At which the measured pendulum is drawn beside its prediction [s]."""
TRIES = 8
"""The viewer takes its picture when it likes, sometimes before it has loaded all."""


def diagnosis() -> None:
    """Fly a table whose bearing rubs, and diagnose the log by a model without friction."""
    run = twin.fly(
        "sads",
        "quaternion_pd",
        reference="multisine:10@0.05",
        duration=60.0,
        effects="bearing_viscous_friction=0.2",
        seed=1,
    )
    found = twin.diagnose(run.recording, "sads")
    print(found)
    found.save(IMAGES / "diagnosis.png")


def viewer() -> None:
    """The viewer's scene: a measured pendulum, and the prediction of its model as built."""
    comparison = twin.compare(PENDULUM)
    recording = with_prediction(comparison.as_built.plain)
    streams = {
        name: Series(s.time[rows], s.value[rows], s.columns, s.unit)
        for name, s in recording.items()
        if (rows := s.time >= MOMENT).any()
    }
    with TemporaryDirectory() as folder:
        file = Path(folder) / "pendulum.rrd"
        write_recording(replace(recording, streams=streams), file, comparison.platform)
        shots = [_shot(file, Path(folder) / f"{i}.png") for i in range(TRIES)]
        best = max(shots, key=lambda path: path.stat().st_size)
        picture = matplotlib.image.imread(best)[90:1940, :1280, :3]
    height, width = picture.shape[0] // 2, picture.shape[1] // 2
    small = picture[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
    matplotlib.image.imsave(IMAGES / "viewer.png", np.clip(small, 0.0, 1.0))


def _shot(recording: Path, path: Path) -> Path:
    command = [sys.executable, "-m", "rerun_cli", str(recording), "--headless"]
    command += ["--renderer", "vulkan", "--window-size", "1600x1000", "--screenshot-to", str(path)]
    subprocess.run(command, check=True, capture_output=True)
    return path


if __name__ == "__main__":
    diagnosis()
    viewer()
