"""Numbers as people write them down."""

from __future__ import annotations

import math

from benchctl.reports import text

_PLAIN_POWER = 5
"""Powers of ten up to which a number is written out."""


def as_written(value: float) -> str:
    """A bound or a size to three digits: `0.05`, `20000`, `5 × 10⁻⁸`, `−10⁻⁴`, `∞`."""
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    mantissa, _, exponent = f"{value:.3g}".partition("e")
    if exponent and 0 <= int(exponent) <= _PLAIN_POWER:
        return f"{value:.0f}".replace("-", "−")
    mantissa = mantissa.replace("-", "−")
    if not exponent:
        return mantissa
    power = text.raised(f"10^{int(exponent)}")
    if mantissa in ("1", "−1"):
        return mantissa.replace("1", power)
    return f"{mantissa}\u00a0×\u00a0{power}"
