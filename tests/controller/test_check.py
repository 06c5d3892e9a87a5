"""The public check of a law: it passes good ones and names what is wrong with each bad one."""

import re
from pathlib import Path

import pytest

from twin.controller import check_controller, load_controller
from twin.errors import ControllerError, UnknownName
from twin.library import controller_names
from twin.platform import load_platform

GOOD = '''
import time as clock
from dataclasses import dataclass, field
import numpy as np
from twin.controller import Controller

CALLS = []

@dataclass(frozen=True)
class Damper(Controller[np.ndarray]):
    """Torque against the rate, with a leaky sum of it."""

    gain: float = field(default=2.0, metadata={"unit": "N m s"})

    def init(self, platform, n):
        return np.zeros((n, 3))

    def update(self, state, estimate, target, time):
        torque = self.gain * estimate.rate_body
        state = 0.9 * state + torque
        return {"command_wheel_torque": torque + state}, state
'''
TORQUE = "        torque = self.gain * estimate.rate_body\n"
STATE = "        state = 0.9 * state + torque\n"
RETURN = '        return {"command_wheel_torque": torque + state}, state\n'

BROKEN = {
    "misspelt command": (RETURN, RETURN.replace("wheel", "weel"), "did you mean 'command_wheel_t"),
    "no state returned": (RETURN, RETURN.replace(", state\n", "\n"), "update returns a dict, not"),
    "no return": (RETURN, "", "update returns a NoneType, not"),
    "array for a command": (RETURN, "        return torque, state\n", "is a ndarray, not a dict"),
    "batch axis lost": (
        RETURN,
        RETURN.replace("torque + state", "(torque + state).squeeze()"),
        r"has shape \(3,\), not \(1, 3\): the batch axis comes first",
    ),
    "a list": (
        RETURN,
        RETURN.replace("torque + state", "(torque + state).tolist()"),
        "is of type list, not a float64 array",
    ),
    "single precision": (
        RETURN,
        RETURN.replace("torque + state", "(torque + state).astype(np.float32)"),
        "is of type float32",
    ),
    "nan at rest": (
        TORQUE,
        TORQUE + "        torque /= np.linalg.norm(torque, axis=-1, keepdims=True)\n",
        "holds nan though all it was given is finite",
    ),
    "init raises": (
        "        return np.zeros((n, 3))\n",
        "        return np.zeros((n, platform.wheel_count))\n",
        "init fails with n = 1: line 16: AttributeError: 'Platform' object has no",
    ),
    "update raises": (TORQUE, TORQUE.replace("rate_body", "rate"), "line 19: AttributeError"),
    "refuses the platform": (
        "        return np.zeros((n, 3))\n",
        "        from twin.errors import ControllerError\n"
        "        raise ControllerError('needs a sail')\n",
        r"refuses sads \(needs a sail\): check it on another \(--platform\)",
    ),
    "clock": (TORQUE, TORQUE.replace("self.gain", "clock.time()"), "the same call twice"),
    "random numbers": (
        TORQUE,
        TORQUE + "        torque = torque + np.random.default_rng().normal()\n",
        "the same call twice",
    ),
    "memory in a global": (
        TORQUE,
        "        CALLS.append(1)\n        torque = len(CALLS) * estimate.rate_body\n",
        "the same call twice",
    ),
    "memory on self": (
        TORQUE,
        "        object.__setattr__(self, 'gain', self.gain + 1.0)\n" + TORQUE,
        "the same call twice",
    ),
    "state changed": (STATE, "        state += torque\n", "changes the state it is given"),
    "estimate changed": (
        TORQUE,
        "        torque = estimate.rate_body\n        torque *= 2.0\n",
        "changes estimate.rate_body in place",
    ),
    "target changed": (
        TORQUE,
        TORQUE + "        target.attitude[0] = -1.0\n",
        "changes target.attitude in place",
    ),
    "norm over the batch": (
        TORQUE,
        TORQUE + "        torque = torque / (1.0 + np.linalg.norm(torque))\n",
        "changes with what happens to another run",
    ),
    "branch over the batch": (
        TORQUE,
        TORQUE + "        if (torque > 3.0).any():\n            torque = 0.5 * torque\n",
        "changes with what happens to another run",
    ),
    "other answer alone": (
        TORQUE,
        TORQUE + "        if len(torque) == 1:\n            torque = 0.5 * torque\n",
        "a run alone gets another command",
    ),
    "loop over runs": (
        TORQUE,
        "        torque = np.array([self.gain * rate for rate in estimate.rate_body])\n",
        "it loops over the runs",
    ),
    "np.vectorize": (
        TORQUE,
        "        torque = np.vectorize(lambda rate: self.gain * rate)(estimate.rate_body)\n",
        "it loops over the runs",
    ),
    "not frozen": ("(frozen=True)", "", "can change while it flies"),
    "gain without unit": (', metadata={"unit": "N m s"}', "", "gain has no unit: declare"),
    "state of a local class": (
        "        return np.zeros((n, 3))\n",
        "        class Memory(np.ndarray): pass\n        return np.zeros((n, 3)).view(Memory)\n",
        "its state cannot be saved",
    ),
}


@pytest.fixture
def write(tmp_path):
    def write(text) -> Path:
        path = tmp_path / "law.py"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("name", controller_names())
def test_every_shipped_law_keeps_the_contract(name):
    assert check_controller(name) == []


def test_good_law_passes_by_path_by_object_and_again(write):
    path = write(GOOD)
    assert check_controller(path) == []
    law = load_controller(str(path), {"gain": 4.0})
    assert check_controller(law, load_platform("sads:table1")) == []
    assert check_controller(law) == []


@pytest.mark.parametrize(
    ("right", "wrong", "sentence"),
    BROKEN.values(),
    ids=BROKEN,
)
def test_each_broken_promise_is_named(write, right, wrong, sentence):
    assert right in GOOD
    findings = check_controller(write(GOOD.replace(right, wrong, 1)))
    assert len(findings) == 1, findings
    assert re.search(sentence, findings[0]), findings[0]


def test_columns_for_another_machine_are_told_with_the_parts_of_this_one(write):
    fourth = RETURN.replace("torque + state", "np.hstack([torque, torque[:, :1]])")
    (finding,) = check_controller(write(GOOD.replace(RETURN, fourth)))
    assert "command_wheel_torque has 4 columns, and sads has 3 wheels (w1, w2, w3): " in finding
    assert "--platform" in finding
    assert "batch axis" not in finding
    tas2 = load_platform("tas2")
    stages = RETURN.replace("wheel_torque", "stage_position").replace("+ state", "[:, :1]")
    (finding,) = check_controller(write(GOOD.replace(RETURN, stages)), tas2)
    assert f"has 1 column, and tas2 has {len(tas2.stages)} stages" in finding


def test_several_broken_promises_are_all_named(write):
    text = GOOD.replace(STATE, "        state += torque\n").replace("(frozen=True)", "")
    findings = check_controller(write(text))
    assert len(findings) == 2, findings


def test_law_that_cannot_be_loaded_raises(write):
    with pytest.raises(UnknownName):
        check_controller("no_such_law")
    with pytest.raises(ControllerError, match="defines 0 subclasses"):
        check_controller(write(""))
