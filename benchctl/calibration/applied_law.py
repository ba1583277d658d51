"""A law with all its numbers, ready for use: from volts and a temperature to the sensed rate, and back.

With ΔT = T − T0, x = (U − U0 − Σ c_i·ΔT^i)/K0, k_T = 1 + Σ a_i·ΔT^i and k_ω(z) = 1 + Σ b_i·z^(2i):

| law        | rate                                                                          |
|------------|-------------------------------------------------------------------------------|
| sine       | ω = asin(S·x/k_T)/S                                                           |
| polynomial | ω = x·k_T·k_ω(x), and again from ω by the factors of every further stage      |
| response   | the ω with ω·k_ω(ω) = x/k_T                                                   |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from benchctl.calibration.compensation import bias
from benchctl.calibration.model import factor
from benchctl.calibration.odd_inverse import odd_inverse

FloatArray = npt.NDArray[np.float64]
LawName = Literal["sine", "polynomial", "response"]

_WIDENINGS = 80
_WIDER = 1.1
_HALVINGS = 120


@dataclass(frozen=True, slots=True, kw_only=True)
class Factors:
    """The coefficients of one stage: `k_t` of ΔT, ΔT², … [°C^-i], `k_omega` of ω², ω⁴, … [(°/s)^-2i]."""

    k_t: tuple[float, ...]
    k_omega: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class AppliedLaw:
    """One of the laws above; `bias` are the c_i [V/°C^i], `S_rad_per_dps` is 0 where the law is no sine.

    A sine has `k_t` alone, in one stage, as a response has its factors. The rate is that at the output's stamp less
    `delay_s`.
    """

    name: LawName
    K0_v_per_dps: float
    U0_v: float
    T0_c: float
    bias: tuple[float, ...]
    S_rad_per_dps: float
    stages: tuple[Factors, ...]
    delay_s: float

    @property
    def knows_temperature(self) -> bool:
        """Whether the rate depends on the temperature at all."""
        return bool(self.bias) or any(stage.k_t for stage in self.stages)

    def rate_dps(self, volts: FloatArray, celsius: FloatArray) -> FloatArray:
        """Sensed rate [°/s] of outputs [V] at temperatures [°C], of one shape (n,); NaN where the law has no rate."""
        with np.errstate(all="ignore"):
            dt = celsius - self.T0_c
            x = (volts - self.U0_v - bias(self.bias, dt)) / self.K0_v_per_dps
            if self.name == "sine":
                sine = self.S_rad_per_dps * x / factor(self.stages[0].k_t, dt)
                return np.asarray(np.arcsin(sine) / self.S_rad_per_dps)
            if self.name == "response":
                return odd_inverse(self.stages[0].k_omega, x / factor(self.stages[0].k_t, dt))
            for stage in self.stages:
                x = x * factor(stage.k_t, dt) * factor(stage.k_omega, x**2)
            return np.asarray(x)

    def volts(self, rate_dps: FloatArray, celsius: FloatArray) -> FloatArray:
        """The output nearest to the bias with just these rates, by bisection; arrays of one shape (n,).

        Where the law does not reach a rate it is the output at which its rates end.
        """
        zero = self.U0_v + bias(self.bias, celsius - self.T0_c)
        step = np.copysign(self.K0_v_per_dps, rate_dps * self.K0_v_per_dps)
        low, high = np.zeros_like(rate_dps), 0.25 * np.abs(rate_dps)

        def short(indicated: FloatArray) -> npt.NDArray[np.bool_]:
            return np.abs(self.rate_dps(zero + step * indicated, celsius)) < np.abs(rate_dps)

        for _ in range(_WIDENINGS):
            high = np.where(short(high), _WIDER * high, high)
        _bisect(short, low, high)
        return np.asarray(zero + step * low)


def _bisect(short: Callable[[FloatArray], npt.NDArray[np.bool_]], low: FloatArray, high: FloatArray) -> None:
    """Move `low` up to the last place that is short, in place."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = short(middle)
        low[below], high[~below] = middle[below], middle[~below]
