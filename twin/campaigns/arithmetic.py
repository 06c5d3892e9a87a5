"""How this machine rounds: processors with other vector units come to other last bits.

NumPy computes sines, exponentials and products with what a processor has, and their last bits
differ between kinds of processors. Two machines whose marks are the same fly a campaign to the
same bytes, given the same packages; two whose marks differ may not.
"""

import hashlib

import numpy as np

_FUNCTIONS = (np.sin, np.cos, np.tan, np.arcsin, np.arctan, np.exp, np.log1p, np.tanh, np.cbrt)
_ARGUMENTS = np.linspace(-0.999, 0.999, 1001)


def arithmetic() -> str:
    """A mark of it."""
    result = hashlib.sha256()
    for function in _FUNCTIONS:
        result.update(function(_ARGUMENTS).tobytes())
    square = _ARGUMENTS[:900].reshape(30, 30)
    result.update(
        (square @ square).tobytes() + np.linalg.solve(square + np.eye(30), square).tobytes()
    )
    return result.hexdigest()[:12]
