"""Hold platform.toml and its MJCF against each other; a picture of the machine."""

from pathlib import Path

import mujoco

from twin.check.finding import Finding, compare, judge
from twin.check.motion import check_foreign, check_step, check_stop, passive_terms
from twin.check.parts import check_joints, check_masses, check_parts, check_whole
from twin.config import read_toml
from twin.errors import PlatformError, TwinError
from twin.model import compile_model, mass_properties
from twin.platform import Platform, load_platform, variants_of
from twin.platform.mjcf import load_mjcf


def check_platform(platform: Platform) -> list[Finding]:
    """Every check of the platform's folder, its variants too; the wrong ones have `ok` False.

    The MJCF is first taken as its file has it, against the base values of platform.toml; then
    each variant is compiled as a simulation would have it.
    """
    base = load_platform(platform.folder)
    model = load_mjcf(base.model_path)
    joints = check_joints(base, model)
    findings = [*_hardware(base), *_options(base, model), *joints]
    if not all(finding.ok for finding in joints):
        return findings  # the rest would only repeat it
    findings += check_parts(base, model)
    findings += check_masses(base, model)
    findings += check_stop(base, model)
    foreign = check_foreign(base, model)
    findings += [*foreign, passive_terms(base, model)]
    if not all(finding.ok for finding in foreign):
        return findings  # it shows in the step's error too, where no smaller step would do
    findings += _compiled(base)
    for variant in variants_of(base.folder):
        findings += _compiled(load_platform(f"{base.folder}:{variant}"))
    return findings


def _hardware(platform: Platform) -> list[Finding]:
    """What is wired to the machine, where platform.toml says so."""
    if "hardware" not in read_toml(platform.folder / "platform.toml", PlatformError):
        return []
    from twin.plant.hardware_setup import read_hardware  # its drivers take a while to import

    try:
        devices = ", ".join(sorted(read_hardware(platform).devices))
    except PlatformError as problem:
        return [Finding("[hardware] can be read", False, "yes", "no", "", str(problem))]
    return [Finding("[hardware] can be read", True, None, f"yes: {devices}")]


def _options(platform: Platform, model: mujoco.MjModel) -> list[Finding]:
    """The viewer runs the file's own options: they should be those of a simulation."""
    integrator = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_")
    return [
        judge(
            "integrator",
            integrator == "RK4",
            "RK4",
            integrator,
            "",
            'the viewer would be wrong by degrees; set <option integrator="RK4">',
        ),
        compare(
            "step",
            platform.step,
            model.opt.timestep,
            "s",
            "<option timestep> is not simulation.step; the viewer would run at another step",
        ),
        compare(
            "gravity",
            [0.0, 0.0, -platform.gravity],
            model.opt.gravity,
            "m/s^2",
            "<option gravity> is not environment.gravity, straight down",
        ),
    ]


def _compiled(platform: Platform) -> list[Finding]:
    try:
        machine = compile_model(platform)
    except PlatformError as problem:
        return [Finding(f"{platform.name}: can be compiled", False, "yes", "no", "", str(problem))]
    properties = mass_properties(machine.model, machine.base_body)
    return [*check_whole(platform, properties, platform.name), *check_step(platform)]


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
