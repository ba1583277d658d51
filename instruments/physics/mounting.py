"""A gyro whose input axis lies across the table's: it is horizontal and turns with the table.

    Ω = ω·sin δ + Ω_E·cos φ·cos θ

with ω the table's rate, δ the misalignment, φ the latitude and θ the table's angle, at 0 of which the axis points
north. What the small angle adds to the Earth's part is left out; over whole revolutions that part is zero.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from benchctl_instruments.physics.chain import Baseline, Signals


def mounted_across(baseline: Baseline, misalignment_mrad: float, north_dps: float) -> Baseline:
    """The same gyro mounted across; `north_dps` is the Earth's rate about an axis that points north [deg/s]."""
    share = math.sin(1e-3 * misalignment_mrad)

    def sense(signals: Signals) -> Signals:
        heading = np.cos(np.radians(signals.angle_deg))
        return replace(signals, sensed_rate_dps=share * signals.rate_dps + north_dps * heading)

    return {**baseline, "sensed_rate": sense}
