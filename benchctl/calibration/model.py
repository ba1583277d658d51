"""The laws that relate rate, temperature and output, forwards and backwards.

| law        | equation, ΔT = T − T0                                        | convention   | argument    |
|------------|--------------------------------------------------------------|--------------|-------------|
| sine       | u = (K0/S)·(1 + g1ΔT + g2ΔT² …)·sin(S·ω)                       | response     | true        |
| polynomial | ω = x·(1 + a1ΔT + …)·(1 + b2x² + b4x⁴ + …), x = u/K0          | correction   | indicated   |
| response   | u = K0·(1 + a1ΔT + …)·(1 + b2ω² + b4ω⁴ + …)·ω                 | response     | true        |

u is the output minus its bias. The sine is that of an open-loop interferometer (S in rad per °/s); the polynomial is
that of the paper. Without terms in T or ω all three are a straight line. Bias: U0 + c1ΔT + c2ΔT² ….

`AppliedLaw` is a law with all its numbers, ready for use: from volts and a temperature to the sensed rate, and back.
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
from dataclasses import dataclass, field

import numpy as np

from benchctl.calibration.discovered import Discovered
from benchctl.calibration.result import Argument, Convention, LawName
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.response_gyro import one_plus

_NEWTON_STEPS = 30
_CONVERGED_DPS = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """A law with its orders; the parameters are K0 [V/(°/s)], then S or b2, b4, …, then the terms in temperature.

    `rate_terms` is 1 for the sine (S), 0 … 3 for the polynomials; `temperature_terms` 0 … 3.
    """

    name: LawName
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
        """Names of the parameters; those that are not coefficients include their units."""
        letter = "g" if self.name == "sine" else "a"
        rate = ("S_rad_per_dps",) if self.name == "sine" else tuple(f"b{2 * i + 2}" for i in range(self.rate_terms))
        return ("K0_v_per_dps", *rate, *(f"{letter}{i + 1}" for i in range(self.temperature_terms)))

    @property
    def scales(self) -> FloatArray:
        """Sizes that make the parameters comparable, shape (p,): a change of order 1 at 100 °/s or 30 °C."""
        rate = [1e-3] if self.name == "sine" else [100.0 ** -(2 * i + 2) for i in range(self.rate_terms)]
        return np.array([1e-2, *rate, *(30.0 ** -(i + 1) for i in range(self.temperature_terms))])

    def start(self, K0_v_per_dps: float) -> FloatArray:
        """Return the start of a fit, shape (p,): a straight line, or a slightly bent one."""
        parameters = np.zeros(len(self.names))
        parameters[0] = K0_v_per_dps
        if self.name == "sine":
            parameters[1] = 3e-3
        return parameters

    def volts(self, parameters: FloatArray, rate_dps: FloatArray, dt_c: FloatArray) -> FloatArray:
        """Return the output minus its bias at a true rate, V; arrays of one shape."""
        gain = parameters[0]
        warm = one_plus(parameters[1 + self.rate_terms :], dt_c)
        bend = parameters[1 : 1 + self.rate_terms]
        if self.name == "sine":
            return np.asarray(gain * warm * np.sin(bend[0] * rate_dps) / bend[0])
        if self.name == "response":
            return np.asarray(gain * warm * rate_dps * one_plus(bend, rate_dps**2))
        return np.asarray(gain * _solve_odd(bend, rate_dps / warm))

    def rate(self, parameters: FloatArray, volts: FloatArray, dt_c: FloatArray) -> FloatArray:
        """Return the true rate for an output minus its bias, °/s; NaN beyond the law's reach (sine: |S·x| > 1)."""
        indicated = volts / parameters[0]
        warm = one_plus(parameters[1 + self.rate_terms :], dt_c)
        bend = parameters[1 : 1 + self.rate_terms]
        if self.name == "sine":
            argument = bend[0] * indicated / warm
            inside = np.abs(argument) <= 1.0
            return np.where(inside, np.arcsin(np.where(inside, argument, 0.0)) / bend[0], np.nan)
        if self.name == "response":
            return _solve_odd(bend, indicated / warm)
        return np.asarray(indicated * warm * one_plus(bend, indicated**2))

    def volts_and_slopes(
        self, parameters: FloatArray, rate_dps: FloatArray, dt_c: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return volts (n,) and their central-difference derivatives by the parameters (n, p) and by the rate (n,)."""
        value = self.volts(parameters, rate_dps, dt_c)
        slopes = np.empty((rate_dps.size, parameters.size))
        for i, scale in enumerate(self.scales):
            # The law is linear in the first parameter, so a large step avoids rounding errors.
            step = np.zeros(parameters.size)
            step[i] = 1e-4 * (abs(parameters[i]) if i == 0 else scale)
            up, down = self.volts(parameters + step, rate_dps, dt_c), self.volts(parameters - step, rate_dps, dt_c)
            slopes[:, i] = (up - down) / (2 * step[i])
        by_rate = (self.volts(parameters, rate_dps + 0.01, dt_c) - self.volts(parameters, rate_dps - 0.01, dt_c)) / 0.02
        return value, slopes, by_rate


def bias(coefficients: Sequence[float], dt_c: FloatArray) -> FloatArray:
    """Return c1·ΔT + c2·ΔT² + …, V."""
    return one_plus(coefficients, dt_c) - 1.0


def _solve_odd(bend: FloatArray, target: FloatArray) -> FloatArray:
    """Return the x with x·(1 + b2x² + b4x⁴ + …) = target, by Newton's method from the target.

    Raises `UsageError` if the polynomial has its maximum below the target: then there is no such rate.
    """
    if bend.size == 0:
        return target
    x = np.array(target, dtype=np.float64)
    slopes = bend * (2 * np.arange(bend.size) + 3)
    reach = max(float(np.max(np.abs(target), initial=0.0)), 1.0)
    for _ in range(_NEWTON_STEPS):
        square = x * x
        change = (x * one_plus(bend, square) - target) / np.maximum(one_plus(slopes, square), 0.05)
        x -= np.clip(change, -reach, reach)
        if float(np.max(np.abs(change), initial=0.0)) < _CONVERGED_DPS:
            return x
    raise UsageError(
        f"k(ω) with coefficients {', '.join(f'{b:.3g}' for b in bend)} has no rate for an indication of "
        f"{float(np.max(np.abs(target))):.4g} deg/s: it is used beyond its range; "
        "use it inside `valid`, or the sine law"
    )


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
    """One of the laws above; `bias` are the c_i [V/°C^i], `S_rad_per_dps` is 0 if the law is no sine.

    A sine has only `k_t`, in one stage; a response has its factors in one stage, too. The rate applies to the output's
    time stamp minus `delay_s`. The `discovered` structures are subtracted from the output first.
    """

    name: LawName
    K0_v_per_dps: float
    U0_v: float
    T0_c: float
    bias: tuple[float, ...] = ()
    S_rad_per_dps: float = 0.0
    stages: tuple[Factors, ...] = ()
    delay_s: float = 0.0
    discovered: Discovered = field(default_factory=Discovered)

    @property
    def knows_temperature(self) -> bool:
        """Whether the law depends on the temperature."""
        return bool(self.bias) or any(stage.k_t for stage in self.stages)

    def rate_dps(self, volts: FloatArray, celsius: FloatArray) -> FloatArray:
        """Return sensed rates [°/s] of outputs [V] at temperatures [°C], of one shape (n,); NaN if there is no rate."""
        if self.discovered:
            return self.discovered.rate_dps(volts, celsius, self._rate_dps)
        return self._rate_dps(volts, celsius)

    def _rate_dps(self, volts: FloatArray, celsius: FloatArray) -> FloatArray:
        return self.sensed_dps(volts, celsius - self.T0_c)

    def sensed_dps(self, volts: FloatArray, dt_c: FloatArray) -> FloatArray:
        """Return sensed rates [°/s] of outputs [V] without discovered structures, at ΔT [°C]; as `rate_dps`."""
        with np.errstate(all="ignore"):
            x = (volts - self.U0_v - bias(self.bias, dt_c)) / self.K0_v_per_dps
            if self.name == "sine":
                sine = self.S_rad_per_dps * x / one_plus(self.stages[0].k_t, dt_c)
                return np.asarray(np.arcsin(sine) / self.S_rad_per_dps)
            if self.name == "response":
                return odd_inverse(self.stages[0].k_omega, x / one_plus(self.stages[0].k_t, dt_c))
            for stage in self.stages:
                x = x * one_plus(stage.k_t, dt_c) * one_plus(stage.k_omega, x**2)
            return np.asarray(x)

    def volts(self, rate_dps: FloatArray, celsius: FloatArray) -> FloatArray:
        """Return the output nearest to the bias with exactly these rates, by bisection; arrays of one shape (n,).

        If the law does not reach a rate, it is the output at the law's largest rate.
        """
        zero = self.U0_v + bias(self.bias, celsius - self.T0_c)
        step = np.copysign(self.K0_v_per_dps, rate_dps * self.K0_v_per_dps)
        low, high = np.zeros_like(rate_dps), 0.25 * np.abs(rate_dps)

        def short(indicated: FloatArray) -> BoolArray:
            return np.abs(self._rate_dps(zero + step * indicated, celsius)) < np.abs(rate_dps)

        for _ in range(_WIDENINGS):
            high = np.where(short(high), _WIDER * high, high)
        _bisect(short, low, high)
        law_v = np.asarray(zero + step * low)
        return self.discovered.volts(law_v, rate_dps, celsius) if self.discovered else law_v


def _bisect(short: Callable[[FloatArray], BoolArray], low: FloatArray, high: FloatArray) -> None:
    """Move `low`, in place, up to the largest value that is `short`."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = short(middle)
        low[below], high[~below] = middle[below], middle[~below]


# p(x) = x·(1 + b2x² + b4x⁴ + …) is the odd polynomial that is inverted in the range in which it rises.

FLATTEST, STEEPEST = 0.05, 20.0
"""Range of slopes of p in which it is inverted."""

FASTEST_DPS = 1e12
"""Upper bound of all rates."""

STEPS = 250
CONVERGED = 1e-15
"""Relative size of the last step."""

_STRAIGHT = 1e-30
"""(°/s)⁻²: a bend without effect at any rate."""

_REAL = 1e-6
"""A root with a relative imaginary part below this counts as a real one, split by rounding."""


def slopes(bend: Sequence[float]) -> tuple[float, ...]:
    """Return the coefficients of p′ = 1 + 3b2x² + 5b4x⁴ + …, in the form of those of p."""
    return tuple((2 * i + 3) * b for i, b in enumerate(bend))


def reach(bend: Sequence[float]) -> tuple[float, float]:
    """Return the end of p's invertible range: the first x > 0 with a slope below `FLATTEST` or above `STEEPEST`.

    Returns x, at most `FASTEST_DPS`, and p there.
    """
    size = max((abs(b) ** (1.0 / (i + 1)) for i, b in enumerate(bend)), default=0.0)
    if size < _STRAIGHT:
        return FASTEST_DPS, FASTEST_DPS
    # In w = 1/(size·x²), so that the leading coefficient is never small and none is large.
    scaled = [b / size ** (i + 1) for i, b in enumerate(slopes(bend))]
    roots = np.concatenate([np.roots([1.0 - slope, *scaled]) for slope in (FLATTEST, STEEPEST)])
    real = roots.real[(roots.real > 0.0) & (np.abs(roots.imag) <= _REAL * np.abs(roots))]
    end = min(math.sqrt(1.0 / (size * float(np.max(real, initial=_STRAIGHT)))), FASTEST_DPS)
    return end, end * float(one_plus(bend, np.array(end * end)))


def odd_inverse(bend: Sequence[float], target: FloatArray) -> FloatArray:
    """Return the x with p(x) = target, arrays of shape (n,); NaN beyond the reach of p. Newton's method, bracketed."""
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
        excess = x * one_plus(bend, square) - wanted
        low, high = np.where(excess > 0.0, low, x), np.where(excess > 0.0, x, high)
        newton = x - excess / one_plus(slopes(bend), square)
        # Newton's method alone may oscillate for ever where p changes from flat to steep.
        trusted = (newton >= low) & (newton <= high) & (2.0 * np.abs(excess) <= before)
        following = np.where(trusted, newton, 0.5 * (low + high))
        before = np.abs(excess)
        change = np.abs(following - x)
        x = np.where(moving, following, x)
        moving &= change > CONVERGED * x
        if not bool(moving.any()):
            break
    return np.where(there, np.copysign(x, target), np.nan)
