"""Block means of many steps as flat arrays, the input of fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchctl.signals.reduce import ReducedStep
from benchctl_instruments.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """Consecutive blocks of several steps; arrays of shape (n,), `encoder_basis` (n, 4).

    `step` is the index of the step from 0 and `start`, shape (m,), the first row of each step; `dt_c` is T − T0, 0 if
    no thermistor was recorded. `expanded_at_s` is the delay for which each row's rate is given.
    """

    step: IntArray
    start: IntArray
    count: FloatArray
    time_s: FloatArray
    output_v: FloatArray
    rate_dps: FloatArray
    rate_at_stamp_dps: FloatArray
    spread_dps: FloatArray
    acceleration_dps2: FloatArray
    jerk_dps3: FloatArray
    dt_c: FloatArray
    encoder_basis: FloatArray
    expanded_at_s: FloatArray

    @property
    def steps(self) -> int:
        """Number of steps of these rows."""
        return int(self.start.size)

    def true_rate(self, delay_s: float) -> FloatArray:
        """Return the table's rate `delay_s` before each block, °/s, (n,); exact at 0, else expanded about its delay.

        (An expansion with a coarse encoder's third derivative must not be used far from its centre.)
        """
        if delay_s == 0.0:
            return self.rate_at_stamp_dps
        late = delay_s - self.expanded_at_s
        return self.rate_dps - late * self.acceleration_dps2 + 0.5 * late**2 * self.jerk_dps3

    @property
    def likely_delay_s(self) -> float:
        """Median of the delays about which the moving rows are expanded; 0 if nothing moves."""
        moving = self.acceleration_dps2 != 0.0
        return float(np.median(self.expanded_at_s[moving])) if moving.any() else 0.0

    def means(self, values: FloatArray) -> FloatArray:
        """Return means over each step, weighted by the samples; (n,) or (n, p) to (m,) or (m, p)."""
        weight = self.count if values.ndim == 1 else self.count[:, None]
        total = np.add.reduceat(self.count, self.start)
        summed = np.add.reduceat(values * weight, self.start, axis=0)
        averaged: FloatArray = summed / (total if values.ndim == 1 else total[:, None])
        return averaged


def gather(steps: Sequence[ReducedStep], T0_c: float) -> Rows:
    """Concatenate the blocks of some steps, at least one."""
    sizes = np.array([step.count.size for step in steps], dtype=np.int64)

    def column(name: str) -> FloatArray:
        return np.concatenate([getattr(step, name) for step in steps])

    return Rows(
        step=np.repeat(np.arange(len(steps), dtype=np.int64), sizes),
        start=np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64),
        count=column("count"),
        time_s=column("time_s"),
        output_v=column("output_v"),
        rate_dps=column("rate_dps"),
        rate_at_stamp_dps=column("rate_at_stamp_dps"),
        spread_dps=np.sqrt(column("rate_variance")),
        acceleration_dps2=column("acceleration_dps2"),
        jerk_dps3=column("jerk_dps3"),
        dt_c=np.nan_to_num(column("temperature_c") - T0_c),
        encoder_basis=column("encoder_basis"),
        expanded_at_s=np.repeat([step.delay_s for step in steps], sizes),
    )
