"""The units that a foreign file may be in, and how each becomes the unit of our channel.

A map file says the unit in the words of this table; a value becomes `factor · value / divisor + offset` in the
unit of the channel. Quantities that have no channel of ours keep their unit, spelled as CF spells it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from benchctl_instruments.arrays import FloatArray

COUNTS = "counts"
"""An angle in counts of the encoder: its factor needs the counts of a revolution."""


@dataclass(frozen=True, slots=True)
class Conversion:
    """How a unit becomes the unit `cf` (CF spelling): value → factor · value / divisor + offset.

    The divisor keeps 26 ms the very 0.026 s that a reader would write.
    """

    cf: str
    factor: float = 1.0
    offset: float = 0.0
    divisor: float = 1.0

    def apply(self, values: FloatArray) -> FloatArray:
        """The values, shape (n,), in the unit `cf`."""
        return np.asarray(values * self.factor / self.divisor + self.offset, dtype=np.float64)


TIME: Mapping[str, Conversion] = {
    "s": Conversion("s"),
    "ms": Conversion("s", divisor=1e3),
    "us": Conversion("s", divisor=1e6),
    "min": Conversion("s", 60.0),
}

ANGLE: Mapping[str, Conversion] = {
    "deg": Conversion("degree"),
    "°": Conversion("degree"),
    "rad": Conversion("degree", 180.0, divisor=math.pi),
    "arcsec": Conversion("degree", divisor=3600.0),
    "rev": Conversion("degree", 360.0),
}

RATE: Mapping[str, Conversion] = {
    "deg/s": Conversion("degree s-1"),
    "°/s": Conversion("degree s-1"),
    "rad/s": Conversion("degree s-1", 180.0, divisor=math.pi),
    "deg/h": Conversion("degree s-1", divisor=3600.0),
    "rpm": Conversion("degree s-1", 6.0),
}

VOLTAGE: Mapping[str, Conversion] = {
    "V": Conversion("V"),
    "mV": Conversion("V", divisor=1e3),
    "uV": Conversion("V", divisor=1e6),
}

GYRO_OUTPUT: Mapping[str, Conversion] = {**VOLTAGE, **RATE}
"""What a gyro gives out: volts, or, a digital one, its own idea of the rate."""

TEMPERATURE: Mapping[str, Conversion] = {
    "degC": Conversion("degC"),
    "°C": Conversion("degC"),
    "K": Conversion("degC", 1.0, -273.15),
    "degF": Conversion("degC", 5.0, -160 / 9, 9.0),
}

OTHER: Mapping[str, Conversion] = {
    unit: Conversion(cf)
    for unit, cf in {
        "1": "1",
        "percent": "percent",
        "%": "percent",
        "counts": "count",
        "s": "s",
        "V": "V",
        "mV": "mV",
        "A": "A",
        "mA": "mA",
        "W": "W",
        "Hz": "Hz",
        "N m": "N m",
        "deg": "degree",
        "rad": "rad",
        "deg/s": "degree s-1",
        "rad/s": "rad s-1",
        "g": "standard_free_fall",
        "m/s2": "m s-2",
        "T": "T",
        "Pa": "Pa",
        "degC": "degC",
        "°C": "degC",
        "K": "K",
        "degF": "degF",
    }.items()
}
"""Units of channels that we have no name for: kept as they are."""


def unit_of_column(name: str) -> str:
    """The CF unit that the name of a column promises (`supply_v`: V); `1` where it promises none."""
    endings = {"v": "V", "a": "A", "c": "degC", "deg": "degree", "dps": "degree s-1", "s": "s", "hz": "Hz"}
    return endings.get(name.rpartition("_")[2], "1")
