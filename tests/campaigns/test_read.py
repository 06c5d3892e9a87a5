"""A specification that cannot be flown is refused with a sentence, before any run starts."""

import math
import re

import pytest

from tests.campaigns.conftest import GOOD
from twin.cli.main import main
from twin.errors import CampaignError

BROKEN = {
    "no platform": ('platform = "cubesat"\n', "", "platform is missing; add it"),
    "unknown platform": ('"cubesat"', '"cubesatt"', r"platform is 'cubesatt'.*did you mean"),
    "unknown variant": ('"cubesat"', '"cubesat:gold"', "platform is 'cubesat:gold'.*gold"),
    "no controller": ('controller = "mass_magnetic_pid"\n', "", "controller is missing"),
    "unknown law": ("mass_magnetic_pid", "mass_magic_pid", "controller is .*did you mean"),
    "law that cannot drive it": ("mass_magnetic_pid", "quaternion_pd", "0 wheels"),
    "unknown estimator": ('"passthrough"', '"kalman"', "estimator is 'kalman'"),
    "estimator without sensors": ('"passthrough"', '"inclinometer"', "and cubesat has none"),
    "unknown reference": ("seed = 3", 'seed = 3\nreference = "loop"', "no reference named 'loop'"),
    "no runs": ("runs = 24\n", "", "runs is missing"),
    "half a run": ("runs = 24", "runs = 24.5", "runs is 24.5; give a whole number"),
    "runs below one": ("runs = 24", "runs = 0", "runs is 0; it must lie between 1"),
    "runs as text": ("runs = 24", 'runs = "24"', "runs is '24'; give a number"),
    "runs that no grid divides": ("runs = 24", "runs = 25", "no multiple of the 2 comb.*give 24"),
    "no duration": ("duration = 1.0\n", "", "duration is missing"),
    "duration of nothing": ("duration = 1.0", "duration = 0", "duration is 0 s; give a time"),
    "steady longer than the run": ("seed = 3", "seed = 3\nsteady = 2.0", "steady is 2 s"),
    "no seed": ("seed = 3\n", "", "seed is missing"),
    "seed below zero": ("seed = 3", "seed = -3", "seed is -3; it must be at least 0"),
    "unknown sampling": ('"sobol"', '"halton"', "sampling is 'halton'; use one of"),
    "distribution on a grid": ('"sobol"', '"grid"', "sampling is 'grid', but .* distribution"),
    "shard of one run": ("shard = 6", "shard = 1", "shard is 1; it must lie between 2"),
    "misspelt key": ("seed = 3", "seed = 3\nmetric = []", "metric is no key we know.*'metrics'"),
    "unknown metric": ("seed = 3", 'seed = 3\nmetrics = ["tilt"]', "holds 'tilt', no metric"),
    "unknown metric with a bracket": (
        "seed = 3", 'seed = 3\nmetrics = ["tilt(rms)"]',
        "no metric we know; did you mean 'tilt_rms'"),
    "metric of another machine": (
        "seed = 3", 'seed = 3\nmetrics = ["wheel_momentum_max"]', "this campaign does not have"),
    "no metric": ("seed = 3", "seed = 3\nmetrics = []", "metrics is empty"),
    "unknown gain": ("derivative = {", "derivation = {", "gains.derivation is no gain.*derivative"),
    "unknown gain with a bracket": ("derivative = {", "'derivative(s)' = {",
                                    r"no gain of \w+; did you mean 'derivative'"),
    "gain without a value": ("{ grid = [1e-3, 2e-3] }", "{ }", "derivative has no distribution"),
    "two distributions": (
        "{ grid = [1e-3, 2e-3] }", "{ grid = [1.0], normal = [1.0, 2.0] }",
        "has normal and grid; give one of"),
    "value twice on a grid": ("[1e-3, 2e-3] }", "[1e-3, 1e-3] }", "grid has a value twice"),
    "unknown effect": ("[effects.gyro_bias]", "[effects.gyro_byas]", "'gyro_byas'.*did you mean"),
    "unknown parameter": ("[effects.gyro_bias]", "[effects.gyro_bias]\nbios = 1.0",
                          "effects.gyro_bias.bios is no key we know; did you mean 'bias'"),
    "effect out of bounds": ("[5e-6, 2e-5]", "[-5e-6, 2e-5]", "uniform holds -5e-06 m; it must"),
    "distribution upside down": ("[5e-6, 2e-5]", "[2e-5, 5e-6]", "give the lower value first"),
    "distribution of three": ("[5e-6, 2e-5]", "[1e-6, 5e-6, 2e-5]", "give two values"),
    "decades from zero": ("{ uniform = [5e-6", "{ log_uniform = [0.0", "decades begin above 0"),
    "deviation of nothing": ("{ uniform = [5e-6, 2e-5] }", "{ normal = [1e-5, 0.0] }",
                             "standard deviation of 0 m; give one above 0"),
    "effect without its part": ("[effects.gyro_bias]", "[effects.wheel_friction]",
                                "no wheel"),
    "clock that differs": ("[effects.gyro_bias]", "[effects.clock_lag.gyro]",
                           "share one sampling schedule.*give it one value"),
    "misspelt start": ("hangs = true", "atitude = 0", "atitude is no key.*mean 'attitude'"),
    "unknown start": ("hangs = true", "hungs = true", "hungs is no key we know.*'hangs'"),
    "start with too few numbers": ("hangs = true", "hangs = true\nrate = [1.0]",
                                   "give 3 numbers in rad/s"),
    "vector on a grid": ("hangs = true", "rate = { grid = [1.0] }", "is a vector on a grid"),
    "arm without a name": ("[gains]", '[[arms]]\ncontroller = "free_float"\n[gains]',
                           "name is missing"),
    "arms of one name": ("[gains]", '[[arms]]\nname = "a"\n[[arms]]\nname = "a"\n[gains]',
                         "'a' is that of 2 arms"),
    "arm with a key of the campaign": ("[gains]", '[[arms]]\nname = "a"\nruns = 3\n[gains]',
                                       "arms.runs is no key of an arm"),
    "kept run beyond the last": ("[gains]", "[keep]\nruns = [24]\n[gains]", "runs holds 24"),
    "worst by an unknown metric": ("[gains]", '[keep]\nworst = 2\nby = "x"\n[gains]',
                                   "keep.by is 'x'"),
    "worst by an unknown metric with a bracket": (
        "[gains]", '[keep]\nworst = 2\nby = "tilt(rms)"\n[gains]',
        "no metric of this campaign; did you mean 'tilt_rms'"),
    "worst by nothing": ("[gains]", "[keep]\nworst = 2\n[gains]", "say by which: by = "),
    "by without a number": ("[gains]", '[keep]\nby = "tilt_rms"\n[gains]', "add worst = 10"),
    "more worst than runs": ("[gains]", '[keep]\nworst = 25\nby = "tilt_rms"\n[gains]',
                             "worst is 25; the campaign has 24 runs"),
    "reference of a balancing": (
        "seed = 3", 'seed = 3\nprocedure = "balance"\nreference = "hold:1,0,0"',
        "reference is of a run"),
    "vector spread by too few": (
        "hangs = true", "rate = { uniform = [[-1e-3, -1e-3], [1e-3, 1e-3]] }",
        "each a number or a list of 3"),
    "spread beyond a float": (
        "hangs = true", f"rate = {{ uniform = [0, 1{'0' * 400}] }}", "give two values, lowest"),
    "gains of a balancing": ("runs = 24", 'runs = 24\nprocedure = "balance"',
                             "controller is 'mass_magnetic_pid', no way of balancing"),
    "target of a run": ("seed = 3", "seed = 3\ntarget = 1e-5", "target is of a balancing"),
    "misspelt keys, before one is missing": (
        "controller =", "keeps = 1\ncontroler =",
        "keeps is no key we know; did you mean 'keep'.*Nor is controler .line 5."),
    "misspelt table": ("[gains]", "[gain]", "gain is no key we know; did you mean 'gains'"),
    "duration with its unit": ("duration = 1.0", 'duration = "60 s"', "give a number in s"),
    "duration below a tick": ("duration = 1.0", "duration = 0.01", "give a tick of 0.05 s"),
    "seed that no float holds": ("seed = 3", "seed = 9007199254740993", "seed is 900719925474099"),
    "gain as a list": ("{ grid = [1e-3, 2e-3] }", "[1.0, 2.0]", "give a number in N m s"),
    "effect without a table": (
        "[effects.gyro_bias]", "[effects]\ngyro_bias = 1e-3", r"make it a table: \[effects.gyro"),
    "misspelt distribution": ("{ uniform = [5e-6", "{ unifrom = [5e-6", "has no distribution"),
    "mean and deviation by name": (
        "{ uniform = [5e-6, 2e-5] }", "{ normal = { mean = 1.0 } }", "give two values, mean and"),
    "arms as one table": ("[gains]", '[arms]\nname = "a"\n[gains]', r"make it tables: \[\[arms"),
    "gain of an arm, spread": (
        "[gains]", '[[arms]]\nname = "a"\n[arms.gains]\nproportional = { grid = [1.0] }\n[gains]',
        "arms.gains.proportional is .*give a number"),
    "stream that is none": (
        "[effects.gyro_bias]", "[effects.clock_lag.gyroo]\nlag = 0.1",
        "'gyroo' is none of its streams[^;]*; remove it$"),
    "degrees": ("hangs = true", "attitude = { uniform = [-10, 10] }",
                "goes to -10 rad in roll; .*angles are in radians"),
    "deviation in degrees": (
        "hangs = true", "attitude = { normal = [0, 3.0] }", "to -3 rad in roll"),
    "mass beyond its travel": ("hangs = true", "stage_position = 1.0", "1 m in .*its travel is -0"),
    "no TOML": ("seed = 3", "seed = ", "mend the TOML"),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_specification_is_refused_with_its_sentence(case, spec_of):
    old, new, sentence = BROKEN[case]
    with pytest.raises(CampaignError) as refused:
        spec_of((old, new))
    said = str(refused.value)
    assert re.search(sentence, said, re.DOTALL), said
    assert re.match(r".*spec\.toml(:\d+)?: ", said), "names its file"
    assert "; " in said, "says what would do"


def test_the_line_of_the_mistake_is_named(spec_of):
    with pytest.raises(CampaignError) as refused:
        spec_of(("[5e-6, 2e-5]", "[-5e-6, 2e-5]"))
    line = 1 + GOOD.split("\n").index("width = { uniform = [5e-6, 2e-5] }")
    assert f"spec.toml:{line}: effects.stage_backlash.width" in str(refused.value)


def test_a_normal_start_is_cut_off_where_the_machine_ends(spec_of):
    spec = spec_of(("hangs = true", "attitude = { normal = [0, 0.1] }"))
    roll, pitch, yaw = spec.initial.factors["attitude"]
    stop = spec.arms[0].platform.stop_angle
    assert roll.distribution.ends == pitch.distribution.ends == (-stop, stop)
    assert yaw.distribution.ends == (-math.inf, math.inf)


def test_an_effect_is_dispersed_as_its_own_metadata_say_unless_told(spec_of):
    words = {factor.name: factor.distribution.words() for factor in spec_of().factors}
    assert words["effects.gyro_bias.bias_x"] == "0 +- 0.001"
    assert words["effects.bearing_viscous_friction.damping"] == "between 0 and 0.002"
    assert words["effects.stage_backlash.width"] == "between 5e-06 and 2e-05"
    assert "effects.stage_vibration.gain" not in words, "the platform's own stays as stated"


def test_command_line_refuses_a_broken_specification_and_writes_nothing(tmp_path, capsys):
    path = tmp_path / "broken.toml"
    path.write_text(GOOD.replace("seed = 3", "sed = 3"), encoding="utf-8")
    assert main(["campaign", str(path), str(tmp_path / "out")]) == 1
    assert "sed is no key we know; did you mean 'seed'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main(["campaign", str(path)]) == 2
