"""The units that a foreign file may use, and their conversion to the unit of the benchctl channel.

A map file names the unit as in these tables; a value becomes `factor · value / divisor + offset` in the unit of the
channel. Quantities without a benchctl channel keep their unit, in CF spelling.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from benchctl_instruments.arrays import FloatArray

COUNTS = "counts"
"""An angle in counts of the encoder: its factor needs the counts per revolution."""


@dataclass(frozen=True, slots=True)
class Conversion:
    """The conversion of a unit to the unit `cf` (CF spelling): value → factor · value / divisor + offset.

    The divisor ensures that 26 ms becomes exactly the float64 0.026 s.
    """

    cf: str
    factor: float = 1.0
    offset: float = 0.0
    divisor: float = 1.0

    def apply(self, values: FloatArray) -> FloatArray:
        """Return the values, shape (n,), in the unit `cf`."""
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
"""The output of a gyro: volts, or a rate if the gyro is digital."""

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
        "N*m": "N m",
        "N·m": "N m",
        "Nm": "N m",
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
} | {"rpm": RATE["rpm"]}
"""Units of channels without a benchctl name: kept unchanged, except rpm, which becomes deg/s."""


def unit_of_column(name: str) -> str:
    """Return the CF unit that the name of a column implies (`supply_v`: V); `1` if it implies none."""
    endings = {"v": "V", "a": "A", "c": "degC", "deg": "degree", "dps": "degree s-1", "s": "s", "hz": "Hz"}
    return endings.get(name.rpartition("_")[2], "1")
