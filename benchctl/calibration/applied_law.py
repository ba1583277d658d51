"""A law with all its numbers, ready for use: from volts and a temperature to the sensed rate, and back.

With ΔT = T − T0, x = (U − U0 − Σ c_i·ΔT^i)/K0, k_T = 1 + Σ a_i·ΔT^i and k_ω(z) = 1 + Σ b_i·z^(2i):

| law        | rate                                                                          |
|------------|-------------------------------------------------------------------------------|
| sine       | ω = asin(S·x/k_T)/S                                                           |
| polynomial | ω = x·k_T·k_ω(x), and again from ω by the factors of every further stage      |
| response   | the ω with ω·k_ω(ω) = x/k_T                                                   |
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchctl.calibration.compensation import bias
from benchctl.calibration.model import factor
from benchctl_instruments.arrays import BoolArray, FloatArray

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

        def short(indicated: FloatArray) -> BoolArray:
            return np.abs(self.rate_dps(zero + step * indicated, celsius)) < np.abs(rate_dps)

        for _ in range(_WIDENINGS):
            high = np.where(short(high), _WIDER * high, high)
        _bisect(short, low, high)
        return np.asarray(zero + step * low)


def _bisect(short: Callable[[FloatArray], BoolArray], low: FloatArray, high: FloatArray) -> None:
    """Move `low` up to the last place that is short, in place."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = short(middle)
        low[below], high[~below] = middle[below], middle[~below]


# p(x) = x·(1 + b2x² + b4x⁴ + …) is the odd polynomial that is inverted, as far as it rises.

FLATTEST, STEEPEST = 0.05, 20.0
"""Slopes of p between which it is inverted."""

FASTEST_DPS = 1e12
"""Upper bound of all rates."""

STEPS = 250
CONVERGED = 1e-15
"""The last step, relative."""

_STRAIGHT = 1e-30
"""(°/s)⁻²: a bend without effect at any rate."""

_REAL = 1e-6
"""A root with a relative imaginary part below this is a real one that rounding has split."""


def slopes(bend: Sequence[float]) -> tuple[float, ...]:
    """The coefficients of p′ = 1 + 3b2x² + 5b4x⁴ + …, as those of p."""
    return tuple((2 * i + 3) * b for i, b in enumerate(bend))


def reach(bend: Sequence[float]) -> tuple[float, float]:
    """How far p can be inverted: the first x > 0 at which it rises by less than `FLATTEST` or more than `STEEPEST`.

    Returns x, at most `FASTEST_DPS`, and p there.
    """
    size = max((abs(b) ** (1.0 / (i + 1)) for i, b in enumerate(bend)), default=0.0)
    if size < _STRAIGHT:
        return FASTEST_DPS, FASTEST_DPS
    # In w = 1/(size·x²), so that the coefficient in front is never small and none is large.
    scaled = [b / size ** (i + 1) for i, b in enumerate(slopes(bend))]
    roots = np.concatenate([np.roots([1.0 - slope, *scaled]) for slope in (FLATTEST, STEEPEST)])
    real = roots.real[(roots.real > 0.0) & (np.abs(roots.imag) <= _REAL * np.abs(roots))]
    end = min(math.sqrt(1.0 / (size * float(np.max(real, initial=_STRAIGHT)))), FASTEST_DPS)
    return end, end * float(factor(bend, np.array(end * end)))


def odd_inverse(bend: Sequence[float], target: FloatArray) -> FloatArray:
    """The x with p(x) = target, arrays of shape (n,); NaN beyond the reach of p. By Newton, kept in a bracket."""
    if not bend:
        return target
    end, most = reach(bend)
    wanted = np.abs(target)
    there = wanted <= most
    wanted = np.where(there, wanted, 0.0)
    low, high = wanted / STEEPEST, np.minimum(wanted / FLATTEST, end)
    x = np.minimum(wanted, high)
    before = np.full_like(wanted, np.inf)
    moving = np.ones_like(there)
    for _ in range(STEPS):
        square = x * x
        excess = x * factor(bend, square) - wanted
        low, high = np.where(excess > 0.0, low, x), np.where(excess > 0.0, x, high)
        newton = x - excess / factor(slopes(bend), square)
        # Newton's method alone may go to and fro for ever where p turns from flat to steep.
        trusted = (newton >= low) & (newton <= high) & (2.0 * np.abs(excess) <= before)
        following = np.where(trusted, newton, 0.5 * (low + high))
        before = np.abs(excess)
        change = np.abs(following - x)
        x = np.where(moving, following, x)
        moving &= change > CONVERGED * x
        if not bool(moving.any()):
            break
    return np.where(there, np.copysign(x, target), np.nan)
