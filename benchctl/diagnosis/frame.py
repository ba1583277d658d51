"""A recording of a gyro laid out for a diagnosis: one row a sample, every signal that the model is made of."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from benchctl.diagnosis.motion import Motion, motion_of
from benchctl.recordings.model import Step, StepInfo
from benchctl.recordings.reader import Recording
from instruments.errors import UsageError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

NEEDED = ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c")

_SMOOTH_S = 10.0
"""Temperatures are averaged over so much: a gyro's housing takes minutes, its thermistor's noise a sample."""

_FEWEST_ROWS = 2000
_GAP = 1.5
"""Sample intervals beyond which two rows do not belong to one stretch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """All samples of a recording in order; arrays of shape (n,).

    `step` is the index into `infos` of a row's step; `stretches` are the parts without gaps, `motions` theirs.
    `time_s` counts from the start of the recording. `temp_c` is the gyro's thermistor, smoothed.
    """

    infos: tuple[StepInfo, ...]
    interval_s: float
    time_s: FloatArray
    step: IntArray
    stretches: tuple[slice, ...]
    motions: tuple[Motion, ...]
    encoder_deg: FloatArray
    angle_deg: FloatArray
    rate_dps: FloatArray
    acceleration_dps2: FloatArray
    sudden: FloatArray
    volts: FloatArray
    temp_c: FloatArray
    temp_rate_c_per_s: FloatArray
    chamber_c: FloatArray
    auxiliary: dict[str, FloatArray]

    @property
    def rows(self) -> int:
        """The number of samples."""
        return int(self.time_s.size)


def frame_of(recording: Recording) -> Frame:
    """Read a recording into a frame.

    Raises `UsageError` where it has no scans of encoder, gyro and its thermistor, or too few of them.
    """
    steps = [step for step in recording.steps() if _has_scans(step)]
    if not steps:
        raise UsageError(
            f"{recording.path}: a diagnosis needs steps with the channels {', '.join(NEEDED)} in one scan;"
            f" it has {_channels_of(recording)}"
        )
    columns = {name: np.concatenate([step[name] for step in steps]) for name in NEEDED}
    time_s = columns["time_s"]
    if time_s.size < _FEWEST_ROWS:
        raise UsageError(
            f"{recording.path}: {time_s.size} samples with motion and output are too few to tell physics from noise;"
            f" a diagnosis needs {_FEWEST_ROWS} or more"
        )
    interval_s = float(np.median(np.diff(time_s)))
    stretches = tuple(_stretches(time_s, interval_s))
    place = np.repeat(np.arange(len(steps)), [step["time_s"].size for step in steps])
    unwrapped = [np.unwrap(columns["encoder_deg"][part], period=360.0) for part in stretches]
    motions = tuple(motion_of(angle, 1.0 / interval_s) for angle in unwrapped)
    temp, temp_rate = _smooth_temperature(time_s, columns["gyro_temp_c"], stretches, interval_s)
    chamber = [step.channels.get("chamber_temp_c", np.full(step["time_s"].size, np.nan)) for step in steps]
    extras = set.intersection(*(set(step.channels) for step in steps)) - set(NEEDED) - {"chamber_temp_c", "filled"}
    return Frame(
        infos=tuple(step.info for step in steps),
        interval_s=interval_s,
        time_s=time_s,
        step=place,
        stretches=stretches,
        motions=motions,
        encoder_deg=np.concatenate(unwrapped),
        angle_deg=np.concatenate([motion.angle_deg for motion in motions]),
        rate_dps=np.concatenate([motion.rate_dps for motion in motions]),
        acceleration_dps2=np.concatenate([motion.acceleration_dps2 for motion in motions]),
        sudden=np.concatenate([motion.sudden for motion in motions]),
        volts=columns["gyro_v"],
        temp_c=temp,
        temp_rate_c_per_s=temp_rate,
        chamber_c=np.concatenate(chamber),
        auxiliary={
            name: np.concatenate([step[name] for step in steps])
            for name in sorted(extras)
            if not name.startswith("poll_")
        },
    )


def _has_scans(step: Step) -> bool:
    return all(name in step.channels for name in NEEDED) and step["time_s"].size > 1


def _channels_of(recording: Recording) -> str:
    names = {name for info in recording.infos for name in recording.channels(info.index)}
    return ", ".join(sorted(names)) or "none"


def _stretches(time_s: FloatArray, interval_s: float) -> Iterator[slice]:
    """Parts without gaps that are long enough for a filter; shorter ones are joined to nothing and kept."""
    ends = np.flatnonzero(np.diff(time_s) > _GAP * interval_s) + 1
    bounds = np.concatenate([[0], ends, [time_s.size]])
    for first, last in itertools.pairwise(bounds.tolist()):
        yield slice(first, last)


def _smooth_temperature(
    time_s: FloatArray, temp_c: FloatArray, stretches: tuple[slice, ...], interval_s: float
) -> tuple[FloatArray, FloatArray]:
    """The thermistor without its noise, and how fast it changes [°C/s]: two running means in a row, shape (n,) each."""
    window = max(1, int(_SMOOTH_S / 2 / interval_s))
    smooth, rate = np.empty_like(temp_c), np.empty_like(temp_c)
    for part in stretches:
        values = temp_c[part]
        size = min(window, max(1, values.size // 4))
        smooth[part] = _twice(values, size)
        slope = np.gradient(smooth[part], interval_s) if values.size > 2 else np.zeros_like(values)
        rate[part] = _twice(slope, size)
    return smooth, rate


def _twice(values: FloatArray, size: int) -> FloatArray:
    once: FloatArray = uniform_filter1d(values, size, mode="nearest")
    twice: FloatArray = uniform_filter1d(once, size, mode="nearest")
    return twice
