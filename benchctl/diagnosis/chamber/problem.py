"""A chamber as a problem for the engine: the air that its power, or its set point, brings about, by one lag."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.optimize

from benchctl.diagnosis.chamber.rows import DRIVES, ChamberRows, chamber_rows_of
from benchctl.diagnosis.keys import tables_of
from benchctl.diagnosis.stepped import MadeOfRows, MadeRows
from benchctl.part_models import EFFECTS, numbers_of
from benchctl.recordings.reader import Recording
from instruments.physics.chamber_effects.air import air_c
from instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals
from instruments.physics.chamber_effects.registry import chamber_effects
from instruments.physics.effects.effect import DescribedEffect

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

_STAGES = ("source", "transport", "loss")
_NOISE = "noise_k_rms"


@dataclass(frozen=True, kw_only=True)
class ChamberProblem(MadeOfRows):
    """A `benchctl.diagnosis.problem.Problem`: increments of the freely simulated air from row to row.

    Baseline of a power: `gain` [K per its unit], `tau_s`, and `ambient_c` where the room was not measured; of a set
    point: `tau_s` and `offset_c`, by which the air settles above it. `believed` says whether the start is a lab's
    model, or was estimated from the recording itself.
    """

    rows: ChamberRows
    baseline_names: tuple[str, ...]
    baseline_units: tuple[str, ...]
    baseline_start: FloatArray
    believed: bool
    effects: Mapping[str, type[DescribedEffect]]
    coordinates: Mapping[str, FloatArray]
    full_scale: float
    usable: BoolArray
    unit: str = "K"
    noises: frozenset[str] = frozenset()

    @property
    def made(self) -> MadeRows:
        """The rows."""
        return self.rows

    @property
    def measured(self) -> FloatArray:
        """How far the air moved [K], shape (m,)."""
        return self.rows.increment_c

    @property
    def interval_s(self) -> float:
        """Between two rows [s]."""
        return self.rows.block * self.rows.interval_s

    @property
    def circumstances(self) -> Mapping[str, float]:
        """The longest run and the largest drive."""
        return {
            "duration_s": float(self.rows.run_s.max()),
            "largest_drive": max(float(np.abs(self.rows.drive).max()), 1e-12),
        }

    def predict(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """How far the simulated air moves from row to row [K], shape (m,)."""
        return self.rows.increments(self.air_c(baseline, effects))

    def air_c(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """The simulated air [°C] at the samples, shape (n,): run freely, in each run from its first temperature."""
        rows = self.rows
        told = dict(zip(self.baseline_names, baseline.tolist(), strict=True))
        ordered: list[ChamberEffect] = sorted(effects, key=lambda one: _STAGES.index(one.stage))
        air = np.empty_like(rows.air_c)
        for run in rows.runs:
            signals = self._signals(run, told)
            for effect in ordered:
                signals = effect.apply(signals)
            gain = told[self.baseline_names[0]] if rows.kind == "power" else 1.0
            air[run] = air_c(signals, float(rows.air_c[run.start]), gain, told["tau_s"])
        return air

    def matters(self, name: str, change: float) -> float:
        """A change of the lab's parameter, as a share of itself or of the span of the air; none without a model."""
        if not self.believed:
            return 0.0
        if name in ("ambient_c", "offset_c"):
            return abs(change) / self.full_scale
        return abs(change) / abs(float(self.baseline_start[self.baseline_names.index(name)]))

    def model_of(self, baseline: FloatArray, effects: Sequence[DescribedEffect], noise: float) -> dict[str, Any]:
        """The content of a model file, its table `[parts.chamber]`; `noise` [K] is that of a row."""
        numbers = dict(zip(self.baseline_names, baseline.tolist(), strict=True))
        found = tables_of(effects)
        return {"parts": {"chamber": {**numbers, _NOISE: noise, EFFECTS: found}}}

    def remarks(self, before: FloatArray, after: FloatArray, heldout: BoolArray) -> tuple[str, ...]:
        """What this part has to say of residuals [K] before and after, shape (m,): as temperatures, not increments.

        Without a lab's model `before` gives way to the start, which is the baseline's best fit to the temperatures.
        """
        started = before if self.believed else self.measured - self.predict(self.baseline_start, ())
        missed, left = self._summed(started), self._summed(after)
        return (
            f"Compared is how far the air moves in {self.interval_s:.3g} s, the simulation running freely from its"
            f" first temperature. As temperatures it misses by {_rms(missed):.3g} K rms before and {_rms(left):.3g} K"
            f" after, on the pieces held out by {_rms(missed[heldout]):.3g} K and {_rms(left[heldout]):.3g} K.",
        )

    def _summed(self, residual: FloatArray) -> FloatArray:
        """Residuals of temperatures from those of increments, shape (m,)."""
        return np.concatenate([np.cumsum(residual[part]) for part in self.stretches])

    def _signals(self, run: slice, told: Mapping[str, float]) -> ChamberSignals:
        rows = self.rows
        size = run.stop - run.start
        drive, room = rows.drive[run], rows.room_c[run]
        if rows.kind == "setpoint":
            room = np.zeros(size)
            drive = drive + told["offset_c"]
        elif "ambient_c" in told:
            room = np.full(size, told["ambient_c"])
        return ChamberSignals(
            time_s=rows.run_s[run],
            interval_s=rows.interval_s,
            drive=drive,
            room_c=room,
            loss=np.ones(size),
        )


