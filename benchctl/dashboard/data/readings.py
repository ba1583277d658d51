"""What was measured last in a campaign that runs, and the noise of the gyro's output over the last second."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from benchctl.dashboard.data.channels import ANGLE, MADE, RATE, recorded_as
from benchctl.dashboard.data.rates import GrowingRate
from benchctl.dashboard.data.step_feed import News
from benchctl.recordings.model import axis_of
from benchctl_instruments.arrays import FloatArray

NOISE_S = 1.0
_FEWEST = 10
_NONE: FloatArray = np.empty(0)
_CHANNELS = {
    "setpoint_c": MADE["setpoint_c"].of,
    "air_c": MADE["air_c"].of,
    "gyro_c": MADE["gyro_c"].of,
    "gyro_v": ("gyro_v", "poll_gyro_v"),
}
"""The quantities that are told, and the channels that they are taken from."""

_OF_A_STEP = (RATE, "angle_deg")
"""Quantities that nobody knows any more once the step is over in which they were recorded."""


class Readings:
    """The last values.

    `now_s` is the latest instant of the campaign's time that anything was recorded at, `index` and `kind` are those of
    the step that samples came of last, `streamed` its scans so far, `recorded` whether there is any sample of it.
    """

    def __init__(self) -> None:
        self.now_s: float | None = None
        self.kind = ""
        self.index: int | None = None
        self.streamed = 0
        self.recorded = False
        self._values: dict[str, float] = {}
        self._rate = GrowingRate(None)
        self._noise_s = self._noise_v = np.empty(0)

    @property
    def values(self) -> dict[str, float | None]:
        """Each quantity as it is known now; None where it is not."""
        told = {name: self._values.get(name) for name in (*_CHANNELS, *_OF_A_STEP)}
        return {**told, "noise_v_rms": self._noise_v_rms()}

    @property
    def noise_says(self) -> str:
        """Over what the noise was taken."""
        if len(self._noise_v) < _FEWEST:
            return ""
        return f"rms of the third differences of gyro_v, over √20, of the last {len(self._noise_v)} samples (1 s)"

    def take(self, news: News) -> Iterator[tuple[str, FloatArray, FloatArray]]:
        """Take new samples into account; channels as pages name them, with times and values, shape (n,) each."""
        if news.info.index != self.index:
            self._begin(news)
        for channel in (*news.channels, *MADE):
            recorded = recorded_as(channel, news.names)
            if channel == RATE or recorded is None or recorded not in news.channels:
                continue
            time_s, values = news.channels[axis_of(recorded)], news.channels[recorded]
            if time_s.size:
                yield channel, time_s, values
        if ANGLE in news.channels:
            yield RATE, *self._told_rate(*self._rate.add(news.channels["time_s"], news.channels[ANGLE]))
        if news.over:
            yield RATE, *self._rate.finish()
        self._see(news)

    def _begin(self, news: News) -> None:
        self.index, self.kind = news.info.index, news.info.kind
        self.streamed, self.recorded = 0, False
        self._rate = GrowingRate(news.info.sample_rate_hz)
        self._noise_s = self._noise_v = np.empty(0)
        for name in _OF_A_STEP:
            self._values.pop(name, None)

    def _told_rate(self, time_s: FloatArray, rates: FloatArray) -> tuple[FloatArray, FloatArray]:
        if rates.size and math.isfinite(rates[-1]):
            self._values[RATE] = float(rates[-1])
        return time_s, rates

    def _see(self, news: News) -> None:
        for name, channels in _CHANNELS.items():
            for channel in channels:
                if len(values := news.channels.get(channel, _NONE)) and math.isfinite(values[-1]):
                    self._values[name] = float(values[-1])
        if len(angles := news.channels.get(ANGLE, _NONE)) and math.isfinite(angles[-1]):
            self._values["angle_deg"] = float(angles[-1])
        for axis in ("time_s", "poll_time_s", "frame_time_s"):
            if len(times := news.channels.get(axis, _NONE)) and math.isfinite(times[-1]):
                self.now_s = max(float(times[-1]), self.now_s or 0.0)
        self.recorded |= any(map(len, news.channels.values()))
        if "gyro_v" in news.channels:
            self.streamed += len(news.channels["gyro_v"])
            self._noise_s = np.concatenate((self._noise_s, news.channels["time_s"]))
            self._noise_v = np.concatenate((self._noise_v, news.channels["gyro_v"]))
            last = np.searchsorted(self._noise_s, self._noise_s[-1:] - NOISE_S, side="right")
            if last.size:
                self._noise_s, self._noise_v = self._noise_s[last[0] :], self._noise_v[last[0] :]

    def _noise_v_rms(self) -> float | None:
        if len(self._noise_v) < _FEWEST:
            return None
        # third differences leave nothing of a sine's motion; of white noise they have 1 + 9 + 9 + 1 times its variance
        rms = float(np.sqrt(np.mean(np.square(np.diff(self._noise_v, 3)) / 20.0)))
        return rms if math.isfinite(rms) else None
