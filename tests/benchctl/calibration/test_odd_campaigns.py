"""Campaigns that a lab would not plan but does record: what can be said of them, and what is not said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from benchctl.calibration.calibrate import calibrate
from benchctl.calibration.result import CalibrationResult
from benchctl.recordings.model import Step
from benchctl_instruments.errors import UsageError
from tests.benchctl.calibration.campaigns import TRUTH, recorded
from tests.benchctl.calibration.synthetic import Ask, meta_of, steps, two_stage

Channels = dict[str, npt.NDArray[np.float64]]


def turning(rate: float, temperature: float = 20.0) -> Ask:
    return Ask(kind="constant_rate", temperature=temperature, rate=rate, seconds=10.0)


def rest(temperature: float = 20.0) -> Ask:
    return Ask(kind="static", temperature=temperature, seconds=10.0)


def sine(temperature: float, frequency: float) -> Ask:
    return Ask(kind="sine", temperature=temperature, rate=100.0, frequency=frequency, seconds=20.0)


def fitted(asks: list[Ask], seed: int = 1) -> CalibrationResult:
    return calibrate(steps(TRUTH, asks, seed), meta_of(TRUTH))


def spoilt(spoil: Callable[[Channels], None]) -> CalibrationResult:
    """The small campaign, every step's channels changed in place."""
    changed = []
    for step in recorded():
        channels = {name: samples.copy() for name, samples in step.channels.items()}
        spoil(channels)
        changed.append(Step(step.info, channels))
    return calibrate(iter(changed), meta_of(TRUTH))


@pytest.mark.parametrize(
    "asks",
    [
        [rest(), turning(100), turning(-100), rest()],
        [rest(), turning(100), rest()],
        [turning(100), turning(-100)],
        [turning(rate, t) for t in (-20.0, 20.0, 60.0) for rate in (100.0, -100.0)],
        [turning(100), turning(150)],
    ],
)
def test_one_magnitude_of_rate_gives_a_line_and_no_bend(asks: list[Ask]) -> None:
    result = fitted(asks)
    assert result.best.law == "polynomial"
    assert not any(p.name[0] == "b" for p in result.best.parameters)
    assert all(np.isfinite(p.ci95).all() for p in result.best.parameters)
    assert any("No term in ω" in warning for warning in result.warnings)


def test_three_rates_of_one_direction_tell_the_sine() -> None:
    best = fitted([turning(50), turning(100), turning(150)]).best
    assert best.value("S_rad_per_dps") == pytest.approx(TRUTH.S, rel=1e-3)


def test_one_rate_at_other_temperatures_gives_no_term_in_temperature() -> None:
    asks = [rest(), *(turning(r) for r in (20, -20, 40, -40, 90, -90, 140, -140)), rest()]
    best = fitted([*asks, turning(50, -20.0), turning(50, 40.0)]).best
    assert not any(p.name[0] in "gc" for p in best.parameters)


def test_a_sweep_of_low_rates_still_shows_the_sine() -> None:
    asks = two_stage(temperatures=(-20.0, 20.0, 60.0), rates=(10.0, 20.0, 30.0, 40.0, 50.0), amplitude=50.0)
    result = fitted([ask for ask in asks if ask.kind != "sine"])
    assert result.best.law == "sine"
    low, high = next(p.ci95 for p in result.best.parameters if p.name == "S_rad_per_dps")
    assert low < TRUTH.S < high
    assert result.T0_c == 20.0


def test_sines_with_one_constant_rate_are_fitted_like_sines_alone() -> None:
    result = fitted([turning(50), sine(20.0, 0.5), sine(20.0, 0.25)])
    assert result.best.value("K0_v_per_dps") == pytest.approx(TRUTH.K0, rel=1e-4)
    assert any("straight line through the runs in motion" in warning for warning in result.warnings)


def test_a_scale_factor_from_fast_rates_is_said_to_be() -> None:
    result = fitted([turning(rate) for rate in (60, -60, 100, -100, 150, -150)])
    assert any("K0 is a slope over rates up to 60 °/s" in warning for warning in result.warnings)


def test_a_line_through_two_readings_at_rest_and_one_rate_claims_no_uncertainty() -> None:
    (point,) = fitted([rest(), turning(50), rest()]).temperatures
    assert np.isnan(point.slope_standard)


def test_a_recording_whose_runs_are_all_kept_aside_is_refused() -> None:
    asks = [replace(ask, role="verify") for ask in two_stage(temperatures=(20.0,))]
    with pytest.raises(UsageError, match="no step that can be used for a fit"):
        fitted(asks)


def test_rest_kept_aside_measures_no_error_and_it_is_said() -> None:
    asks = [replace(rest(), role="verify"), *(turning(rate) for rate in (20, -20, 40, -40))]
    result = fitted(asks)
    assert result.error_percent == {}
    assert any("all at rest" in warning for warning in result.warnings)
    assert not any("measured on them alone" in note for note in result.notes)


def test_a_single_sine_is_fitted_without_a_warning_of_the_arithmetic() -> None:
    result = fitted([sine(20.0, 0.5)])
    low, high = next(p.ci95 for p in result.best.parameters if p.name == "K0_v_per_dps")
    assert 0 < high - low < 1e-3 * TRUTH.K0


def test_samples_that_were_filled_in_are_left_out() -> None:
    def spoil(channels: Channels) -> None:
        channels["filled"] = np.zeros(channels["time_s"].size)
        channels["filled"][500::997] = 1.0
        channels["gyro_v"][500::997] += 0.5

    result = spoilt(spoil)
    assert result.samples_masked > 100
    assert result.error_percent["joint"] < 0.03


def test_angles_that_are_missing_break_the_run_and_spoil_nothing() -> None:
    def spoil(channels: Channels) -> None:
        channels["encoder_deg"][500::997] = np.nan

    result = spoilt(spoil)
    assert result.samples_masked > 100
    assert result.error_percent["joint"] < 0.03


def test_a_recording_without_a_thermistor_is_fitted_and_says_so() -> None:
    def spoil(channels: Channels) -> None:
        del channels["gyro_temp_c"]

    result = spoilt(spoil)
    assert any("No thermistor" in warning for warning in result.warnings)
    assert not any(p.name[0] in "gc" for p in result.best.parameters)
