"""A drive's recording as rows for a diagnosis: the motion, and the torque that it requires.

The torque is not integrated to a rate, as its noise would become a random walk. Instead the motion, a measurement with
its own noise, is differentiated, and both are compared as means over equal intervals. The mean of an acceleration is a
difference of two rates, so it needs no content beyond the band of the motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from benchctl.diagnosis.drive.spoilt import TURN_DEG, MovingRows, angle_period_of, put_right
from benchctl.diagnosis.faults.fault import Fault
from benchctl.diagnosis.series import Pieces, Series, channel_names, cut, series_of, since_recorded_s
from benchctl.recordings.reader import Recording
from benchctl.recordings.runs import holding
from benchctl.signals.blocks import block_mean, consecutive
from benchctl.signals.motion import motion_of
from benchctl.signals.normal import white_noise_of
from benchctl.signals.rate import half_of, unwrap_deg
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.errors import UsageError

_SAMPLE_RATE_HZ = 100.0
"""Samples are averaged to this rate or slightly above: the band of the motion ends below 20 Hz."""

BLOCK = 5
"""Samples per row: two rows per period of the fastest motion that the rate follows (a tenth of the sample rate)."""

_FEWEST_ROWS = 60
_RESTING_DEVIATIONS = 5.0
_RESTING_SHARE = 0.002
"""A rate below so many noise deviations, or below this share of the largest, is rest: the table may stick."""
_ROUNDING = 1e-9
"""Share of the angle's range below which a difference of two angles is a rounding error."""

ANGLES = ("encoder_deg", "velocity_rad_s", "table_rate_dps")
TORQUES = ("torque_nm", "current_a", "drive_load")
"""The torque, a current with its constant, or a substitute for the torque in another unit (such as PWM counts)."""

