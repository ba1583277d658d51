"""The results of a calibration: frozen records from which `coefficients.json` and the report are written.

Rates in °/s, volts, °C, seconds. Rates are *sensed* rates: the table's plus the vertical part of the Earth's if the
latitude is known. Mappings by level contain the levels that were reached, in order of decreasing error: `raw` (one
straight line), `stage_1`, `stage_2`, `joint_LAW` for each law that was fitted, and `joint`, the law that the fitted
runs prefer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from benchctl.calibration.discovered import Discovered
from benchctl.calibration.free_motion import FreeMotionFit
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationOptions:
    """Options of a calibration; the defaults are the paper's orders.

    `orders_1` and `orders_2` are those of k(T) and k(ω) in the two stages, `bias_order` that of U0(T). With `T0_c` None
    the recording's own (`simulation.T0_c`) is used, or the set point of the fastest rates, of several the one nearest
    to 20 °C. `law` selects the joint fit: `auto` fits sine and polynomial and prefers the law that the fitted runs
    prefer. `choose_orders` selects the joint polynomial's orders by cross-validation over complete runs. `hold_out`: if
    no run is marked `verify`, hold some out. `discovered` is subtracted from the output first.
    """

    T0_c: float | None = None
    orders_1: tuple[int, int] = (2, 2)
    orders_2: tuple[int, int] = (1, 1)
    bias_order: int = 2
    law: Literal["auto", "sine", "polynomial", "response"] = "auto"
    choose_orders: bool = False
    robust: bool = True
    encoder_errors: bool = True
    hold_out: bool = True
    latitude_deg: float | None = None
    discovered: Discovered = field(default_factory=Discovered)

    def __post_init__(self) -> None:
        for name, orders in (
            ("orders_1", self.orders_1),
            ("orders_2", self.orders_2),
            ("bias_order", (self.bias_order,)),
        ):
            if any(order < 0 or order > 4 for order in orders):
                raise UsageError(f"calibration: {name} is {orders}, expected orders from 0 to 4")


Convention = Literal["correction", "response"]
Argument = Literal["indicated", "true"]
LawName = Literal["sine", "polynomial", "response"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Contribution:
    """One contribution to an uncertainty: a standard uncertainty (k = 1) in the parameter's unit, and its reason.

    `dof` are its degrees of freedom, infinite for type B unless stated otherwise.
    """

    source: str
    standard: float
    kind: Literal["A", "B"]
    says: str
    dof: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedParameter:
    """An estimated parameter.

    `standard` is the standard uncertainty from the scatter of the data (type A, k = 1) and `ci95` its interval: the
    scatter of repetitions on the same bench. `expanded` includes the contributions that repetitions do not show, listed
    in `budget`. Its level is 95.45 %: `k` times the combined standard uncertainty, where `k` follows from the effective
    degrees of freedom `dof` (2 if they are infinite), and never less than that of type A alone at that level.
    """

    name: str
    value: float
    unit: str
    standard: float
    ci95: tuple[float, float]
    says: str
    expanded: float
    k: float = 2.0
    dof: float = math.inf
    budget: tuple[Contribution, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class StraightLine:
    """The line for reading an uncalibrated gyro: U = U0 + K0·ω, fitted at T0 over |ω| ≤ `rate_limit_dps`."""

    K0_v_per_dps: float
    U0_v: float
    rate_limit_dps: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PolynomialFactor:
    """A factor k = 1 + Σ c_i·b_i, with b = ΔT, ΔT², … or ω², ω⁴, …; `covariance` of the coefficients, shape (n, n).

    `dof` are the degrees of freedom of the covariance.
    """

    basis: tuple[str, ...]
    coefficients: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    dof: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class BeforeAfter:
    """An error before and after a stage, percent; None if no run was held out."""

    before: float | None
    after: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """The contribution of one part to a stage's improvement: `share` of the drop in squared residuals, 0 to 1.

    The parts are not orthogonal: the share is the mean over all orders in which they may enter (Shapley), so that they
    add up to 1. `alone` is the drop with this part only.
    """

    part: str
    share: float
    alone: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """One stage of the two-stage calibration, convention `correction`, argument `indicated`.

    The input rate of stage 1 is x = (U − U0 − Σ U0_T·ΔT^i)/K0, that of stage 2 the output of stage 1; the output of a
    stage is its input times k_T(ΔT)·k_ω(input). `u0_t` are the coefficients of ΔT, ΔT², … of the bias, V/°C^i.
    """

    name: str
    k_t: PolynomialFactor
    k_omega: PolynomialFactor
    K0_v_per_dps: float
    U0_v: float
    u0_t: tuple[float, ...]
    delay_s: float
    standard: Mapping[str, float] = field(default_factory=dict)
    """Standard uncertainties (k = 1) of `K0_v_per_dps`, `U0_v`, `delay_s` if the stage fits them."""
    dof: Mapping[str, float] = field(default_factory=dict)
    """Degrees of freedom of these uncertainties."""
    error_percent: BeforeAfter
    rms_percent: BeforeAfter
    shares: tuple[Share, ...] = ()
    runs: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """The noise estimated by the joint fit.

    `white_v` is the standard deviation of one sample, V, within steps; `random_walk_v_per_sqrt_s` that of the bias
    across steps; `mean_excess` is the factor on the expected scatter of the means of steps (1 is ideal).
    """

    white_v: float
    random_walk_v_per_sqrt_s: float
    mean_excess: float


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFit:
    """One joint weighted fit of every fitted run.

    law `sine`: U = U0 + c1ΔT + c2ΔT² + (K0/S)(1 + g1ΔT + g2ΔT²)·sin(S·ω); convention `response`, argument `true`.
    law `polynomial`: ω = x·(1 + a1ΔT + …)(1 + b2x² + b4x⁴ + …), x = (U − U0(T))/K0; convention `correction`, argument
    `indicated`. `covariance` is that of `parameters`, in their order, shape (p, p), type A. Nuisances (`delay_s`, the
    encoder's `encoder_cos1_arcsec`, …) are parameters like the others.
    """

    law: LawName
    convention: Convention
    argument: Argument
    parameters: tuple[FittedParameter, ...]
    covariance: FloatArray
    noise: Noise
    rows: int
    bic: float
    """Criterion for the choice between laws on the fitted runs: χ² + p·ln(rows); lower is better."""

    def value(self, name: str) -> float:
        """Return the value of a parameter; raise `KeyError` if the law has none of this name."""
        return self.parameter(name).value

    def parameter(self, name: str) -> FittedParameter:
        """Return a parameter by name."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise KeyError(name)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunErrors:
    """The errors of one run, per level: largest and rms residual rate over the run's largest rate, percent."""

    step: int
    name: str
    kind: str
    role: str
    temperature_c: float
    peak_rate_dps: float
    error_percent: Mapping[str, float]
    rms_percent: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Residuals:
    """Block means of every run with motion or at rest, fitted or held out; all arrays of shape (n,).

    `residual_dps` has one array per level: compensated minus true rate, both averaged over the same block of at most
    `block_s` seconds, with the fitted delay if the level has one.
    """

    step: IntArray
    verify: BoolArray
    time_s: FloatArray
    rate_dps: FloatArray
    acceleration_dps2: FloatArray
    temperature_c: FloatArray
    block_s: FloatArray
    residual_dps: Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanPoints:
    """Means of the static and constant-rate steps, shape (n,): the paper's points behind k(ω), k(T) and U0(T)."""

    step: IntArray
    time_s: FloatArray
    rate_dps: FloatArray
    temperature_c: FloatArray
    setpoint_c: FloatArray
    output_v: FloatArray
    output_se_v: FloatArray
    samples: IntArray
    revolutions: FloatArray
    verify: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True)
