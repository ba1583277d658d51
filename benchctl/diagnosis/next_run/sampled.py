"""The noise of a sample, transferred to the rows of a plan that has not been run."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.signal

from benchctl.diagnosis.next_run.planned import Planned
from benchctl_instruments.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleNoise:
    """White noise of every sample [V], and the random walk of the bias in addition [V/√s]."""

    white_v: float
    walk_v_per_sqrt_s: float = 0.0

    def whitening(self, rows: Planned) -> Callable[[FloatArray], FloatArray]:
        """Return a function that whitens a column of a prediction (n,), to noise of deviation one.

        If the bias walks, every excerpt starts at an independent level, and its rows represent only themselves: the
        promised separation is then rather too small than too large.
        """
        if self.walk_v_per_sqrt_s <= 0.0:
            weight = np.sqrt(rows.stands_for) / self.white_v
            return lambda column: column * weight
        frame = rows.frame
        counting = rows.stands_for > 0.0
        inside = np.minimum(rows.stands_for, max(float(rows.stands_for[counting].min()), 1.0))
        white_v = self.white_v / math.sqrt(float(inside[counting].min()))
        ratio = self.walk_v_per_sqrt_s**2 * frame.interval_s / white_v**2
        gain = 0.5 * (math.sqrt(ratio * (ratio + 4.0)) - ratio)
        innovation_v = white_v / math.sqrt(1.0 - gain)

        def whiten(column: FloatArray) -> FloatArray:
            white = np.empty_like(column)
            for part in frame.stretches:
                values = np.where(counting[part], column[part], 0.0)
                level = counting[part].astype(np.float64)
                own, leaving = (
                    scipy.signal.lfilter([1.0, -1.0], [1.0, gain - 1.0], one) * level for one in (values, level)
                )
                white[part] = own - leaving * (float(leaving @ own) / max(float(leaving @ leaving), 1e-300))
            return white / innovation_v

        return whiten
