"""The digitizer's terminals with faults: samples that are stuck, out of range or off, and a crystal that drifts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchctl_instruments.interfaces import FloatArray, IntArray
from benchctl_instruments.simulated.faults.log import FaultLog
from benchctl_instruments.simulated.faults.machine_kinds import (
    ClockDrift,
    EncoderJump,
    MachineFault,
    OverRange,
    StuckReading,
)
from benchctl_instruments.simulated.faults.spells import spells
from benchctl_instruments.simulated.machines import AnalogInputs

Samples = tuple[IntArray, FloatArray, FloatArray]


class FaultyInputs:
    """An `AnalogInputs` around another one.

    A fault of the terminals begins with the scan whose instant it is, where it begins with its window, so that samples
    do not depend on how many are taken at once. Where the crystal drifts, every time that passes through here is the
    digitizer's own: fast by so much since bench time 0.

    Parameters
    ----------
    inputs
        The true ones.
    faults
        What befalls them; those of other machines are none of their business.
    log
        Where to note what has happened.
    """

    def __init__(self, inputs: AnalogInputs, faults: Sequence[MachineFault | ClockDrift], *, log: FaultLog) -> None:
        self._inputs = inputs
        self._pace = 1.0 + 1e-6 * sum(fault.ppm for fault in faults if isinstance(fault, ClockDrift))
        self._stuck = spells("digitizer", faults, StuckReading, log)
        self._over = spells("digitizer", faults, OverRange, log)
        self._jumps = spells("digitizer", faults, EncoderJump, log)
        self._before: tuple[int, float, float] | None = None  # the scan before this block

    def now(self) -> float:
        """The present instant, by the digitizer's crystal."""
        return self._inputs.now() * self._pace

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        """Block until an instant by the digitizer's crystal has come."""
        return self._inputs.wait_until(bench_time_s / self._pace, timeout_s)

    def hold_history(self, since_s: float | None) -> None:
        """Keep the motion since an instant by the digitizer's crystal."""
        self._inputs.hold_history(None if since_s is None else since_s / self._pace)

    def sample(self, first_s: float, interval_s: float, scans: int, *, start: int = 0) -> Samples:
        """Count, gyro volts and thermistor volts, each of shape (scans,)."""
        samples = self._inputs.sample(first_s / self._pace, interval_s / self._pace, scans, start=start)
        times_s = first_s + interval_s * np.arange(start, start + scans, dtype=np.float64)
        self._jump(samples, times_s)
        self._go_over_range(samples, times_s)
        self._stick(samples, times_s)
        self._before = int(samples[0][-1]), float(samples[1][-1]), float(samples[2][-1])
        return samples

    def _jump(self, samples: Samples, times_s: FloatArray) -> None:
        for jump in self._jumps:
            if jump.lasts("sample", float(times_s[-1])):
                samples[0][times_s >= jump.since_s] += jump.fault.counts

    def _go_over_range(self, samples: Samples, times_s: FloatArray) -> None:
        for over in self._over:
            if over.lasts("sample", float(times_s[-1])):
                column = samples[1] if over.fault.terminal == "gyro" else samples[2]
                column[times_s >= over.since_s] = over.fault.reads

    def _stick(self, samples: Samples, times_s: FloatArray) -> None:
        for stuck in self._stuck:
            if stuck.lasts("sample", float(times_s[-1])):
                first = int(np.searchsorted(times_s, stuck.since_s))
                kept = self._before if first == 0 else tuple(column[first - 1].item() for column in samples)
                for column, value in zip(samples, kept or tuple(c[0].item() for c in samples), strict=True):
                    column[first:] = value
