"""A gyro whose input axis is perpendicular to the table's axis: horizontal, and turning with the table.

    Ω = ω·sin δ + Ω_E·cos φ·cos θ

with ω the table's rate, δ the misalignment, φ the latitude and θ the table's angle, at 0 of which the axis points
north. The effect of δ on the Earth's part is neglected; the mean of that part over complete revolutions is zero.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from benchctl_instruments.physics.chain import Baseline, Signals


def mounted_across(baseline: Baseline, misalignment_mrad: float, north_dps: float) -> Baseline:
    """Return the gyro's baseline for this mounting; `north_dps` is the Earth's rate about a northward axis [deg/s]."""
    share = math.sin(1e-3 * misalignment_mrad)

    def sense(signals: Signals) -> Signals:
        heading = np.cos(np.radians(signals.angle_deg))
        return replace(signals, sensed_rate_dps=share * signals.rate_dps + north_dps * heading)

    return {**baseline, "sensed_rate": sense}
