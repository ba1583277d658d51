"""A unit of three gyros that is turned with one of its axes up or down on the rate table.

    y = M(T)·Ω + b(T) + n,    M(T) = M + M'·(T − T0),    b(T) = b + b'·(T − T0)

with Ω the rate about the axes of the housing [deg/s] and y the stated rates. The rows of M are the outputs: its
diagonal holds the scale factors, the rest the misalignment (Ferraris, Grimaldi, Parvis, Sensors and Materials 7, 1995).
In the position "x up" the y axis points north at the table's angle 0; "y up" and "z up" follow by cyclic exchange of
the axes, and "down" turns the unit about the axis that points north. Not modelled: filters, sensitivity to
acceleration, changes of the bias between two mountings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.mounting import AxisPosition, vertical
from benchctl_instruments.physics.gyro import earth_rate_dps, horizontal_earth_rate_dps

_LENGTHS = {"matrix": 9, "matrix_per_c": 9, "bias_dps": 3, "bias_dps_per_c": 3}


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreeAxisParameters:
    """A unit of the STIM300 class; every default is assumed. Matrices are written row by row, nine numbers.

    `arw_deg_per_sqrt_h` is the angle random walk of each axis, as in `physics.gyro`.
    """

    matrix: tuple[float, ...] = (1.0008, 2.1e-3, -1.2e-3, -0.9e-3, 0.9994, 1.7e-3, 0.6e-3, -2.4e-3, 1.0003)
    matrix_per_c: tuple[float, ...] = (4e-5, 0.0, 3e-6, 0.0, -3e-5, 0.0, -2e-6, 0.0, 2e-5)
    bias_dps: tuple[float, ...] = (0.012, -0.020, 0.008)
    bias_dps_per_c: tuple[float, ...] = (2e-4, -1e-4, 3e-4)
    T0_c: float = 20.0
    arw_deg_per_sqrt_h: float = 0.15

    def __post_init__(self) -> None:
        for item in fields(self):
            values = getattr(self, item.name)
            if (length := _LENGTHS.get(item.name)) is not None and len(values) != length:
                raise UsageError(f"{item.name} has {len(values)} numbers; give {length}")

    def output_dps(self, sensed_dps: FloatArray, celsius: FloatArray) -> FloatArray:
        """Return the outputs without noise for rates about the axes of the housing, both of shape (n, 3)."""
        warmer_c = celsius[:, np.newaxis] - self.T0_c
        at_T0, per_c = (np.reshape(matrix, (3, 3)).T for matrix in (self.matrix, self.matrix_per_c))
        drift = warmer_c * (sensed_dps @ per_c + np.array(self.bias_dps_per_c))
        output: FloatArray = sensed_dps @ at_T0 + np.array(self.bias_dps) + drift
        return output


def sensed_rates_dps(
    position: AxisPosition, rate_dps: FloatArray, angle_deg: FloatArray, latitude_deg: float
) -> FloatArray:
    """Return the rates about the axes of the housing, shape (n, 3), for the table's rates and angles, shape (n,)."""
    axis, sign = vertical(position)
    north_dps, heading = horizontal_earth_rate_dps(latitude_deg), np.radians(angle_deg)
    sensed = np.empty((rate_dps.size, 3))
    sensed[:, axis] = sign * (rate_dps + earth_rate_dps(latitude_deg))
    sensed[:, (axis + 1) % 3] = north_dps * np.cos(heading)
    sensed[:, (axis + 2) % 3] = -sign * north_dps * np.sin(heading)
    return sensed


def noise_deviation_dps(parameters: ThreeAxisParameters, interval_s: float) -> float:
    """Return the standard deviation [deg/s] of white noise averaged over one sample interval [s]."""
    return parameters.arw_deg_per_sqrt_h / 60.0 / math.sqrt(interval_s)
