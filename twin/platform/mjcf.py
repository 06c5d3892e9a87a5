"""The MJCF as its file has it: nothing set, nothing changed."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.errors import PlatformError, TwinError
from twin.platform.mjcf_files import check_files

Edit = Callable[[mujoco.MjSpec], None]


def load_mjcf(path: Path, *, visuals: bool = True, edits: Sequence[Edit] = ()) -> mujoco.MjModel:
    """Compile the file; without what is only seen, a step is a fifth cheaper.

    Args:
        path: of the MJCF.
        visuals: keep what is only seen.
        edits: changes to make before it is compiled.

    Raises:
        PlatformError: it names a file outside its folder or has a document type, or MuJoCo
            refuses it.
    """
    check_files(path)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compiler.discardvisual = not visuals
        for edit in edits:
            edit(spec)
        return spec.compile()
    except TwinError:
        raise
    except ValueError as problem:
        text = " ".join(str(problem).split())
        raise PlatformError(path, f"MuJoCo refuses it: {text}", "mend the MJCF") from None


def joint_axes(path: Path) -> Mapping[str, NDArray[np.float64]]:
    """Axis of every joint at qpos0, by name, in room axes, which are the body's there."""
    model = load_mjcf(path)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return {model.joint(i).name: data.xaxis[i].copy() for i in range(model.njnt)}
