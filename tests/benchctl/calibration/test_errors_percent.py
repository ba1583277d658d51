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


def test_the_residual_of_stage_1_is_that_of_its_own_coefficients() -> None:
    result = calibrated()
    first, line, every = result.stages[0], result.raw, result.residuals
    turning = np.abs(every.acceleration_dps2) < 1e-3
    rate_dps = every.rate_dps[turning] + result.earth_rate_dps
    dt_c = every.temperature_c[turning] - result.T0_c
    volts = line.U0_v + line.K0_v_per_dps * (every.residual_dps["raw"][turning] + rate_dps)
    bias_v = first.U0_v + sum(c * dt_c**power for power, c in enumerate(first.u0_t, 1))
    corrected = (volts - bias_v) / first.K0_v_per_dps
    corrected *= 1.0 + sum(c * dt_c**power for power, c in enumerate(first.k_t.coefficients, 1))
    corrected *= 1.0 + sum(c * corrected ** (2 * power) for power, c in enumerate(first.k_omega.coefficients, 1))
    apart = every.residual_dps["stage_1"][turning] - (corrected - rate_dps)
    assert np.median(np.abs(apart)) < 1e-6
