"""Swings fitted by their harmonics."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.metrology import swings
from benchctl.metrology.swings import fitted
from benchctl.recordings.mapped import FILLED
from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit

RATE_HZ = 50.0
META = Meta(
    status="complete",
    unit=Unit(serial="1", range_dps=50.0),
    bench=BenchFacts(sample_rate_hz=RATE_HZ, adc_bits=16, adc_range_v=10.0),
)


def swing(
    *,
    amplitude_dps: float = 40.0,
    hz: float = 0.5,
    cycles: float = 15,
    lag_s: float = 0.004,
    cubic: float = 0.0,
    drift_dps: float = 0.0,
    clock: float = 0.0,
    noise_v: float = 0.0,
    begins_s: float = 1234.5,
) -> Step:
    """U = 0.05·(ω(t − lag) + cubic·ω³) + 0.2; the stamps run fast by `clock`."""
    own_s = np.arange(int(cycles / hz * RATE_HZ)) / RATE_HZ
    omega = 2.0 * np.pi * hz
    late_dps = amplitude_dps * np.cos(omega * (own_s - lag_s)) + drift_dps
    noise = noise_v * np.random.default_rng(1).standard_normal(own_s.size)
    info = StepInfo(index=1, name="sine", kind="sine", t_start=0.0, t_end=1.0, chamber_setpoint_c=20.0)
    return Step(
        info,
        {
            "time_s": begins_s + own_s * (1.0 + clock),
            "encoder_deg": np.mod(350.0 + amplitude_dps / omega * np.sin(omega * own_s) + drift_dps * own_s, 360.0),
            "gyro_v": 0.05 * (late_dps + cubic * late_dps**3) + 0.2 + noise,
        },
    )


def test_the_rate_is_the_angles_without_differentiating_it() -> None:
    found = fitted(swing(), 0.5, META)
    assert found is not None
    expected = 40.0 * np.cos(2.0 * np.pi * 0.5 * (found.time_s - 1234.5))
    assert found.rate_dps == pytest.approx(expected, abs=1e-6)
    assert abs(found.rate_phasor) == pytest.approx(40.0, rel=1e-9)
    assert found.left_v == pytest.approx(np.zeros(found.left_v.size), abs=1e-9)


def test_the_output_lags_by_its_delay() -> None:
    found = fitted(swing(lag_s=0.01), 0.5, META)
    assert found is not None
    ratio = found.output_phasor / found.rate_phasor
    assert abs(ratio) == pytest.approx(0.05, rel=1e-9)
    assert np.angle(ratio) == pytest.approx(-2.0 * np.pi * 0.5 * 0.01, rel=1e-6)


def test_a_table_that_turns_on_while_it_swings_has_its_mean_rate() -> None:
    found = fitted(swing(drift_dps=3.0), 0.5, META)
    assert found is not None
    assert float(np.mean(found.rate_dps)) == pytest.approx(3.0, abs=1e-6)


def test_harmonics_of_a_curved_gyro_are_no_noise() -> None:
    found = fitted(swing(cubic=1e-5), 0.5, META)
    assert found is not None
    assert abs(found.output_phasor) == pytest.approx(0.05 * (40.0 + 0.75 * 1e-5 * 40.0**3), rel=1e-6)
    assert float(np.std(found.left_v)) < 1e-9


@pytest.mark.parametrize("clock", [100e-6, -100e-6])
@pytest.mark.parametrize("cycles", [15, 150])
def test_stamps_of_a_clock_that_is_off_are_believed_and_the_frequency_is_not(clock: float, cycles: int) -> None:
    """Over 150 periods at a frequency that is 100 ppm off, the phase would run away by 5 degrees."""
    found = fitted(swing(clock=clock, cycles=cycles, lag_s=0.0), 0.5, META)
    assert found is not None
    ratio = found.output_phasor / found.rate_phasor
    assert abs(found.rate_phasor) == pytest.approx(40.0 / (1.0 + clock), rel=1e-8)  # by the stamps it is slower
    assert np.angle(ratio) == pytest.approx(0.0, abs=1e-6)
    assert float(np.std(found.left_v)) < 1e-6


def test_what_is_left_is_the_noise() -> None:
    found = fitted(swing(noise_v=1e-3, cycles=100), 0.5, META)
    assert found is not None
    assert float(np.std(found.left_v)) == pytest.approx(1e-3, rel=0.05)


def test_single_samples_that_are_missing_are_left_out() -> None:
    step = swing()
    step["gyro_v"][10:20] = np.nan
    step["encoder_deg"][100] = np.nan
    found = fitted(step, 0.5, META)
    assert found is not None
    assert found.time_s.size == step["time_s"].size - 11
    assert abs(found.rate_phasor) == pytest.approx(40.0, rel=1e-9)


def test_samples_that_are_clipped_or_filled_in_are_left_out() -> None:
    step = swing()
    filled = np.zeros(step["time_s"].size)
    step["gyro_v"][10:15] = 10.0
    step["gyro_v"][700:800], filled[700:800] = 0.3, 1.0
    found = fitted(Step(step.info, {**step.channels, FILLED: filled}), 0.5, META)
    assert found is not None
    assert found.time_s.size == step["time_s"].size - 105
    assert abs(found.output_phasor / found.rate_phasor) == pytest.approx(0.05, rel=1e-9)


def test_a_swing_that_is_clipped_in_every_period_is_none() -> None:
    step = swing(amplitude_dps=250.0)
    np.clip(step["gyro_v"], -10.0, 10.0, out=step["gyro_v"])
    assert fitted(step, 0.5, META) is None


@pytest.mark.parametrize("channel", ["encoder_deg", "gyro_v"])
def test_a_swing_without_a_sample_is_none(channel: str) -> None:
    step = swing()
    step[channel][:] = np.nan
    assert fitted(step, 0.5, META) is None
    whole = swing()
    assert (
        fitted(Step(whole.info, {name: whole[name] for name in whole.channels if name != channel}), 0.5, META) is None
    )


@pytest.mark.parametrize(("hz", "cycles"), [(20.5, 40), (25.0, 40), (24.0, 100), (10.0, 1)])
def test_a_swing_that_hardly_a_sample_sees_is_none(hz: float, cycles: float) -> None:
    assert fitted(swing(hz=hz, cycles=cycles), hz, META) is None


@pytest.mark.parametrize(("hz", "cycles"), [(0.5, 1), (1.0, 1), (19.0, 40), (5.0, 2)])
def test_short_and_fast_swings_are_fitted_by_fewer_harmonics(hz: float, cycles: float) -> None:
    found = fitted(swing(hz=hz, cycles=cycles, lag_s=0.0), hz, META)
    assert found is not None
    assert abs(found.output_phasor / found.rate_phasor) == pytest.approx(0.05, rel=1e-6)


@pytest.mark.parametrize("strip", [1, 100, 1499, 1500])
def test_the_fit_does_not_depend_on_the_strips_it_is_gathered_in(strip: int, monkeypatch: pytest.MonkeyPatch) -> None:
    step = swing(cubic=3e-6, drift_dps=1.0, noise_v=1e-4, clock=1e-4)
    whole = fitted(step, 0.5, META)
    monkeypatch.setattr(swings, "_STRIP", strip)
    found = fitted(step, 0.5, META)
    assert found is not None
    assert whole is not None
    assert found.rate_phasor == pytest.approx(whole.rate_phasor, rel=1e-12)
    assert found.output_phasor == pytest.approx(whole.output_phasor, rel=1e-12)
    assert found.rate_dps == pytest.approx(whole.rate_dps, abs=1e-9)
    assert found.left_v == pytest.approx(whole.left_v, abs=1e-12)
