"""The one number."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.calibration.calibrate import largest, percent
from tests.benchctl.calibration.campaigns import calibrated


def test_the_error_is_the_largest_residual_over_the_largest_rate() -> None:
    error, rms = percent(np.array([0.1, -0.5, 0.2]), np.array([10.0, -50.0, 20.0]))
    assert error == pytest.approx(1.0)
    assert rms == pytest.approx(100 * np.sqrt((0.01 + 0.25 + 0.04) / 3) / 50)


def test_a_rate_that_the_law_cannot_give_is_a_whole_error() -> None:
    assert percent(np.array([0.1, np.nan]), np.array([10.0, -50.0]))[0] == 100.0


def test_the_recordings_error_is_the_largest_over_runs_kept_aside() -> None:
    runs = calibrated().runs
    aside = [run for run in runs if run.role == "verify"]
    errors, rms = largest(runs)
    assert len(aside) == 4
    assert errors["stage_2"] == max(run.error_percent["stage_2"] for run in aside)
    assert rms["stage_2"] == max(run.rms_percent["stage_2"] for run in aside)
    assert largest([run for run in runs if run.role == "fit"]) == ({}, {})


def test_residuals_and_errors_are_the_same_numbers() -> None:
    result = calibrated()
    run = next(run for run in result.runs if run.role == "verify")
    own = result.residuals.step == run.step
    assert np.all(result.residuals.verify[own])
    assert np.all(result.residuals.block_s[own] <= 0.0401)
    again = percent(result.residuals.residual_dps["raw"][own], result.residuals.rate_dps[own])
    assert again == (run.error_percent["raw"], run.rms_percent["raw"])
