"""A picture of a machine as its MJCF draws it."""

from pathlib import Path

from twin.errors import TwinError
from twin.platform import Platform
from twin.platform.mjcf import load_mjcf


def draw(platform: Platform, path: Path) -> None:
    """Write a PNG of the machine, from its first camera, in the MJCF's offscreen size.

    It is drawn at its first keyframe, or at rest without one.

    Raises:
        TwinError: this computer has nothing to draw with, or the file cannot be written.
        PlatformError: MuJoCo refuses the MJCF.
    """
    import mujoco
    from matplotlib.image import imsave

    model = load_mjcf(platform.model_path)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    size = model.vis.global_.offheight, model.vis.global_.offwidth
    try:
        with mujoco.Renderer(model, *size) as renderer:
            renderer.update_scene(data, camera=0 if model.ncam else -1)
            pixels = renderer.render()
    except Exception as problem:  # each of MuJoCo's OpenGL back ends raises its own kind
        raise TwinError(
            f"MuJoCo cannot draw here ({problem}): without a screen, install libegl1 or "
            "libosmesa6 and set MUJOCO_GL=egl or MUJOCO_GL=osmesa"
        ) from problem
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        imsave(path, pixels, format="png")
    except OSError as problem:
        raise TwinError(f"cannot write {path}: {problem.strerror}") from None