class TemperaturePoint:
    """Slope (over |ω| ≤ `rate_limit_dps`) and bias at one temperature: a point of k(T) and of U0(T)."""

    temperature_c: float
    slope_v_per_dps: float
    slope_standard: float
    bias_v: float
    bias_standard: float
    rates: int
    rate_limit_dps: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidRange:
    """The range in which the coefficients were measured; outside it they are an extrapolation."""

    rate_dps: tuple[float, float]
    temperature_c: tuple[float, float]

    def inside(self, rate_dps: FloatArray, celsius: FloatArray) -> BoolArray:
        """Return whether rates and temperatures, of shapes that broadcast, are within the range."""
        (slowest, fastest), (coldest, warmest) = self.rate_dps, self.temperature_c
        within = (rate_dps >= slowest) & (rate_dps <= fastest) & (celsius >= coldest) & (celsius <= warmest)
        return np.asarray(within)


@dataclass(frozen=True, slots=True, kw_only=True)
class SmootherFacts:
    """The encoder's rate: widest window, largest attenuation in the motion band, noise of one value."""

    window_s: float
    attenuation: float
    rate_noise_dps: float
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationResult:
    """The complete result of a calibration.

    `stages` holds stage 1 and, if there are runs in motion, stage 2. `joint` holds the joint fits, the preferred law
    first. `error_percent` and `rms_percent` are the largest over the held-out runs, per level, empty if there are none.
    `warnings` state what could not be done, and `notes` what was done.
    """

    unit: str
    range_dps: float
    output_unit: str
    T0_c: float
    latitude_deg: float | None
    earth_rate_dps: float
    raw: StraightLine
    stages: tuple[Stage, ...]
    joint: tuple[JointFit, ...]
    error_percent: Mapping[str, float]
    rms_percent: Mapping[str, float]
    runs: tuple[RunErrors, ...]
    residuals: Residuals
    points: MeanPoints
    temperatures: tuple[TemperaturePoint, ...]
    valid: ValidRange
    smoother: SmootherFacts | None
    free_motion: FreeMotionFit | None = None
    """Fit in angle of the longest run in free motion (no stated frequency), if there is one."""
    discovered: Discovered = field(default_factory=Discovered)
    """What was subtracted from the output first; all results refer to the remaining output."""
    samples: int
    samples_masked: int
    warnings: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def best(self) -> JointFit:
        """The joint fit by the law that the fitted runs prefer."""
        return self.joint[0]
