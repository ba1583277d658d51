"""A table's drive as a problem for the engine: the torque that its motion takes, by inertia and viscous friction."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.drive.rows import BLOCK, DriveRows, drive_rows_of
from benchctl.diagnosis.keys import tables_of
from benchctl.diagnosis.stepped import MadeOfRows, MadeRows
from benchctl.part_models import EFFECTS, numbers_of
from benchctl.recordings.reader import Recording
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.effect import DescribedEffect

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

NAMES = ("inertia_kg_m2", "viscous_nm_s")
UNITS = ("kg m2", "N m s rad-1")
CONSTANT = "torque_constant_nm_per_a"


@dataclass(frozen=True, kw_only=True)
class DriveProblem(MadeOfRows):
    """A `benchctl.diagnosis.problem.Problem`: τ = J·dω/dt + b·ω, row by row.

    `believed` says whether the start is a lab's model, or was estimated from the recording itself.
    """

    rows: DriveRows
    effects: Mapping[str, type[DescribedEffect]]
    baseline_start: FloatArray
    believed: bool
    torque_constant_nm_per_a: float | None
    full_scale: float
    coordinates: Mapping[str, FloatArray]
    unit: str = "N m"
    noises: frozenset[str] = frozenset()
    baseline_names: tuple[str, ...] = NAMES
    baseline_units: tuple[str, ...] = UNITS

    @property
    def made(self) -> MadeRows:
        """The rows."""
        return self.rows

    @property
    def measured(self) -> FloatArray:
        """The torque [N·m], shape (m,)."""
        return self.rows.torque_nm

    @property
    def interval_s(self) -> float:
        """Between two rows [s]."""
        return BLOCK * self.rows.sample_interval_s

    @property
    def usable(self) -> BoolArray:
        """Rows in which the table turns."""
        return self.rows.moving

    @property
    def circumstances(self) -> Mapping[str, float]:
        """How long the longest run is."""
        return {"duration_s": max(float(self.rows.run_s.max()), self.interval_s)}

    @property
    def turns_one_way(self) -> bool:
        """Whether the table turns in one direction only."""
        rate = self.rows.means(self.rows.rate_rad_s)[self.usable]
        return bool(rate.min() > 0.0 or rate.max() < 0.0)

    def predict(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """The torque [N·m] that the motion takes, shape (m,)."""
        rows = self.rows
        inertia, viscous = baseline.tolist()
        torque = inertia * rows.acceleration_rad_s2 + viscous * rows.rate_rad_s
        ordered: list[DriveEffect] = sorted(effects, key=lambda one: one.stage == "measurement")
        if ordered:
            for run in rows.runs:
                for effect in ordered:
                    torque[run] = effect.apply(self._signals(run, torque[run], inertia, viscous))
        return rows.means(torque)

    def matters(self, name: str, change: float) -> float:
        """A change of the lab's parameter, as a share of the largest torque; none where there was no lab's model."""
        if not self.believed:
            return 0.0
        driven = self.rows.acceleration_rad_s2 if name == NAMES[0] else self.rows.rate_rad_s
        return abs(change) * float(np.abs(self.rows.means(driven)[self.usable]).max()) / self.full_scale

    def model_of(self, baseline: FloatArray, effects: Sequence[DescribedEffect], noise: float) -> dict[str, Any]:
        """The content of a model file, its table `[parts.drive]`; `noise` [N·m] is that of a row."""
        constant = {} if self.torque_constant_nm_per_a is None else {CONSTANT: self.torque_constant_nm_per_a}
        numbers = dict(zip(NAMES, baseline.tolist(), strict=True))
        found = tables_of(effects)
        return {"parts": {"drive": {**numbers, **constant, "noise_nm_rms": noise, EFFECTS: found}}}

    def remarks(self, before: FloatArray, after: FloatArray, heldout: BoolArray) -> tuple[str, ...]:
        """What this part has to say of residuals [N·m] before and after, shape (m,), and of what it cannot see."""
        del before, after, heldout
        said = [
            f"Torque and motion are compared as means over {1e3 * self.interval_s:.3g} ms: ripple and resonances beyond"
            f" {0.5 / self.interval_s:.3g} Hz, and play or twist between motor and encoder, cannot be seen."
        ]
        rate = self.rows.means(self.rows.rate_rad_s)[self.usable]
        if self.turns_one_way:
            said.append(
                "The table turns one way only: dry friction, which turns with the direction, and an offset of the"
                " torque, which does not, cannot be told apart."
            )
        if float(np.ptp(rate)) < 0.05 * float(np.abs(rate).max()):
            said.append(
                "The table turns at one rate only: inertia is hardly seen, and friction of any kind looks alike."
            )
        return tuple(said)

    def _signals(self, run: slice, torque_nm: FloatArray, inertia: float, viscous: float) -> DriveSignals:
        rows = self.rows
        return DriveSignals(
            time_s=rows.run_s[run],
            interval_s=rows.sample_interval_s,
            angle_deg=rows.angle_deg[run],
            rate_rad_s=rows.rate_rad_s[run],
            acceleration_rad_s2=rows.acceleration_rad_s2[run],
            torque_nm=torque_nm,
            inertia_kg_m2=inertia,
            viscous_nm_s=viscous,
        )


def drive_problem(
    recording: Recording, *, model: Mapping[str, Any] | None = None, without: Collection[str] = ()
) -> DriveProblem:
    """The problem of a drive's recording and of the model that its lab believes in.

    `model` is a table `[parts.drive]` of a model file: `inertia_kg_m2` and `viscous_nm_s`, or neither, and
    `torque_constant_nm_per_a` where the recording has a current in place of a torque. Where it has no numbers, a fit of
    the baseline is the start.

    Raises `UsageError` where the recording has no motion with torque, or the model a field that is not known.
    """
    told = numbers_of(model, "drive", NAMES, (CONSTANT, "noise_nm_rms"))
    constant = told.get(CONSTANT)
    rows = drive_rows_of(recording, constant)
    rate, acceleration = rows.means(rows.rate_rad_s), rows.means(rows.acceleration_rad_s2)
    believed = NAMES[0] in told
    if believed:
        start = np.array([told[name] for name in NAMES])
    else:
        columns = np.stack([acceleration, rate], axis=1)[rows.moving]
        start = np.linalg.lstsq(columns, rows.torque_nm[rows.moving], rcond=None)[0]
    full_scale = float(np.abs(rows.torque_nm[rows.moving]).max())
    if full_scale == 0.0:
        raise UsageError(
            f"{recording.path}: the torque is 0 throughout; name its column in the import's map, or record it"
        )
    return DriveProblem(
        rows=rows,
        effects={name: kind for name, kind in drive_effects().items() if name not in without},
        baseline_start=start,
        believed=believed,
        torque_constant_nm_per_a=constant,
        full_scale=full_scale,
        coordinates={
            "time": rows.time_s,
            "rate": np.degrees(rate),
            "abs_rate": np.abs(np.degrees(rate)),
            "rate_sign": np.where(rows.moving, np.sign(rate), 0.0),
            "acceleration": np.degrees(acceleration),
            "angle": np.mod(rows.means(rows.angle_deg), 360.0),
            "output": rows.torque_nm,
            "step": rows.infos_of_rows.step.astype(np.float64),
        },
    )
