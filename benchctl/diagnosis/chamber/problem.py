"""A chamber as a diagnosis problem: the air temperature caused by power or set point, through a first-order lag."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.optimize

from benchctl.diagnosis.chamber.rows import DRIVES, ChamberRows, chamber_rows_of
from benchctl.diagnosis.faults.fault import Fault
from benchctl.diagnosis.keys import tables_of
from benchctl.diagnosis.stepped import MadeOfRows, MadeRows
from benchctl.part_models import EFFECTS, numbers_of
from benchctl.recordings.reader import Recording
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.physics.chamber_effects.air import air_c, forgetting
from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.structures import Structure, lagged, pushed

_STAGES = ("loss", "source", "transport")
"""Order of the effects: the state before a run depends on its losses, and a transport starts from that state."""
_NOISE, _START = "noise_k_rms", "start_c"
_FEW_SIZES = 3
_BEYOND_K = 10.0
"""Margin in kelvin by which the simulated air may leave the measured range."""
_STARTS_S, _STARTS_GAIN = (0.02, 0.1, 0.5, 2.0), (1.0, -1.0)
"""Shares of the recording's length, and signs of the gain, used as starts of the baseline fit."""
_LENGTHS = 5.0
"""Longest time constant in recording lengths; a longer one is not distinguishable from air that loses no heat."""
_ROOM_C = (5.0, 40.0)
"""Rated temperature range of laboratory equipment (IEC 61010-1, 1.4.1)."""
_HEAT = 2.0
"""Maximum gain, as a multiple of the gain that heats the air by its span at the longest time constant.

The span includes the distance from the nearest room temperature, which a chamber kept at a working point never shows.
"""
_FASTEST_DRIFT = 60.0
"""Fastest drift, K/h; faster changes are heat storage, not drift."""
_MOST_LOSS = 19.0
"""Largest relative change of the loss: a closing door or stopping fan leaves at least a twentieth of the loss."""
_EDGE = 1.0 / 40.0
"""Share of a run next to its ends in which a change of the loss is confused with the air's start or hardly visible."""
_OFFSET_SHARE, _LEAST_OFFSET_K = 0.5, 10.0
_START_K, _START_STEPS = 2.0, 10.0
_LAG_SHARE = 0.03
"""A lag of moderate size, as a share of the recording."""
_NO_GAIN = 1e-6
"""Share of the largest gain below which the heater of a model has no effect."""
_TYPICAL = 0.1
"""Deviation of a typical increment from the model, relative to the median increment."""
_MUCH = 0.05
"""Share of the air's range that a model misses, above which a disturbance of the air is not a sufficient cause."""


