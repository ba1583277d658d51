"""A table of static points as a diagnosis problem: mean outputs of the gyro at commanded rates, without samples.

Means over seconds have negligible noise: their scatter is that of the bench from point to point, and is estimated from
the residual of a model. Each point is a step, so that complete points are held out. Only laws that depend on a steady
rate are observable; when the points were taken, and how the table reached them, was not recorded.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import t as student

from benchctl.calibration.static_points_fit import RESTING_DPS
from benchctl.diagnosis.faults.fault import Fault
from benchctl.diagnosis.gyro.baseline import GyroBaseline
from benchctl.diagnosis.gyro.model import checked_model, straight_line
from benchctl.diagnosis.gyro.points_end import PointsEnd
from benchctl.recordings.model import StepInfo
from benchctl.recordings.reader import Recording
from benchctl.recordings.static_points import KIND, StaticPoints
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chain import Signals, Stage, run_chain
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.effects.registry import effects

_LAWS = (
    "dead_zone",
    "fringe_ambiguity",
    "rate_nonlinearity",
    "rate_squared",
    "saturation",
    "scale_asymmetry",
    "two_rails",
)
_LAWS_OF_TEMPERATURE = ("bias_temperature", "scale_rate_temperature_coupling", "scale_temperature")
_STAGES: tuple[Stage, ...] = ("sensed_rate", "scale", "bias", "electronics")

_FEWEST = 12
_FEWEST_RATES = 5
_SPAN_C = 2.0
_RATE_ERROR = 1e-3
"""Assumed error of commanded rates as a share of the largest rate, as in specifications of rate tables."""
_ODD = 0.001
"""Probability of the deviation at rest below which it is reported as unexplained."""


@dataclass(frozen=True, kw_only=True)
class PointsProblem(GyroBaseline):
    """A `PartProblem`: mean volts from commanded rates, one row per point.

    Points at which the gyro is `overloaded` (n,) are not fitted.
    """

    points: StaticPoints
    noises: frozenset[str] = frozenset()
    overloaded: BoolArray | None = None

    @cached_property
    def regressor_variance(self) -> tuple[FloatArray, FloatArray]:
        """Zeros, (n,) each: a commanded rate has no noise."""
        return np.zeros(self.step.size), np.zeros(self.step.size)

    @property
    def measured(self) -> FloatArray:
        """Mean outputs [V], shape (n,)."""
        return self.points.mean_v

    @cached_property
    def time_s(self) -> FloatArray:
        """The number of a point in place of its time, which was not recorded."""
        return np.arange(self.points.rate_dps.size, dtype=np.float64)

    @property
    def interval_s(self) -> float:
        """Distance from one point to the next."""
        return 1.0

    @property
    def stretches(self) -> tuple[slice, ...]:
        """One stretch with all points."""
        return (slice(0, self.points.rate_dps.size),)

    @cached_property
    def step(self) -> IntArray:
        """Each point is a step."""
        return np.arange(self.points.rate_dps.size)

    @cached_property
    def steps(self) -> tuple[StepInfo, ...]:
        """The points as steps."""
        runs = self.points.run
        return tuple(
            StepInfo(
                index=i,
                name=f"{rate:+g} deg/s" if runs is None else f"{rate:+g} deg/s in run {runs[i]:g}",
                kind=KIND,
                t_start=float(i),
                t_end=float(i + 1),
                chamber_setpoint_c=math.nan,
                rate_dps=rate,
            )
            for i, rate in enumerate(self.points.rate_dps.tolist())
        )

    @cached_property
    def usable(self) -> BoolArray:
        """Points with a finite mean, at which the gyro is not overloaded."""
        known = np.isfinite(self.points.mean_v) & np.isfinite(self.points.rate_dps)
        return known if self.overloaded is None else known & ~self.overloaded

    @property
    def rate_error_v(self) -> float:
        """Maximum error of commanded rates, as output."""
        largest = float(np.abs(self.points.rate_dps[self.usable]).max())
        return _RATE_ERROR * largest * abs(float(np.polyfit(*self.following, 1)[0]))

    @cached_property
    def end(self) -> PointsEnd | None:
        """The end of the table's range; None if all points follow one law."""
        return PointsEnd.of(self.points)

    @cached_property
    def circumstances(self) -> Mapping[str, float]:
        """Reference temperature and rated range."""
        return {"T0_c": self.law.T0_c, "range_dps": self.range_dps, "start_s": 0.0}

    @cached_property
    def effects(self) -> Mapping[str, type[DescribedEffect]]:
        """The laws of a steady rate, and those of temperature if the points have several temperatures."""
        names = _LAWS + (_LAWS_OF_TEMPERATURE if self._temperatures_vary else ())
        return {name: kind for name, kind in effects().items() if name in names and name not in self.without}

    @cached_property
    def coordinates(self) -> Mapping[str, FloatArray]:
        """Rate, its magnitude and sign, output; temperature if it is known."""
        rate = self.points.rate_dps
        known = {
            "rate": rate,
            "abs_rate": np.abs(rate),
            "rate_sign": np.sign(np.where(np.abs(rate) < RESTING_DPS, 0.0, rate)),
            "output": self.points.mean_v,
        }
        return known if self.points.temperature_c is None else {**known, "gyro_temp": self.points.temperature_c}

    def predict(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Return the predicted volts, shape (n,)."""

        def scale(signals: Signals) -> Signals:
            return replace(signals, output_v=self.law.volts(baseline, signals.sensed_rate_dps, signals.coil_c))

        def add_bias(signals: Signals) -> Signals:
            return replace(signals, output_v=signals.output_v + baseline[1])

        return run_chain(self._signals(), {"scale": scale, "bias": add_bias}, effects, _STAGES).output_v

    def remarks(self, before: FloatArray, after: FloatArray, heldout: BoolArray) -> tuple[str, ...]:
        """Return remarks on what points cannot show, on their scatter, and on the points at rest."""
        del before, heldout
        return tuple(self._remarks(after))

    def _remarks(self, after: FloatArray) -> Iterator[str]:
        yield (
            f"{int(self.usable.sum())} static points, no samples: of time, motion, encoder and noise nothing is"
            " observable here; a commanded rate is taken as the table's own."
        )
        if not self._temperatures_vary:
            yield "All points are at one temperature, or none is known: no effect of temperature is observable."
        points = self.points
        scatter = float(np.sqrt(np.mean(after[self.usable] ** 2)))
        dps = scatter / abs(float(self.simulation["K0_v_per_dps"]))
        yield (
            f"The points scatter by {scatter:.3g} {self.unit} rms ({dps:.2g} °/s,"
            f" {100.0 * scatter / self.full_scale:.2g} % of full scale) about the final model; intervals and thresholds"
            " are by that scatter, not by the deviation stated with each point."
        )
        if self.end is not None:
            yield from self.end.remarks()
        rest = np.abs(points.rate_dps) < RESTING_DPS
        yield from _at_rest(after[rest & self.usable], after[~rest & self.usable], self.simulation, self.unit)

    @property
    def _temperatures_vary(self) -> bool:
        known = self.points.temperature_c
        return known is not None and bool(np.ptp(known) > _SPAN_C)

    @cached_property
    def coil_c(self) -> FloatArray:
        """Temperatures of the gyro [°C], shape (n,): T0 if they are unknown."""
        known = self.points.temperature_c
        return np.full(self.points.rate_dps.size, self.law.T0_c) if known is None else known

    @property
    def following(self) -> tuple[FloatArray, FloatArray]:
        """Rates and outputs of the points that follow the law, (m,) each."""
        rate, mean = self.points.rate_dps, self.points.mean_v
        follows = self.usable if self.end is None else self.usable & (np.abs(rate) <= self.end.follows_to_dps)
        return rate[follows], mean[follows]

    def _signals(self) -> Signals:
        rate, none = self.points.rate_dps, np.zeros(self.points.rate_dps.size)
        return Signals(
            interval_s=1.0,
            time_s=self.time_s,
            angle_deg=none,
            rate_dps=rate,
            acceleration_dps2=none,
            housing_c=self.coil_c,
            coil_c=self.coil_c,
            sensed_rate_dps=rate,
            output_v=none,
            encoder_deg=none,
            thermistor_c=self.coil_c,
            coil_rate_c_per_s=none,
        )


def _at_rest(rest: FloatArray, turning: FloatArray, simulation: Mapping[str, Any], unit: str) -> Iterator[str]:
    """Yield whether the points at rest agree with the turning ones; residuals of shape (r,) and (m,)."""
    if not rest.size or turning.size < _FEWEST_RATES:
        return
    away, deviation = float(rest.mean() - turning.mean()), float(turning.std(ddof=1))
    error = deviation * math.sqrt(1.0 / rest.size + 1.0 / turning.size)
    chance = 2.0 * float(student.sf(abs(away) / max(error, 1e-300), turning.size - 1))
    dps = away / float(simulation["K0_v_per_dps"])
    text = f"The {rest.size} points at rest lie {away:+.3g} {unit} ({dps:+.2g} °/s) off the model through all points"
    if chance < _ODD:
        yield (
            f"{text}, which chance does {chance:.1g} of the time: that is left unexplained. A table at rest differs"
            " from one that turns in more than its rate (slip rings, cables, drive); runs at 1 to 5 °/s show which."
        )
    else:
        yield f"{text}, which is within the scatter of the others."


def without_overload(problem: PointsProblem) -> tuple[PointsProblem, tuple[Fault, ...]]:
    """Return the problem without points at which the gyro is overloaded, and that fault, if there is one.

    Without a lab's model, the line is fitted to the other points; the range ends at the last rate that follows the law.
    """
    if "overload" in problem.without or problem.end is None or (fault := problem.end.overload()) is None:
        return problem, ()
    ends_dps = problem.end.follows_to_dps
    kept = replace(problem, overloaded=fault.rows, range_dps=min(problem.range_dps, ends_dps))
    if not problem.believed:
        kept = replace(kept, simulation=straight_line(*kept.following, problem.law.T0_c))
    return kept, (fault,)


def has_points(recording: Recording) -> bool:
    """Return whether a recording consists of static points."""
    return bool(recording.infos) and all(info.kind == KIND for info in recording.infos)


def points_problem(
    recording: Recording, *, model: Mapping[str, Any] | None = None, without: Collection[str] = ()
) -> PointsProblem:
    """Return the problem of a recording of static points; without a model, the model is a straight line.

    Raises `UsageError` if there are too few points or rates, or if the model has a wrong field.
    """
    parts = [StaticPoints.from_step(step) for step in recording.steps((KIND,))]
    points = _joined(parts)
    rates = np.unique(points.rate_dps)
    if points.rate_dps.size < _FEWEST or rates.size < _FEWEST_RATES:
        raise UsageError(
            f"{recording.path}: {points.rate_dps.size} static points at {rates.size} rates are too few to tell a law"
            f" from their scatter; a diagnosis needs {_FEWEST} at {_FEWEST_RATES} rates or more"
        )
    stated = model or recording.meta.simulation
    digital = recording.meta.output_unit == "deg/s"
    if stated is None:
        T0_c = 20.0 if points.temperature_c is None else float(np.median(points.temperature_c))
        simulation: Mapping[str, Any] = straight_line(points.rate_dps, points.mean_v, T0_c)
    else:
        where = "[simulation] of the model" if model else f"{recording.path}: [simulation]"
        simulation = checked_model(stated, where=where, digital=digital)
    return PointsProblem(
        points=points,
        simulation=simulation,
        range_dps=recording.meta.unit.range_dps or float(np.abs(points.rate_dps).max()),
        without=frozenset(without),
        believed=stated is not None,
        unit="°/s" if digital else "V",
    )


def _joined(parts: Sequence[StaticPoints]) -> StaticPoints:
    """Return several tables as one; columns that some of them lack are left out."""
    if len(parts) == 1:
        return parts[0]

    def together(name: str) -> FloatArray | None:
        columns = [getattr(part, name) for part in parts]
        return None if any(column is None for column in columns) else np.concatenate(columns)

    rate, mean = (np.concatenate([getattr(part, name) for part in parts]) for name in ("rate_dps", "mean_v"))
    return StaticPoints(
        rate_dps=rate,
        mean_v=mean,
        **{name: together(name) for name in ("std_v", "run", "temperature_c", "duration_s")},
    )
