"""A law without a name, saved, is an effect that acts as the law does."""

import numpy as np

from twin.cli.main import main
from twin.diagnose.cause import Equation
from twin.diagnose.law_file import write_law
from twin.diagnose.laws import laws_of
from twin.effects import BodyEffect, State, effect_named
from twin.model import compile_model
from twin.platform import load_platform
from twin.predict.body import body_of
from twin.predict.effect_forces import middles, plain_forces
from twin.predict.motion import motion_of
from twin.recording import open_log


def test_a_saved_law_pushes_as_the_products_that_were_fitted(tmp_path):
    platform = load_platform("sads")
    run = tmp_path / "run.rrd"
    fly = ["run", "sads", "--controller", "quaternion_pd", "--duration", "20"]
    assert main([*fly, "--rrd", str(run)]) == 0
    log = open_log(run).without_truth()
    body = body_of(compile_model(platform), log, motion_of(log, platform))
    seed = int(np.random.SeedSequence().entropy % 2**32)
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    every = laws_of([body])
    chosen = [every[i] for i in rng.choice(len(every), 12, replace=False)]
    chosen = tuple(law for law in chosen if "time" not in law.factors)
    sizes = rng.uniform(-3.0, 3.0, len(chosen))
    write_law(Equation(chosen, sizes, 0.1 * np.abs(sizes), 1e3), platform, tmp_path / "law.py")
    kind = effect_named(str(tmp_path / "law.py"))
    effect = kind.typical("")
    assert isinstance(effect, BodyEffect)
    np.testing.assert_allclose(effect.values, sizes, rtol=1e-8)
    wanted = sum(
        size * law.perturbation.force(body) for size, law in zip(sizes, chosen, strict=True)
    )
    law = effect.torque(platform)
    assert law is not None
    machine, (here, _) = body.machine, plain_forces(body)
    base, wheels = machine.base_dof, machine.wheel_dof
    rate = here.velocity
    torque = law(
        State(here.position[:, machine.base_qpos], rate[:, base], rate[:, wheels], middles(body))
    )
    # nine digits of each size, of which the terms may cancel
    np.testing.assert_allclose(
        torque, wanted.reshape(len(torque), -1)[:, base], atol=1e-7 * np.abs(wanted).max()
    )