@dataclass(frozen=True, kw_only=True)
class ChamberProblem(MadeOfRows):
    """A `PartProblem`: the air, simulated from the measured drive without feedback.

    Baseline for a power: `gain` [K per unit of power], `tau_s`, and `ambient_c` if the room was not measured; for a set
    point: `tau_s` and `offset_c`, by which the settled air exceeds the set point. With a single run, `start_c` is the
    air at its start; with several runs each starts at its first readings. Before a run the chamber was in equilibrium.
    `believed` is true if the start values are a lab's model, false if they were estimated from the recording itself.
    """

    rows: ChamberRows
    baseline_names: tuple[str, ...]
    baseline_units: tuple[str, ...]
    baseline_start: FloatArray
    believed: bool
    effects: Mapping[str, type[DescribedEffect]]
    full_scale: float
    usable: BoolArray
    unit: str = "K"
    noises: frozenset[str] = frozenset()
    bounds: Mapping[str, tuple[float, float]]
    disturbed: bool = True

    @property
    def made(self) -> MadeRows:
        """The rows."""
        return self.rows

    @property
    def measured(self) -> FloatArray:
        """The air temperature [°C], shape (m,)."""
        return self.rows.temperature_c

    @property
    def baseline_bounds(self) -> Mapping[str, tuple[float, float]]:
        """Bounds of the baseline's parameters."""
        return self.bounds

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Faults of the readings."""
        return self.rows.faults

    @property
    def interval_s(self) -> float:
        """Interval between two rows [s]."""
        return self.rows.block * self.rows.interval_s

    @property
    def circumstances(self) -> Mapping[str, float]:
        """Duration of the longest run, and the largest drive."""
        return {
            "duration_s": float(self.rows.run_s.max()),
            "largest_drive": max(float(np.abs(self.rows.drive).max()), 1e-12),
        }

    @cached_property
    def coordinates(self) -> Mapping[str, FloatArray]:
        """Coordinates with the first model's air: sorted by the measured air, noise would look like a structure."""
        rows, air_c = self.rows, self.predict(self.baseline_start, ())
        return {
            "time": rows.time_s,
            "chamber_temp": air_c,
            "chamber_temp_rate": np.concatenate(
                [np.gradient(air_c[part]) / self.interval_s for part in rows.stretches]
            ),
            "heater" if rows.kind == "power" else "setpoint": rows.means(rows.drive),
            "step": rows.infos_of_rows.step.astype(np.float64),
        }

    def predict(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Return the simulated air in the rows [°C], shape (m,)."""
        return self.rows.means(self.air_c(baseline, effects))

    def air_c(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Return the simulated air [°C] at the samples, shape (n,), from the start of each run without feedback."""
        rows = self.rows
        numbers = dict(zip(self.baseline_names, baseline.tolist(), strict=True))
        structures = [one for one in effects if isinstance(one, Structure)]
        named = [one for one in effects if not isinstance(one, Structure)]
        ordered: list[ChamberEffect] = sorted(named, key=lambda one: _STAGES.index(one.stage))
        gain = numbers[self.baseline_names[0]] if rows.kind == "power" else 1.0
        air = np.empty_like(rows.air_c)
        for run in rows.runs:
            start_c = numbers[_START] if _START in numbers else float(np.median(rows.air_c[run][:5]))
            signals = self._signals(run, numbers)
            if structures:
                signals = pushed(signals, structures, rows.clock_s[run], gain, self._reach_c)
            for effect in ordered:
                if effect.stage == "transport" and signals.before is None:
                    signals = replace(signals, before=self._before(signals, start_c, gain, numbers["tau_s"]))
                signals = effect.apply(signals)
            air[run] = air_c(signals, start_c, gain, numbers["tau_s"])
        return air

    @cached_property
    def _reach_c(self) -> tuple[float, float]:
        """Air temperatures [°C] over which heat may vary: the measured range with a margin."""
        measured_c = self.rows.temperature_c
        return float(measured_c.min()) - _BEYOND_K, float(measured_c.max()) + _BEYOND_K

    def responses(
        self, baseline: FloatArray, effects: Sequence[Any], pushes_c: FloatArray, *, heated: bool
    ) -> FloatArray:
        """Return the response of the rows [K], shape (k, m), to pushes of the equilibrium temperature, shape (k, n).

        Pushes of the heater (`heated`) pass through its transport effects. Radiation, which only makes the air follow
        slightly sooner, is omitted.
        """
        rows = self.rows
        numbers = dict(zip(self.baseline_names, baseline.tolist(), strict=True))
        air = np.empty_like(pushes_c)
        for run in rows.runs:
            signals = self._with_losses(run, numbers, effects)
            nothing = np.zeros(run.stop - run.start)
            still = replace(signals, room_c=nothing, radiation=0.0, second_c=nothing)
            for one, column in zip(pushes_c[:, run], air[:, run], strict=True):
                signals = replace(still, drive=one, before=0.0)
                for effect in effects if heated else ():
                    if effect.stage == "transport":
                        signals = effect.apply(signals)
                column[:] = air_c(signals, 0.0, 1.0, numbers["tau_s"])
        return np.stack([rows.means(one) for one in air])

    def room_c(self, baseline: FloatArray) -> FloatArray:
        """Return the room of a model [°C] at the samples, shape (n,)."""
        numbers = dict(zip(self.baseline_names, baseline.tolist(), strict=True))
        return np.concatenate([self._signals(run, numbers).room_c for run in self.rows.runs])

    @property
    def has_second(self) -> bool:
        """Whether a second temperature was measured in all samples."""
        return bool(np.isfinite(self.rows.second_c).all())

    def matters(self, name: str, change: float) -> float:
        """Return a parameter's change as a share of itself or of the air's span; 0 without a lab's model."""
        if not self.believed or name == _START:
            return 0.0
        if name in ("ambient_c", "offset_c"):
            return abs(change) / self.full_scale
        return abs(change) / abs(float(self.baseline_start[self.baseline_names.index(name)]))

    def model_of(self, baseline: FloatArray, effects: Sequence[DescribedEffect], noise: float) -> dict[str, Any]:
        """Return the table `[parts.chamber]` of a model file; `noise` [K] is that of a row."""
        numbers = dict(zip(self.baseline_names, baseline.tolist(), strict=True))
        numbers.pop(_START, None)  # valid for this run only
        found = tables_of(effects)
        return {"parts": {"chamber": {**numbers, _NOISE: noise, EFFECTS: found}}}

    def remarks(self, before: FloatArray, after: FloatArray, heldout: BoolArray) -> tuple[str, ...]:
        """Return remarks on the residuals [K] before and after, shape (m,)."""
        used, held = self.usable, self.usable & heldout
        return (
            "Compared is the air, the simulation running freely from its start: it misses by"
            f" {_rms(before[used]):.3g} K rms before and {_rms(after[used]):.3g} K after, on the pieces held out by"
            f" {_rms(before[held]):.3g} K and {_rms(after[held]):.3g} K.",
        )

    def much_missed(self, residual: FloatArray) -> str:
        """Return a sentence if a model misses much of the air's range; empty if it does not. `residual` [K] is (m,)."""
        share = _rms(residual[self.usable]) / self.full_scale
        if share < _MUCH:
            return ""
        return (
            f"The simulated air misses {100.0 * share:.2g} % of its range. This is taken as a disturbance of the air;"
            " something that happened during the recording, or an effect without a name, may be its cause."
        )

    def starts(
        self, baseline: FloatArray, effects: Sequence[DescribedEffect]
    ) -> Iterator[tuple[FloatArray, DescribedEffect]]:
        """Yield each effect that the model lacks, of moderate size, with a baseline (p,) to start a fit.

        An ambient temperature at a bound, where an absent effect may have driven it, restarts at mid-range, and a
        baseline whose heater has no effect restarts with values that most increments of the temperature have. For an
        effect with many sizes, the sizes with the smallest misfit are used. If the loss before some moment differs,
        gain and time constant are scaled so that the air before it does not change.
        """
        present = {effect.identifier for effect in effects}
        gain = self.baseline_names[0]
        if gain.startswith("gain") and abs(baseline[0]) < _NO_GAIN * self.bounds[gain][1]:
            baseline = _by_increments(self, baseline)
        if "ambient_c" in self.baseline_names:
            place = self.baseline_names.index("ambient_c")
            if baseline[place] in self.bounds["ambient_c"]:  # a fit sets it exactly to the bound
                baseline = baseline.copy()
                baseline[place] = sum(self.bounds["ambient_c"]) / 2.0
        for name, sizes in _fair_sizes(self.rows).items():
            if name not in self.effects or name in present:
                continue
            made = [self.effects[name].make(values, dict(self.circumstances)) for values in sizes]
            tried = [(self._scaled(baseline, effect), effect) for effect in made]
            if len(tried) > _FEW_SIZES:
                missed = [self._missed(numbers, (*effects, effect)) for numbers, effect in tried]
                tried = [tried[place] for place in np.argsort(missed)[:_FEW_SIZES].tolist()]
            yield from tried

    def _scaled(self, baseline: FloatArray, effect: DescribedEffect) -> FloatArray:
        """Return the baseline scaled for a different loss before some moment; unchanged for any other effect."""
        scaled = baseline.copy()
        for index, name in enumerate(self.baseline_names):
            if "fraction" in effect.parameters and (name == "tau_s" or name.startswith("gain")):
                low, high = self.bounds[name]
                scaled[index] = min(max(scaled[index] * (1.0 + effect.values["fraction"]), low), high)
        return scaled

    def _missed(self, baseline: FloatArray, effects: Sequence[DescribedEffect]) -> float:
        """Return the sum of squares [K²] of a model's misfit of the air."""
        missed = (self.predict(baseline, effects) - self.measured)[self.usable]
        return float(missed @ missed)

    def forgetting(self, baseline: FloatArray, effects: Sequence[Any]) -> Sequence[tuple[float, float]]:
        """Return the rates [1/s] at which the air of a model forgets pushes, and their powers."""
        numbers = dict(zip(self.baseline_names, baseline.tolist(), strict=True))
        return forgetting(self._with_losses(self.rows.runs[0], numbers, effects), numbers["tau_s"])

    @property
    def rounding(self) -> float:
        """Standard deviation [K] of the thermometer's rounding."""
        return self.rows.step_c / math.sqrt(12.0 * self.rows.block)

    def _with_losses(self, run: slice, numbers: Mapping[str, float], effects: Sequence[Any]) -> ChamberSignals:
        """Return the signals of a run with the changes of its losses by effects."""
        signals = self._signals(run, numbers)
        of_loss = [one for one in effects if one.stage == "loss"]
        structures = [one for one in of_loss if isinstance(one, Structure)]
        if structures:
            signals = pushed(signals, structures, self.rows.clock_s[run], 1.0, self._reach_c)
        for effect in of_loss:
            if not isinstance(effect, Structure):
                signals = effect.apply(signals)
        return signals

    def _signals(self, run: slice, numbers: Mapping[str, float]) -> ChamberSignals:
        rows = self.rows
        size = run.stop - run.start
        drive, room = rows.drive[run], rows.room_c[run]
        if rows.kind == "setpoint":
            room = np.zeros(size)
            drive = drive + numbers["offset_c"]
        elif "ambient_c" in numbers:
            room = np.full(size, numbers["ambient_c"])
        return ChamberSignals(
            time_s=rows.run_s[run],
            interval_s=rows.interval_s,
            drive=drive,
            room_c=room,
            loss=np.ones(size),
            second_c=rows.second_c[run] if self.has_second else None,
        )

    def _before(self, signals: ChamberSignals, start_c: float, gain: float, tau_s: float) -> float:
        """Return the drive that kept the air at its first temperature, in equilibrium, within the heater's range."""
        loss = float(signals.loss[0]) * (start_c - float(signals.room_c[0]))
        if signals.second_c is not None:
            loss += signals.exchange * tau_s * (start_c - float(signals.second_c[0]))
        if self.rows.kind == "setpoint":
            return loss
        least, most = min(float(signals.drive.min()), 0.0), max(float(signals.drive.max()), 0.0)
        return min(max(loss / gain if gain else 0.0, least), most)


def chamber_problem(
    recording: Recording, *, model: Mapping[str, Any] | None = None, without: Collection[str] = ()
) -> ChamberProblem:
    """Return the problem of a chamber's recording with the lab's model.

    `model` is a table `[parts.chamber]` of a model file, with the baseline's parameters (`gain_c_per_percent`,
    `gain_c_per_w` or `gain_c_per_a`, `tau_s`, `ambient_c`; for a set point `tau_s`, `offset_c`). Without it, the start
    is a fit of the baseline to the temperatures.

    Raises `UsageError` if the recording lacks the air or its drive, or if the model has an unknown field.
    """
    rows = chamber_rows_of(recording)
    names, units = _parameters(rows)
    needed = tuple(name for name in names if name != _START)
    stated = numbers_of(model, "chamber", needed, (_NOISE,))
    has_second = bool(np.isfinite(rows.second_c).all())
    known = {
        name: kind
        for name, kind in chamber_effects().items()
        if rows.kind in kind.drives and name not in without and (has_second or not kind.needs_second)
    }
    believed = needed[0] in stated
    bounds = _baseline_bounds(rows)
    within = {name: bounds["gain" if name.startswith("gain") else name] for name in names}
    for name in needed:
        if name in stated:  # the lab's value must be within the bounds
            within[name] = min(within[name][0], stated[name]), max(within[name][1], stated[name])
    stated.setdefault(_START, _first_air_c(rows))
    problem = ChamberProblem(
        rows=rows,
        baseline_names=names,
        baseline_units=units,
        baseline_start=np.array([stated.get(name, 0.0) for name in names]),
        bounds=within,
        believed=believed,
        effects=_bounded_kinds(rows, known),
        full_scale=float(np.ptp(rows.temperature_c[rows.usable])),
        usable=rows.usable,
    )
    return problem if believed else replace(problem, baseline_start=_estimated(problem))


def _rms(values: FloatArray) -> float:
    return math.sqrt(float(np.mean(values**2))) if values.size else 0.0


def _parameters(rows: ChamberRows) -> tuple[tuple[str, ...], tuple[str, ...]]:
    names: tuple[str, ...] = ("tau_s", "offset_c")
    units: tuple[str, ...] = ("s", "degC")
    if rows.kind == "power":
        unit = DRIVES[rows.channel]
        names, units = (f"gain_c_per_{unit.lower()}", "tau_s"), (f"degC {unit}-1", "s")
        if not np.isfinite(rows.room_c).all():
            names, units = (*names, "ambient_c"), (*units, "degC")
    return ((*names, _START), (*units, "degC")) if len(rows.runs) == 1 else (names, units)


def _estimated(problem: ChamberProblem) -> FloatArray:
    """Return the baseline (p,) that fits the temperatures best within its bounds, from several starts."""
    rows, names, used = problem.rows, problem.baseline_names, problem.usable
    low, high = np.array([problem.baseline_bounds[name] for name in names]).T
    first_c, largest = _first_air_c(rows), float(np.abs(rows.drive).max()) or 1.0
    span = float(np.ptp(problem.measured[used]))
    scale = np.where(high - low > 0.0, high - low, 1.0)
    best, least = problem.baseline_start, math.inf

    def missed(values: FloatArray) -> FloatArray:
        return (problem.predict(low + values * scale, ()) - problem.measured)[used]

    for share, sign in itertools.product(_STARTS_S, _STARTS_GAIN):
        guess = {"tau_s": share * _lasting_s(rows), "ambient_c": first_c, "offset_c": 0.0, _START: first_c}
        start = np.array([guess.get(name, sign * span / largest) for name in names])
        inside = np.clip((start - low) / scale, 1e-6, 1.0 - 1e-6)
        found = scipy.optimize.least_squares(missed, inside, bounds=(0.0, 1.0), x_scale=np.maximum(inside, 1e-3))
        if found.cost < least:
            best, least = low + found.x * scale, float(found.cost)
    return best


def _by_increments(problem: ChamberProblem, baseline: FloatArray) -> FloatArray:
    """Return the baseline (p,) that most increments of the temperature have, whatever happened in a few of them.

    The heat arrives after a lag, which many heaters have; without one its effect would be taken for such an event.
    """
    rows, used, lasts_s = problem.rows, problem.usable, _lasting_s(problem.rows)
    slope = np.concatenate([np.gradient(rows.temperature_c[part]) / problem.interval_s for part in rows.stretches])
    heat = np.concatenate(
        [lagged(rows.drive[run], rows.run_s[run], rows.interval_s, _LAG_SHARE * lasts_s)[0] for run in rows.runs]
    )
    columns = np.stack([rows.means(heat), -rows.temperature_c, np.ones(slope.size)], axis=1)[used]
    size = np.maximum(np.abs(columns).max(axis=0), 1e-12)
    about = float(np.median(np.abs(slope[used]))) or 1.0

    def missed(values: FloatArray) -> FloatArray:
        return np.asarray((columns @ (values / size) - slope[used] / about) / _TYPICAL)

    found = scipy.optimize.least_squares(missed, np.zeros(3), loss="cauchy").x * about / size
    tau_s = 1.0 / found[1] if found[1] > 0.0 else lasts_s
    guess = {problem.baseline_names[0]: found[0] * tau_s, "tau_s": tau_s, "ambient_c": found[2] * tau_s}
    values = [guess.get(name, value) for name, value in zip(problem.baseline_names, baseline.tolist(), strict=True)]
    bounds = [problem.bounds[name] for name in problem.baseline_names]
    return np.array([min(max(value, low), high) for value, (low, high) in zip(values, bounds, strict=True)])


def _baseline_bounds(rows: ChamberRows) -> dict[str, tuple[float, float]]:
    """Return bounds by name: what physics allows and what a recording of this length can show.

    The gain of a heater is positive; a current may also cool.
    """
    air_c, lasts_s = rows.temperature_c[rows.usable], _lasting_s(rows)
    span, coldest_c, hottest_c = float(np.ptp(air_c)), float(air_c.min()), float(air_c.max())
    mean_drive = float(np.mean(np.abs(rows.drive))) or 1.0
    most = _HEAT * _LENGTHS * max(span, hottest_c - _ROOM_C[1], _ROOM_C[0] - coldest_c) / mean_drive
    least = -most if rows.channel == "current_a" else 0.0
    first_c, about_k = _first_air_c(rows), _START_K + _START_STEPS * rows.step_c
    offset_k = max(_OFFSET_SHARE * span, _LEAST_OFFSET_K)
    return {
        "gain": (least, most),
        "tau_s": (rows.interval_s, _LENGTHS * lasts_s),
        "ambient_c": _ROOM_C,
        "offset_c": (-offset_k, offset_k),
        _START: (first_c - about_k, first_c + about_k),
    }


def _lasting_s(rows: ChamberRows) -> float:
    """Return the duration of the longest run [s]."""
    return float(rows.run_s.max()) + rows.interval_s


def _first_air_c(rows: ChamberRows) -> float:
    """Return the air temperature at the start, the median of the first readings [°C]."""
    return float(np.median(rows.air_c[:5]))


def _bounded_kinds(rows: ChamberRows, kinds: Mapping[str, type[ChamberEffect]]) -> dict[str, type[DescribedEffect]]:
    """Return the effects with bounds and starting values that suit a recording of this length."""
    lasts_s = _lasting_s(rows)
    limits: Mapping[tuple[str, str], tuple[float, float]] = {
        ("dead_time", "delay_s"): (0.0, lasts_s / 4.0),
        ("second_lag", "tau_s"): (rows.interval_s, lasts_s),
        ("heat_store", "tau_s"): (2.0 * rows.interval_s, lasts_s),
        ("exchange", "rate_per_s"): (0.0, 1.0 / rows.interval_s),
        ("ambient_drift", "c_per_hour"): (-_FASTEST_DRIFT, _FASTEST_DRIFT),
        ("loss_step", "fraction"): (-1.0, _MOST_LOSS),
        ("loss_step", "moment"): (_EDGE, 1.0 - _EDGE),
    }
    return {
        name: kind.within({one: limits[name, one] for one in kind.parameters if (name, one) in limits})
        for name, kind in kinds.items()
    }


def _fair_sizes(rows: ChamberRows) -> Mapping[str, tuple[Mapping[str, float], ...]]:
    """Return parameters of effects of moderate size, by identifier, as further starts of a fit.

    If a model misses much, the influence of a small effect does not show what an effect of the true size would do.
    """
    lasts_s = _lasting_s(rows)
    fair_drift = min(0.1 * float(np.ptp(rows.temperature_c[rows.usable])) * 3600.0 / lasts_s, 0.5 * _FASTEST_DRIFT)
    return {
        "second_lag": ({"tau_s": _LAG_SHARE * lasts_s},),
        "dead_time": ({"delay_s": 0.02 * lasts_s},),
        "heat_store": ({"capacity": 0.3, "tau_s": 0.1 * lasts_s}, {"capacity": 1.0, "tau_s": 0.3 * lasts_s}),
        "exchange": ({"rate_per_s": 10.0 / lasts_s},),
        "ambient_drift": ({"c_per_hour": fair_drift}, {"c_per_hour": -fair_drift}),
        "radiation": ({"share": 0.5},),
        "heater_nonlinearity": ({"curvature": 0.3},),
        "loss_step": tuple(
            {"fraction": fraction, "moment": place / 40} for place in range(2, 39) for fraction in (-0.8, -0.5, 1.0)
        ),
    }
