"""Sessions under random faults: no wrong value is ever valid, and each ends with a reason."""

import sys

import pytest

if sys.platform == "win32":
    pytest.skip("no pseudo-terminals", allow_module_level=True)

from benchmarks.fault_devices import SUBJECTS, session


@pytest.mark.slow
@pytest.mark.wall_clock
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", SUBJECTS)
def test_random_faults_give_reasons_and_no_wrong_value(name, seed):
    found = session(name, seed)
    assert not found["problems"], found
    assert not found["undetected"], f"wrong and valid: {found}"
