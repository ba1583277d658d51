"""An ideal converter: volts to unsigned codes and back; volts outside the range are clipped.

With b bits over ±R the step is q = 2R / 2^b and

    code  = floor((u + R) / q + 1/2), clipped to 0 ... 2^b - 1
    volts = code · q - R

so that zero volts has its own code, 2^(b-1), and the range ends one step below +R. A voltage within the range is
reproduced within q/2; the error has the standard deviation q/√12 if the voltage varies over many steps.
"""

from __future__ import annotations

import numpy as np

from benchctl_instruments.arrays import FloatArray, IntArray


def codes_from_volts(volts: FloatArray, *, range_v: float, bits: int = 16) -> IntArray:
    """Return the nearest codes, of the same shape; volts beyond ±`range_v` get the extreme code of their side."""
    codes = np.floor(volts * (2.0**bits / (2.0 * range_v)) + (2.0 ** (bits - 1) + 0.5))
    return np.clip(codes, 0.0, 2.0**bits - 1.0).astype(np.int64)


def volts_from_codes(codes: IntArray, *, range_v: float, bits: int = 16) -> FloatArray:
    """Return the volts of codes, of the same shape."""
    step_v = np.float64(2.0 * range_v / 2.0**bits)
    return codes * step_v - range_v