_FEWEST_AT_REST = 5
"""Minimum rows of a rest: a table that only reverses is slow for a shorter time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveRows:
    """Samples of shape (n,) within `runs`; rows of shape (m,) made of `BLOCK` samples each, within `stretches`.

    `time_s` is the time of the rows, `clock_s` the time since the start of the recording that they belong to, if
    several were joined, and `run_s` the time of the samples since the start of their run. `torque_nm` (m,) is measured,
    in `unit`. `moving` rows are those in which the table turns, with complete windows of angles. At rest, friction
    balances any torque below its limit: `rests` are groups of rows without motion. Neither includes rows spoilt by
    `faults` of the data, whose rows are (m,).
    """

    infos_of_rows: Pieces
    sample_interval_s: float
    runs: tuple[slice, ...]
    run_s: FloatArray
    angle_deg: FloatArray
    rate_rad_s: FloatArray
    acceleration_rad_s2: FloatArray
    stretches: tuple[slice, ...]
    time_s: FloatArray
    clock_s: FloatArray
    torque_nm: FloatArray
    unit: str
    moving: BoolArray
    rests: tuple[slice, ...]
    faults: tuple[Fault, ...]

    @property
    def sampled_s(self) -> FloatArray:
        """Time of the samples since the start of their recording [s], shape (n,)."""
        first_s = self.clock_s[[rows.start for rows in self.stretches]] - 0.5 * (BLOCK - 1) * self.sample_interval_s
        return np.repeat(first_s, [run.stop - run.start for run in self.runs]) + self.run_s

    def means(self, samples: FloatArray) -> FloatArray:
        """Return the means of samples (n,) over the rows (m,)."""
        return np.concatenate([block_mean(samples[run], BLOCK) for run in self.runs])


def drive_rows_of(recording: Recording, torque_constant_nm_per_a: float | None = None) -> DriveRows:
    """Read a recording of a drive.

    The motion is that of `encoder_deg`, or the integral of `velocity_rad_s` or `table_rate_dps`. The torque is
    `torque_nm`, or `current_a` multiplied by the torque constant.

    Raises `UsageError` if motion or torque is missing, or if the table hardly moves.
    """
    series = _series(recording, torque_constant_nm_per_a)
    factor = max(1, int(1.0 / series.interval_s / _SAMPLE_RATE_HZ + 1e-6))
    interval_s = factor * series.interval_s
    shortest = factor * (2 * half_of(1.0 / interval_s) + BLOCK)
    runs = [run for run in series.runs if run.stop - run.start >= shortest]
    if not runs:
        raise UsageError(
            f"{recording.path}: no {shortest} samples in a row: too short to tell an acceleration from noise; "
            "record longer, without gaps"
        )
    period_deg, wrap = TURN_DEG, None
    if "encoder_deg" in series.columns:
        period_deg, wrap = angle_period_of(series.columns["encoder_deg"], series.runs)
    angles = [block_mean(_angle(series, run, period_deg), factor) for run in runs]
    angles = [angle[: angle.size // BLOCK * BLOCK] for angle in angles]
    motions = [motion_of(angle, 1.0 / interval_s) for angle in angles]
    source = next(name for name in TORQUES if name in series.columns)
    constant = float(torque_constant_nm_per_a or 0.0) if source == "current_a" else 1.0
    units = recording.meta.extra.get("channel_units", {})
    width = factor * BLOCK

    def rows_of(samples: FloatArray) -> FloatArray:
        return np.concatenate([block_mean(samples[run], width) for run in runs])

    turning = np.concatenate(
        [_turning(angle, motion.rate_dps, interval_s) for angle, motion in zip(angles, motions, strict=True)]
    )
    half = half_of(1.0 / interval_s)
    whole_windows = np.concatenate([_inner(angle.size, half) for angle in angles])
    time_s = rows_of(series.time_s)
    step = np.concatenate([series.step[run][: (run.stop - run.start) // width * width : width] for run in runs])
    rows = DriveRows(
        infos_of_rows=cut(series.infos, step, time_s),
        sample_interval_s=interval_s,
        runs=consecutive([angle.size for angle in angles]),
        run_s=np.concatenate([np.arange(angle.size) * interval_s for angle in angles]),
        angle_deg=np.concatenate([motion.angle_deg for motion in motions]),
        rate_rad_s=np.concatenate([np.radians(motion.rate_dps) for motion in motions]),
        acceleration_rad_s2=np.concatenate([np.radians(motion.acceleration_dps2) for motion in motions]),
        stretches=consecutive([angle.size // BLOCK for angle in angles]),
        time_s=time_s,
        clock_s=since_recorded_s(recording, time_s),
        torque_nm=constant * rows_of(series.columns[source]),
        unit=str(units.get(source, "1")) if source == "drive_load" else "N m",
        moving=(turning & whole_windows).reshape(-1, BLOCK).all(axis=1),
        rests=(),
        faults=(),
    )
    torque = put_right(
        constant * series.columns[source],
        series.runs,
        MovingRows(columns=_columns(rows), moving=rows.moving, means=rows_of),
    )
    still = (~turning & whole_windows).reshape(-1, BLOCK).all(axis=1)
    rows = replace(
        rows,
        torque_nm=torque.rows_nm,
        moving=rows.moving & ~torque.spoilt,
        rests=_rests(still & ~torque.spoilt),
        faults=torque.faults if wrap is None else (wrap.on_rows(np.zeros(time_s.size, np.bool_)), *torque.faults),
    )
    if int(rows.moving.sum()) < _FEWEST_ROWS:
        raise UsageError(
            f"{recording.path}: the table turns for {int(rows.moving.sum()) * BLOCK * interval_s:.3g} s only;"
            f" a diagnosis of its drive needs {_FEWEST_ROWS * BLOCK * interval_s:.3g} s of motion or more"
        )
    return rows


def _series(recording: Recording, torque_constant_nm_per_a: float | None) -> Series:
    """Return the samples with the preferred motion channel and torque channel of the recording."""
    available = channel_names(recording)
    angle = next((name for name in ANGLES if name in available), ANGLES[0])
    torque = next((name for name in TORQUES if name in available), TORQUES[0])
    series = series_of(recording, (angle, torque), polled=False)
    if torque == "current_a" and not torque_constant_nm_per_a:
        raise UsageError(
            f"{recording.path}: has a current and no torque_nm;"
            " say torque_constant_nm_per_a in [drive] of the import's map, or in [parts.drive] of a --model FILE"
        )
    return series


def _angle(series: Series, run: slice, period_deg: float) -> FloatArray:
    """Return the unwrapped angle [deg] of a run, shape (n,)."""
    if "encoder_deg" in series.columns:
        return unwrap_deg(series.columns["encoder_deg"][run], period_deg)
    name = next(name for name in ANGLES if name in series.columns)
    rate = series.columns[name][run] * (1.0 if name == "table_rate_dps" else math.degrees(1.0))
    turned = np.cumsum((rate[1:] + rate[:-1]) / 2) * series.interval_s
    return np.concatenate([[0.0], turned])


def _columns(rows: DriveRows) -> FloatArray:
    """Return the main components of a torque, shape (m, 6): inertia, friction, an offset, an unbalanced weight."""
    rate, angle = rows.means(rows.rate_rad_s), np.radians(rows.means(rows.angle_deg))
    acceleration = rows.means(rows.acceleration_rad_s2)
    return np.stack([acceleration, rate, np.sign(rate), np.ones(rate.size), np.sin(angle), np.cos(angle)], axis=1)


def _turning(angle_deg: FloatArray, rate_dps: FloatArray, interval_s: float) -> BoolArray:
    """Return the samples whose rate exceeds the noise of the encoder."""
    angle, rate_rad_s = np.radians(angle_deg), np.radians(rate_dps)
    steps = np.abs(np.diff(angle))
    counts = steps[steps > _ROUNDING * float(np.ptp(angle))]
    # an encoder at rest shows no noise, but motion within one of its counts is unknown
    resolution = float(counts.min()) / math.sqrt(12.0) if counts.size else 0.0
    noise = max(white_noise_of(angle), resolution)
    band_hz = 0.1 / interval_s
    floor = noise * 2 * math.pi * band_hz * math.sqrt(2.0 * band_hz * interval_s / 3.0)
    slowest = max(_RESTING_DEVIATIONS * floor, _RESTING_SHARE * float(np.abs(rate_rad_s).max()))
    return np.abs(rate_rad_s) > slowest


def _inner(size: int, half: int) -> BoolArray:
    """Return the samples of a run with complete windows of angles around them, shape (size,)."""
    inner = np.zeros(size, np.bool_)
    inner[half:-half] = True
    return inner


def _rests(still: BoolArray) -> tuple[slice, ...]:
    """Return the groups of rows, shape (m,), in which the table is at rest long enough."""
    return tuple(run for run in holding(still) if run.stop - run.start >= _FEWEST_AT_REST)
