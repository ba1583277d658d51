"""Synthetic campaigns that several tests share, calibrated once."""

from __future__ import annotations

from functools import cache

from benchctl.calibration.calibrate import calibrate
from benchctl.calibration.result import CalibrationOptions, CalibrationResult
from benchctl.recordings.model import Step
from tests.benchctl.calibration.synthetic import Truth, meta_of, steps, two_stage

TRUTH = Truth()


@cache
def recorded(seed: int = 1) -> tuple[Step, ...]:
    """The paper's campaign in small."""
    return tuple(steps(TRUTH, two_stage(), seed))


@cache
def calibrated(seed: int = 1) -> CalibrationResult:
    """Its calibration with the default options."""
    return calibrate(iter(recorded(seed)), meta_of(TRUTH), CalibrationOptions())
