"""A two-stage campaign of any number of scans, made in memory step by step and written by our own writer.

Its steps are those of the procedure `two_stage` without soaks: 307 of them, 20 set points, 3.3 h on the table. So many
scans are a matter of the sampling rate: at 500 Hz there are 5.9 million, 10⁸ are at 8.5 kHz. The thermistor's samples
are as coarse as its converter's, so that they pack as those of the bench do.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchctl.plan import levels, set_points, whole_cycles, whole_revolutions
from benchctl.plan.patterns import alternating
from benchctl.recordings.model import Step
from benchctl.recordings.writer import write_recording
from tests.benchctl.calibration.synthetic import Ask, Truth, meta_of, steps

_CODE_C = 2e-3
_RUN_S, _ZERO_S, _SINE_DPS = 30.0, 60.0, 165.0


def write_campaign(path: Path, scans: float, *, seed: int = 1) -> None:
    """Write one of about so many scans."""
    asks = list(_asks())
    truth = Truth(fs=round(scans / sum(ask.seconds for ask in asks), 1))
    write_recording(path, meta_of(truth), (_coarse(step) for step in steps(truth, asks, seed)))


def _coarse(step: Step) -> Step:
    celsius = np.round(step["gyro_temp_c"] / _CODE_C) * _CODE_C
    return Step(step.info, {**step.channels, "gyro_temp_c": celsius})


def _asks() -> Iterator[Ask]:
    yield from _rates(20.0, levels(170.0, 17))
    yield from _sines(20.0, (0.25, 0.5, 1.0), "fit")
    for i, celsius in enumerate(set_points(-40.0, 60.0, 20)):
        yield from _rates(celsius, levels(50.0, 5))
        if i % 4 == 0 or i == 19:
            yield from _sines(celsius, (0.25, 0.5, 1.0), "fit")
        elif i % 4 == 2:
            yield from _sines(celsius, (0.4, 0.8), "verify")


def _rates(celsius: float, rates_dps: tuple[float, ...]) -> Iterator[Ask]:
    zero = Ask(kind="static", temperature=celsius, seconds=_ZERO_S)
    yield zero
    for rate in alternating(rates_dps):
        seconds = whole_revolutions(rate, _RUN_S)
        yield Ask(kind="constant_rate", temperature=celsius, rate=rate, seconds=seconds)
    yield zero


def _sines(celsius: float, frequencies_hz: tuple[float, ...], role: str) -> Iterator[Ask]:
    for hz in frequencies_hz:
        seconds = whole_cycles(hz, _RUN_S) / hz
        yield Ask(kind="sine", temperature=celsius, rate=_SINE_DPS, frequency=hz, seconds=seconds, role=role)
