"""The laws that tie rate, temperature and output together, forwards and backwards.

| law        | equation, ΔT = T − T0                                        | convention   | argument    |
|------------|--------------------------------------------------------------|--------------|-------------|
| sine       | u = (K0/S)·(1 + g1ΔT + g2ΔT² …)·sin(S·ω)                       | response     | true        |
| polynomial | ω = x·(1 + a1ΔT + …)·(1 + b2x² + b4x⁴ + …), x = u/K0          | correction   | indicated   |
| response   | u = K0·(1 + a1ΔT + …)·(1 + b2ω² + b4ω⁴ + …)·ω                 | response     | true        |

u is the output less its bias. The sine is that of an open-loop interferometer (S in rad per °/s); the polynomial is the
paper's. With no term in T or ω all three are a straight line. Bias: U0 + c1ΔT + c2ΔT² ….
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchctl.calibration.result import Argument, Convention
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

_NEWTON_STEPS = 30
_CONVERGED_DPS = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """A law with its orders; the parameters are K0 [V/(°/s)], then S or b2, b4, …, then the terms in temperature.

    `rate_terms` is 1 for the sine (S), 0 … 3 for the polynomials; `temperature_terms` 0 … 3.
    """

    name: str
    rate_terms: int
    temperature_terms: int

    @property
    def convention(self) -> Convention:
        """Whether k corrects the indicated rate or is the gyro's response."""
        return "correction" if self.name == "polynomial" else "response"

    @property
    def argument(self) -> Argument:
        """The rate that k(ω) is a function of."""
        return "indicated" if self.name == "polynomial" else "true"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, with units where they are not those of a coefficient."""
        letter = "g" if self.name == "sine" else "a"
        rate = ("S_rad_per_dps",) if self.name == "sine" else tuple(f"b{2 * i + 2}" for i in range(self.rate_terms))
        return ("K0_v_per_dps", *rate, *(f"{letter}{i + 1}" for i in range(self.temperature_terms)))

    @property
    def scales(self) -> FloatArray:
        """Sizes that make the parameters comparable, shape (p,): a change of order 1 at 100 °/s or 30 °C."""
        rate = [1e-3] if self.name == "sine" else [100.0 ** -(2 * i + 2) for i in range(self.rate_terms)]
        return np.array([1e-2, *rate, *(30.0 ** -(i + 1) for i in range(self.temperature_terms))])

    def start(self, K0_v_per_dps: float) -> FloatArray:
        """Where a fit may begin, shape (p,): a straight line, or a gently bent one."""
        parameters = np.zeros(len(self.names))
        parameters[0] = K0_v_per_dps
        if self.name == "sine":
            parameters[1] = 3e-3
        return parameters

    def volts(self, parameters: FloatArray, rate_dps: FloatArray, dt_c: FloatArray) -> FloatArray:
        """Output less its bias at a true rate, V; arrays of one shape."""
        gain = parameters[0]
        warm = factor(parameters[1 + self.rate_terms :], dt_c)
        bend = parameters[1 : 1 + self.rate_terms]
        if self.name == "sine":
            return np.asarray(gain * warm * np.sin(bend[0] * rate_dps) / bend[0])
        if self.name == "response":
            return np.asarray(gain * warm * rate_dps * factor(bend, rate_dps**2))
        return np.asarray(gain * _solve_odd(bend, rate_dps / warm))

    def rate(self, parameters: FloatArray, volts: FloatArray, dt_c: FloatArray) -> FloatArray:
        """True rate at an output less its bias, °/s; NaN beyond what the law can give (sine: |S·x| > 1)."""
        indicated = volts / parameters[0]
        warm = factor(parameters[1 + self.rate_terms :], dt_c)
        bend = parameters[1 : 1 + self.rate_terms]
        if self.name == "sine":
            argument = bend[0] * indicated / warm
            inside = np.abs(argument) <= 1.0
            return np.where(inside, np.arcsin(np.where(inside, argument, 0.0)) / bend[0], np.nan)
        if self.name == "response":
            return _solve_odd(bend, indicated / warm)
        return np.asarray(indicated * warm * factor(bend, indicated**2))

    def volts_and_slopes(
        self, parameters: FloatArray, rate_dps: FloatArray, dt_c: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Volts (n,), their derivatives by the parameters (n, p) and by the rate (n,), by central differences."""
        value = self.volts(parameters, rate_dps, dt_c)
        slopes = np.empty((rate_dps.size, parameters.size))
        for i, scale in enumerate(self.scales):
            # Largest where the law is linear in the parameter, so that nothing is lost to rounding.
            step = np.zeros(parameters.size)
            step[i] = 1e-4 * (abs(parameters[i]) if i == 0 else scale)
            up, down = self.volts(parameters + step, rate_dps, dt_c), self.volts(parameters - step, rate_dps, dt_c)
            slopes[:, i] = (up - down) / (2 * step[i])
        by_rate = (self.volts(parameters, rate_dps + 0.01, dt_c) - self.volts(parameters, rate_dps - 0.01, dt_c)) / 0.02
        return value, slopes, by_rate


def factor(coefficients: Sequence[float] | FloatArray, argument: FloatArray) -> FloatArray:
    """1 + c1·z + c2·z² + …; z is ΔT, or ω² for a factor in even powers."""
    total = np.zeros_like(argument, dtype=np.float64)
    for coefficient in reversed(list(coefficients)):
        total = (total + coefficient) * argument
    return np.asarray(1.0 + total)


def _solve_odd(bend: FloatArray, target: FloatArray) -> FloatArray:
    """The x with x·(1 + b2x² + b4x⁴ + …) = target, by Newton from the target.

    Raises `UsageError` where the polynomial turns over before it reaches the target: there is no such rate.
    """
    if bend.size == 0:
        return target
    x = np.array(target, dtype=np.float64)
    slopes = bend * (2 * np.arange(bend.size) + 3)
    reach = max(float(np.max(np.abs(target), initial=0.0)), 1.0)
    for _ in range(_NEWTON_STEPS):
        square = x * x
        change = (x * factor(bend, square) - target) / np.maximum(factor(slopes, square), 0.05)
        x -= np.clip(change, -reach, reach)
        if float(np.max(np.abs(change), initial=0.0)) < _CONVERGED_DPS:
            return x
    raise UsageError(
        f"k(ω) with coefficients {', '.join(f'{b:.3g}' for b in bend)} has no rate for an indication of "
        f"{float(np.max(np.abs(target))):.4g} deg/s: it is used beyond its range; "
        "use it inside `valid`, or the sine law"
    )


EARTH_DPS = 15.041 / 3600.0
"""The Earth's rotation against the stars, °/s."""


def earth_rate_dps(latitude_deg: float | None) -> float:
    """Component along a vertical axis, positive counter-clockwise from above in the north; 0 where not known."""
    return 0.0 if latitude_deg is None else float(EARTH_DPS * np.sin(np.deg2rad(latitude_deg)))