def chamber_problem(
    recording: Recording, *, model: Mapping[str, Any] | None = None, without: Collection[str] = ()
) -> ChamberProblem:
    """The problem of a chamber's recording and of the model that its lab believes in.

    `model` is a table `[parts.chamber]` of a model file, with the baseline's parameters (`gain_c_per_percent`,
    `gain_c_per_w` or `gain_c_per_a`, `tau_s`, `ambient_c`; of a set point `tau_s`, `offset_c`). Without one, a fit of
    the baseline to the temperatures is the start.

    Raises `UsageError` where the recording has no air with what drives it, or the model a field that is not known.
    """
    rows = chamber_rows_of(recording)
    names, units = _parameters(rows)
    told = numbers_of(model, "chamber", names, (_NOISE,))
    known = {name: kind for name, kind in chamber_effects().items() if rows.kind in kind.drives and name not in without}
    span = float(np.ptp(rows.air_c))
    believed = names[0] in told
    problem = ChamberProblem(
        rows=rows,
        baseline_names=names,
        baseline_units=units,
        baseline_start=np.array([told[name] for name in names]) if believed else np.ones(len(names)),
        believed=believed,
        effects=known,
        coordinates=_coordinates(rows),
        full_scale=span,
        usable=np.ones(rows.increment_c.size, np.bool_),
    )
    return problem if believed else _estimated(problem)


def _rms(values: FloatArray) -> float:
    return math.sqrt(float(np.mean(values**2))) if values.size else 0.0


def _parameters(rows: ChamberRows) -> tuple[tuple[str, ...], tuple[str, ...]]:
    if rows.kind == "setpoint":
        return ("tau_s", "offset_c"), ("s", "degC")
    unit = DRIVES[rows.channel]
    names, units = (f"gain_c_per_{unit.lower()}", "tau_s"), (f"degC {unit}-1", "s")
    return (names, units) if np.isfinite(rows.room_c).all() else ((*names, "ambient_c"), (*units, "degC"))


def _coordinates(rows: ChamberRows) -> dict[str, FloatArray]:
    return {
        "time": rows.time_s,
        "chamber_temp": rows.means(rows.air_c),
        "chamber_temp_rate": rows.increment_c / (rows.block * rows.interval_s),
        "heater" if rows.kind == "power" else "setpoint": rows.means(rows.drive),
        "step": rows.infos_of_rows.step.astype(np.float64),
    }


def _estimated(problem: ChamberProblem) -> ChamberProblem:
    """The problem with its baseline fitted to the temperatures, from time constants short and long."""
    rows, names = problem.rows, problem.baseline_names
    best: tuple[float, FloatArray] | None = None
    duration_s = float(rows.run_s.max())
    first_c, drive = float(rows.air_c[0]), float(rows.drive[np.argmax(np.abs(rows.drive))]) or 1.0
    for share in (0.02, 0.1, 0.5):
        guess = {"tau_s": share * duration_s, "ambient_c": first_c, "offset_c": 0.0}
        far = rows.air_c[np.argmax(np.abs(rows.air_c - first_c))] - first_c
        start = np.array([guess.get(name, float(far) / drive) for name in names])
        scale = np.where(start == 0.0, 1.0, np.abs(start))

        def missed(values: FloatArray, scale: FloatArray = scale) -> FloatArray:
            return problem.air_c(values * scale, ()) - rows.air_c

        found = scipy.optimize.least_squares(missed, start / scale, max_nfev=40)
        if best is None or found.cost < best[0]:
            best = (float(found.cost), found.x * scale)
    return replace(problem, baseline_start=best[1] if best is not None else problem.baseline_start)
