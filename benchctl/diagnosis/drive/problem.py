"""A table's drive as a diagnosis problem: the torque required by its motion, from inertia and viscous friction."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchctl.diagnosis.drive.rows import BLOCK, DriveRows, drive_rows_of
from benchctl.diagnosis.faults.fault import Fault
from benchctl.diagnosis.keys import tables_of
from benchctl.diagnosis.stepped import MadeOfRows, MadeRows
from benchctl.part_models import EFFECTS, numbers_of
from benchctl.recordings.reader import Recording
from benchctl.signals.normal import white_noise_of
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.structures import Structure

NAMES = ("inertia_kg_m2", "viscous_nm_s")
UNITS = ("kg m2", "N m s rad-1")
CONSTANT = "torque_constant_nm_per_a"

_STAGES = ("friction", "transmission", "measurement")
_CREEPING_RAD_S = 1e-9
"""A rate at which friction has its sign but viscous torque is negligible."""
_BEYOND_NOISE = 4.0
"""Noise deviations by which a torque at rest must exceed the friction limit to count."""
_SLOWEST_DELAY_S = 0.1
"""Maximum delay of the torque: converters, buses and filters are faster."""
_FEWEST_SLOW = 20
"""Minimum moving rows in which a period over the angle lasts two rows or longer; faster rows average it out."""
_TIMES_LARGEST = 3.0
"""Maximum size of a torque component relative to the largest torque; components may cancel each other."""
_SWINGS = 0.8
"""Range of the angles from −180 to 180°, relative to that from 0 to 360°, below which a table swings about 0."""
_SHORTEST_LAG, _LONGEST_LAG = 0.02, 5.0
"""Range, in shares of the longest run, in which a time constant is observable."""


@dataclass(frozen=True, kw_only=True)
class DriveProblem(MadeOfRows):
    """A `PartProblem`: τ = J·dω/dt + b·ω, row by row.

    At rest the torque must be between those that would start a motion in either direction, as friction balances it.
    `believed` is true if the start values are a lab's model, false if they were estimated from the recording. `noise`
    is the deviation of a row's torque, estimated from neighbouring rows.
    """

    rows: DriveRows
    effects: Mapping[str, type[DescribedEffect]]
    baseline_start: FloatArray
    believed: bool
    torque_constant_nm_per_a: float | None
    full_scale: float
    coordinates: Mapping[str, FloatArray]
    noise: float
    noises: frozenset[str] = frozenset()
    baseline_names: tuple[str, ...] = NAMES

    @property
    def unit(self) -> str:
        """The unit of the torque, or of the quantity used in its place."""
        return self.rows.unit

    @property
    def baseline_units(self) -> tuple[str, ...]:
        """The units of inertia and viscous friction."""
        return UNITS if self.unit == "N m" else (f"{self.unit} s2 rad-1", f"{self.unit} s rad-1")

    @property
    def baseline_bounds(self) -> Mapping[str, tuple[float, float]]:
        """Inertia and viscous friction are not negative."""
        return dict.fromkeys(NAMES, (0.0, math.inf))

    @property
    def made(self) -> MadeRows:
        """The rows."""
        return self.rows

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Faults of the samples."""
        return self.rows.faults

    @property
    def measured(self) -> FloatArray:
        """The torque [N·m], shape (m,)."""
        return self.rows.torque_nm

    @property
    def clock_s(self) -> FloatArray:
        """Time since the start of the recording that a row belongs to [s], shape (m,)."""
        return self.rows.clock_s

    @property
    def interval_s(self) -> float:
        """Interval between two rows [s]."""
        return BLOCK * self.rows.sample_interval_s

    @property
    def usable(self) -> BoolArray:
        """Rows in which the table turns."""
        return self.rows.moving

    @property
    def circumstances(self) -> Mapping[str, float]:
        """Duration of the longest run."""
        return {"duration_s": max(float(self.rows.run_s.max()), self.interval_s)}

    @property
    def turns_one_way(self) -> bool:
        """Whether the table turns in one direction only."""
        rate = self.rows.means(self.rows.rate_rad_s)[self.usable]
        return bool(rate.min() > 0.0 or rate.max() < 0.0)

    def predict(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Return the torque that the motion requires, shape (m,)."""
        return self._torque(baseline, effects, self.rows.rate_rad_s, self.rows.acceleration_rad_s2)

    def _torque(
        self, baseline: FloatArray, effects: Sequence[Any], rate_rad_s: FloatArray, acceleration_rad_s2: FloatArray
    ) -> FloatArray:
        rows = self.rows
        inertia, viscous = baseline.tolist()
        torque = inertia * acceleration_rad_s2 + viscous * rate_rad_s
        structures = [one for one in effects if isinstance(one, Structure)]
        named = [one for one in effects if not isinstance(one, Structure)]
        ordered: list[DriveEffect] = sorted(named, key=lambda one: _STAGES.index(one.stage))
        for run in rows.runs if ordered else ():
            signals = DriveSignals(
                time_s=rows.run_s[run],
                interval_s=rows.sample_interval_s,
                angle_deg=rows.angle_deg[run],
                rate_rad_s=rate_rad_s[run],
                acceleration_rad_s2=acceleration_rad_s2[run],
                torque_nm=torque[run],
                inertia_kg_m2=inertia,
                viscous_nm_s=viscous,
            )
            for effect in ordered:
                signals = replace(signals, torque_nm=effect.apply(signals))
            torque[run] = signals.torque_nm
        if structures:
            values = _coordinates(rows.sampled_s, rows.angle_deg, rate_rad_s, acceleration_rad_s2)
            torque += sum(one.value_at(values[one.over]) for one in structures)
        return rows.means(torque)

    def spectral_residual(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Return the maximum excess of each rest's torque over the friction limit, forwards and backwards."""
        rows = self.rows
        if not rows.rests:
            return np.zeros(0)
        still = np.zeros_like(rows.rate_rad_s)
        least, most = (self._torque(baseline, effects, still + sign * _CREEPING_RAD_S, still) for sign in (-1.0, 1.0))
        margin = _BEYOND_NOISE * self.noise
        ahead, behind = rows.torque_nm - most - margin, rows.torque_nm - least + margin
        return np.array([[max(ahead[one].max(), 0.0), min(behind[one].min(), 0.0)] for one in rows.rests]).ravel()

    @property
    def spectral_step(self) -> IntArray:
        """The step in which each rest starts."""
        return np.repeat(self.step[[one.start for one in self.rows.rests]], 2)

    def starts(
        self, baseline: FloatArray, effects: Sequence[DescribedEffect]
    ) -> Iterator[tuple[FloatArray, DescribedEffect]]:
        """Yield friction as large as the rests require; rows in motion do not determine friction at rest."""
        beyond = np.abs(self.spectral_residual(baseline, effects))
        if not beyond.any():
            return
        missed = float(np.median(beyond[beyond > 0.0]))
        for name, values in (
            ("coulomb_friction", {"coulomb_nm": missed}),
            ("gear_friction", {"share": min(missed / self.full_scale, 0.5)}),
        ):
            if name in self.effects and not any(one.identifier == name for one in effects):
                yield baseline, self.effects[name].make(values)

    def matters(self, name: str, change: float) -> float:
        """Return a parameter's change as a share of the largest torque; 0 without a lab's model."""
        if not self.believed:
            return 0.0
        driven = self.rows.acceleration_rad_s2 if name == NAMES[0] else self.rows.rate_rad_s
        return abs(change) * float(np.abs(self.rows.means(driven)[self.usable]).max()) / self.full_scale

    def model_of(self, baseline: FloatArray, effects: Sequence[DescribedEffect], noise: float) -> dict[str, Any]:
        """Return the table `[parts.drive]` of a model file; `noise` [N·m] is that of a row."""
        constant = {} if self.torque_constant_nm_per_a is None else {CONSTANT: self.torque_constant_nm_per_a}
        numbers = dict(zip(NAMES, baseline.tolist(), strict=True))
        found = tables_of(effects)
        return {"parts": {"drive": {**numbers, **constant, "noise_nm_rms": noise, EFFECTS: found}}}

    def remarks(self, before: FloatArray, after: FloatArray, heldout: BoolArray) -> tuple[str, ...]:
        """Return remarks on what the recording cannot show; the arguments are not used."""
        del before, after, heldout
        sentences = [
            f"Torque and motion are compared as means over {1e3 * self.interval_s:.3g} ms: ripple and resonances beyond"
            f" {0.5 / self.interval_s:.3g} Hz, and play or twist between motor and encoder, cannot be seen."
        ]
        rate = self.rows.means(self.rows.rate_rad_s)[self.usable]
        if self.turns_one_way:
            sentences.append(
                "The table turns one way only: dry friction, which turns with the direction, and an offset of the"
                " torque, which does not, cannot be separated."
            )
        if float(np.ptp(rate)) < 0.05 * float(np.abs(rate).max()):
            sentences.append(
                "The table turns at one rate only: inertia is hardly seen, and friction of any kind looks alike."
            )
        return tuple(sentences)


def drive_problem(
    recording: Recording, *, model: Mapping[str, Any] | None = None, without: Collection[str] = ()
) -> DriveProblem:
    """Return the problem of a drive's recording with the lab's model.

    `model` is a table `[parts.drive]` of a model file: `inertia_kg_m2` and `viscous_nm_s`, or neither, and
    `torque_constant_nm_per_a` if the recording has a current in place of a torque. Without parameters, the start is a
    fit of the baseline.

    Raises `UsageError` if the recording has no motion with torque, or if the model has an unknown field.
    """
    stated = numbers_of(model, "drive", NAMES, (CONSTANT, "noise_nm_rms"))
    constant = stated.get(CONSTANT)
    rows = drive_rows_of(recording, constant)
    rate, acceleration = rows.means(rows.rate_rad_s), rows.means(rows.acceleration_rad_s2)
    believed = NAMES[0] in stated
    if believed:
        start = np.array([stated[name] for name in NAMES])
    else:
        columns = np.stack([acceleration, rate], axis=1)[rows.moving]
        start = np.linalg.lstsq(columns, rows.torque_nm[rows.moving], rcond=None)[0]
        start = np.maximum(start, 0.0)
    full_scale = float(np.abs(rows.torque_nm[rows.moving]).max())
    if full_scale == 0.0:
        raise UsageError(
            f"{recording.path}: the torque is 0 throughout; name its column in the import's map, or record it"
        )
    along = _coordinates(rows.time_s, rows.means(rows.angle_deg), rate, acceleration)
    swing_deg = along.pop("swing_angle")
    if np.ptp(swing_deg[rows.moving]) < _SWINGS * np.ptp(along["angle"][rows.moving]):
        along["angle"] = swing_deg
    return DriveProblem(
        rows=rows,
        effects={name: kind for name, kind in _bounded_kinds(rows) if name not in without},
        baseline_start=start,
        believed=believed,
        torque_constant_nm_per_a=constant,
        full_scale=full_scale,
        noise=white_noise_of(rows.torque_nm),
        coordinates={
            **along,
            "rate_sign": np.where(rows.moving, np.sign(rate), 0.0),
            "output": rows.torque_nm,
            "step": rows.infos_of_rows.step.astype(np.float64),
        },
    )


def _coordinates(
    time_s: FloatArray, angle_deg: FloatArray, rate_rad_s: FloatArray, acceleration_rad_s2: FloatArray
) -> dict[str, FloatArray]:
    """Return the coordinates on which an unnamed torque may depend, as structures define them; arrays of one shape.

    `angle` is from 0 to 360°, `swing_angle` from −180 to 180°.
    """
    return {
        "time": time_s,
        "rate": np.degrees(rate_rad_s),
        "abs_rate": np.abs(np.degrees(rate_rad_s)),
        "rate_sign": np.sign(rate_rad_s),
        "acceleration": np.degrees(acceleration_rad_s2),
        "angle": np.mod(angle_deg, 360.0),
        "swing_angle": np.mod(angle_deg + 180.0, 360.0) - 180.0,
    }


def _bounded_kinds(rows: DriveRows) -> Iterator[tuple[str, type[DescribedEffect]]]:
    """Yield the effects with bounds and starting values that suit such a recording."""
    largest = _TIMES_LARGEST * float(np.abs(rows.torque_nm).max())
    lasts_s = float(rows.run_s.max())
    turned = max(float(np.ptp(rows.angle_deg[run])) for run in rows.runs)
    slow_rad_s = float(np.sort(np.abs(rows.means(rows.rate_rad_s)[rows.moving]))[_FEWEST_SLOW - 1])
    limits = {
        "tau_s": (_SHORTEST_LAG * lasts_s, _LONGEST_LAG * lasts_s),
        "velocity_rad_s": (0.0, float(np.abs(rows.rate_rad_s).max()) / 2.0),
        "delay_s": (-_SLOWEST_DELAY_S, _SLOWEST_DELAY_S),
        # an angle passed only once shows no repetition, and a row is the mean of its samples
        "order": (720.0 / turned, math.pi / (slow_rad_s * BLOCK * rows.sample_interval_s)),
        **dict.fromkeys(("coulomb_nm", "breakaway_nm", "moment_nm", "amplitude_nm", "offset_nm"), (-largest, largest)),
    }
    for name, kind in drive_effects().items():
        orders = kind.parameters["order"].scan if "order" in kind.parameters else ()
        if not orders or any(limits["order"][0] <= order <= limits["order"][1] for order in orders):
            yield name, kind.within(limits)
