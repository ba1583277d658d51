"""The channels that a page can draw: recorded ones, and those derived from them, such as the rate.

The table's rate by its encoder is the change of the angle within a short time, divided by that time:

    rate(i) = (angle(i + h) - angle(i - h)) / (time(i + h) - time(i - h))

h is the smallest number of samples for which the window of 2 h samples is at least 0.05 s long. At the ends of a step
the window is moved inside the step. The angle is assumed to change by less than half a turn between samples, so that
the jump from 360 to 0 is not a motion. If samples are missing inside the window, the number of turns is not known and
the rate is NaN.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from benchctl.dashboard.data.stored import Samples
from benchctl.recordings.model import AXES, DESCRIPTIONS, Meta, axis_of
from benchctl.recordings.runs import TOLERANCE
from benchctl.recordings.schema import unit_of
from benchctl_instruments.arrays import FloatArray

WINDOW_S = 0.05
_TURN_DEG = 360.0
_LOOKED_AT = 4096


def half_window(rate_hz: float) -> int:
    """Return half of the window, in samples."""
    return max(1, math.ceil(round(0.5 * WINDOW_S * rate_hz, 6)))


def rates_dps(time_s: FloatArray, angle_deg: FloatArray, half: int, period_s: float) -> FloatArray:
    """Return the rate at each sample [°/s], all arrays (n,); NaN if a step has no more than 2 · half samples."""
    count = len(time_s)
    if count <= 2 * half:
        return np.full(count, np.nan)
    jumps = np.nan_to_num(np.rint(np.diff(angle_deg) / -_TURN_DEG), posinf=0.0, neginf=0.0)
    turns = np.concatenate(([0.0], np.cumsum(jumps)))
    # turns are integers: the difference does not depend on the first sample that is read
    moved_deg = angle_deg[2 * half :] - angle_deg[: -2 * half] + _TURN_DEG * (turns[2 * half :] - turns[: -2 * half])
    took_s = time_s[2 * half :] - time_s[: -2 * half]
    with np.errstate(divide="ignore", invalid="ignore"):
        inner = moved_deg / took_s
    inner[~(took_s < (2 * half + TOLERANCE) * period_s)] = np.nan
    return np.concatenate((np.full(half, inner[0]), inner, np.full(half, inner[-1])))


def period_of(time_s: Samples, rate_hz: float | None) -> float:
    """Return the sampling interval: from the stated rate, else the median of the first samples."""
    if rate_hz:
        return 1.0 / rate_hz
    first = np.diff(time_s.read(0, min(time_s.length, _LOOKED_AT)))
    return float(np.median(first)) if first.size else 1.0


class RateSamples:
    """The rate of a step as samples, computed from time and angle when read."""

    def __init__(self, time_s: Samples, angle_deg: Samples, rate_hz: float | None) -> None:
        self._time_s, self._angle_deg = time_s, angle_deg
        self._period_s = period_of(time_s, rate_hz)
        self.half = half_window(1.0 / self._period_s) if self._period_s > 0 else 1
        self.length = min(time_s.length, angle_deg.length)

    def read(self, first: int, end: int) -> FloatArray:
        """See `Samples`."""
        if end <= first:
            return np.empty(0)
        # at the ends of the step the window is moved, so that it contains samples from further inside
        low = max(0, min(first - self.half, self.length - 2 * self.half - 1))
        high = min(self.length, max(end + self.half, 2 * self.half + 1))
        rates = rates_dps(self._time_s.read(low, high), self._angle_deg.read(low, high), self.half, self._period_s)
        return rates[first - low : end - low]


class GrowingRate:
    """The rate of a step that is being recorded: of each sample as soon as enough samples follow."""

    def __init__(self, rate_hz: float | None) -> None:
        self._rate_hz = rate_hz
        self._time_s = self._angle_deg = np.empty(0)
        self._begun = False
        self._half = 0

    def add(self, time_s: FloatArray, angle_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Add samples, shape (n,); return times and rates that are known now, shape (m,)."""
        self._time_s = np.concatenate((self._time_s, time_s))
        self._angle_deg = np.concatenate((self._angle_deg, angle_deg))
        if not self._half:
            if self._rate_hz is None and len(self._time_s) > 1:
                self._rate_hz = 1.0 / max(float(np.median(np.diff(self._time_s))), 1e-9)
            self._half = half_window(self._rate_hz) if self._rate_hz else 0
        half = self._half
        if not half or self._rate_hz is None or len(self._time_s) <= 2 * half:
            return np.empty(0), np.empty(0)
        rates = rates_dps(self._time_s, self._angle_deg, half, 1.0 / self._rate_hz)
        known = slice(half + 1 if self._begun else 0, len(rates) - half)
        found = self._time_s[known], rates[known]
        self._begun = True
        window = slice(-2 * half - 1, None)  # its middle is the last sample whose rate is known
        self._time_s, self._angle_deg = self._time_s[window], self._angle_deg[window]
        return found

    def finish(self) -> tuple[FloatArray, FloatArray]:
        """Return the rates of the last samples of the step; their window is that of the previous one."""
        if not self._begun:
            return np.empty(0), np.empty(0)
        rates = rates_dps(self._time_s, self._angle_deg, self._half, 1.0 / (self._rate_hz or 1.0))
        return self._time_s[self._half + 1 :], rates[self._half + 1 :]


RATE = "rate_dps"
ANGLE = "encoder_deg"


@dataclass(frozen=True, slots=True)
class Made:
    """A derived channel: in each step computed from the first channel of `of` that exists there."""

    of: tuple[str, ...]
    unit: str
    says: str


MADE = {
    RATE: Made(
        (ANGLE,),
        "degree/s",
        f"rate of the table by its encoder: the angle's change over {WINDOW_S:g} s, or over two samples if longer",
    ),
    "air_c": Made(("poll_chamber_temp_c", "chamber_temp_c"), "degC", "air of the chamber"),
    "setpoint_c": Made(("poll_chamber_setpoint_c",), "degC", "set point of the chamber"),
    "gyro_c": Made(("gyro_temp_c", "poll_gyro_temp_c"), "degC", "thermistor in the housing of the gyro"),
}
"""Channels with one name for the page, independent of the name in the recording."""


def recorded_as(channel: str, names: Iterable[str]) -> str | None:
    """Return the name under which a step records a channel or its source; None: not in this step."""
    there = set(names)
    if channel in there and channel not in AXES:
        return channel
    return next((name for name in MADE[channel].of if name in there), None) if channel in MADE else None


def described(names: Iterable[str], meta: Meta) -> list[dict[str, str]]:
    """Return name, unit, meaning and axis of each channel of steps with these names, derived ones first."""
    there = [name for name in dict.fromkeys(names) if name not in AXES]
    made = [
        {"name": name, "unit": one.unit, "says": one.says, "axis": axis_of(next(of for of in one.of if of in there))}
        for name, one in MADE.items()
        if name not in there and any(of in there for of in one.of)
    ]
    recorded = [
        {
            "name": name,
            "unit": unit_in_words(name, meta),
            "says": meta.extra.get("channel_comments", {}).get(name) or DESCRIPTIONS.get(name, ""),
            "axis": axis_of(name),
        }
        for name in there
    ]
    return [*made, *recorded]


def unit_in_words(channel: str, meta: Meta) -> str:
    """Return the unit of a channel, empty if it is not known; the unit of the gyro's output is not always volts."""
    if channel in MADE:
        return MADE[channel].unit
    if channel == "gyro_v":
        return meta.output_unit
    return unit_of(channel, meta) or ""
