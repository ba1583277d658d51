"""Outliers: spikes that have nothing to do with the gyro, as a finding."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation
from scipy.stats import binom

from benchctl.diagnosis.faults.fault import Fault, Faults, bounded_gain
from benchctl.diagnosis.faults.single_rows import HALF, SingleRows, single_rows
from benchctl.diagnosis.faults.spike_sizes import spike_sizes
from benchctl.diagnosis.result import Estimate
from benchctl_instruments.physics.effects.outliers import Outliers

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

_SEEN, _MASKED = 10.0, 5.0
"""Sizes of the noise beyond which a row is a spike; beyond which it is masked where spikes are known to come.

The first is far out, as noise that grows with the rate may treble within the rows that it is judged by.
"""

_FEWEST = 3
_FEWEST_ROWS = 1000


_OWN = 1e-3
"""How often chance may bring so many of the spikes where the motion is sudden."""


def spikes_in(*, residual: FloatArray, usable: BoolArray, step_v: float, sudden: BoolArray) -> Faults:
    """Spikes in a residual (n,) of a provisional fit, which may miss much physics yet.

    Call it after `faults_in`, with rows as `usable` (n,) that have a motion and are not `standing` there; then fit
    again without the rows that are masked here. `step_v` is the converter's step as it shows in the values
    (`Faults.step_v`). Fewer than three spikes are masked only.

    Spikes come at any time: where more of them than chance brings are in rows whose motion is `sudden` (n,), it is the
    motion that stands out there, by a kink that the provisional fit does not know, and such rows are left alone.
    """
    masked = np.zeros(residual.size, np.bool_)
    rows = np.flatnonzero(usable)
    if rows.size < _FEWEST_ROWS:
        return Faults(found=(), masked=masked, standing=masked, step_v=step_v)
    values, floor = residual[rows], step_v / math.sqrt(12.0)
    # where rows were left out the residual jumps
    searched = ~binary_dilation(np.diff(rows, prepend=rows[:1] - 1) > 1, iterations=HALF)
    spikes = single_rows(values, searched, _SEEN, floor)
    if _is_of_motion(spikes.rows, searched, sudden[rows]):
        searched &= ~sudden[rows]
        spikes = single_rows(values, searched, _SEEN, floor)
    if spikes.rows.size < _FEWEST:
        masked[rows[spikes.rows]] = True
        return Faults(found=(), masked=masked, standing=np.zeros_like(masked), step_v=step_v)
    masked[rows[single_rows(values, searched, _MASKED, floor).rows]] = True
    found = _outliers(spikes, searched, masked)
    return Faults(found=(found,), masked=masked, standing=np.zeros_like(masked), step_v=step_v)


def _is_of_motion(spikes: IntArray, searched: BoolArray, sudden: BoolArray) -> bool:
    share = float(np.mean(sudden[searched])) if searched.any() else 0.0
    return bool(binom.sf(int(np.count_nonzero(sudden[spikes])) - 1, spikes.size, share) < _OWN)


def _outliers(spikes: SingleRows, searched: BoolArray, masked: BoolArray) -> Fault:
    limits = _SEEN * np.quantile(spikes.size[searched], (np.arange(100) + 0.5) / 100.0)
    rows, noise = int(np.count_nonzero(searched)), float(np.median(spikes.size))
    found = spike_sizes(spikes.heights, limits, rows, noise)
    effect = Outliers(fraction=found.fraction[0], scale_v=found.scale_v[0])
    own = spikes.size[spikes.rows]
    as_spikes = math.log(effect.fraction / effect.scale_v) - 0.5 * (spikes.heights / effect.scale_v) ** 2
    as_noise = -0.5 * (spikes.heights / own) ** 2 - np.log(own)
    return Fault(
        effect=effect.identifier,
        parameters={
            name: Estimate(value=value, low=low, high=high, unit=effect.parameters[name].unit)
            for name, (value, low, high) in (("fraction", found.fraction), ("scale_v", found.scale_v))
        },
        rows=masked,
        gain=bounded_gain(float(np.sum(as_spikes - as_noise))),
        says=effect.says(),
    )
