"""Delay, low-pass or neither: told by gain and phase above the band in which a stepped shaft is compared row by row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.signal import butter, lfilter

from benchctl.diagnosis.data_faults import without_data_faults
from benchctl.diagnosis.gyro.problem import GyroProblem, _compared, gyro_problem
from benchctl.diagnosis.search.select import select
from benchctl.estimation.fit import Point, fit
from benchctl.estimation.noise_model import NoiseModel
from benchctl.recordings.reader import Recording
from tests.benchctl.diagnosis.made_recording import recording_of

FloatArray = npt.NDArray[np.float64]

RATE_HZ, FINE, LASTS_S = 100.0, 20, 300.0
STEP_DEG, SWEEP_DEG, SWEEP_DPS = 360.0 / 4096.0, 180.0, 46.0
TEETH = 100
DELAY_S, SLOW_HZ = 0.012, 13.0
MODEL = {"K0_v_per_dps": 1.0, "U0_v": 0.0, "T0_c": 20.0, "k_T": [], "k_omega": []}


def shaft(back_dps: float = SWEEP_DPS) -> FloatArray:
    """Angles of a shaft that a stepper sweeps to and fro [deg], so many times finer than the samples.

    It shakes at every step, and at the eighth harmonic of that, which the samples fold back to 2.2 Hz.
    """
    time_s = np.arange(0.0, LASTS_S, 1.0 / (RATE_HZ * FINE))
    lasts_s = SWEEP_DEG / SWEEP_DPS + SWEEP_DEG / back_dps
    phase_s = np.mod(time_s, lasts_s)
    sharp = np.minimum(phase_s * SWEEP_DPS, (lasts_s - phase_s) * back_dps)
    width = int(0.15 * RATE_HZ * FINE)
    swept = np.convolve(np.pad(sharp, width, mode="edge"), np.hanning(width) / np.hanning(width).sum(), mode="same")
    swept = swept[width:-width]
    turned = np.radians(TEETH * swept)
    return np.asarray(swept + 0.5 * np.sin(turned) + 0.01 * np.sin(8.0 * turned))


def stepped(
    *,
    delay_s: float = 0.0,
    low_pass_hz: float = 0.0,
    asymmetry: float = 0.0,
    offset: float = 0.0,
    limit: float = np.inf,
    back_dps: float = SWEEP_DPS,
) -> GyroProblem:
    """What an encoder of 4096 counts and a digital gyro say of it."""
    return gyro_problem(stepped_recording(delay_s, low_pass_hz, asymmetry, offset, limit, back_dps), model=MODEL)


def stepped_recording(
    delay_s: float, low_pass_hz: float, asymmetry: float, offset: float, limit: float, back_dps: float
) -> Recording:
    """The recording of it."""
    angle = shaft(back_dps)
    rate = np.gradient(angle, 1.0 / (RATE_HZ * FINE))
    if low_pass_hz:
        rate = lfilter(*butter(1, low_pass_hz, fs=RATE_HZ * FINE), rate)
    felt = np.roll(rate, round(delay_s * RATE_HZ * FINE))[::FINE]
    encoder = np.round(angle[::FINE] / STEP_DEG) * STEP_DEG
    felt = (
        felt * (1.0 + 0.5 * asymmetry * np.sign(felt))
        + offset
        + 0.3 * np.random.default_rng(0).standard_normal(felt.size)
    )
    channels = {
        "time_s": np.arange(felt.size) / RATE_HZ,
        "encoder_deg": encoder,
        "gyro_v": np.clip(felt, -limit, limit),
    }
    return recording_of(channels, gyro_output_unit="deg/s", channel_units={"gyro_v": "deg/s"})


def found(problem: GyroProblem) -> dict[str, dict[str, float]]:
    chosen = select(problem, seed=0, progress=lambda _name, _share: None)
    return {effect.identifier: effect.values for effect in chosen.after.point.effects}


def test_a_delay_is_told_from_a_low_pass_above_the_band() -> None:
    problem = stepped(delay_s=DELAY_S)
    assert problem.band is not None
    assert problem.band.stop_hz < 4.0
    effects = found(problem)
    assert effects["timing_offset"]["offset_s"] == pytest.approx(DELAY_S, abs=1e-4)
    assert set(effects) == {"timing_offset"}


@pytest.mark.slow
def test_an_asymmetry_is_told_by_how_the_shaking_is_felt_in_both_directions() -> None:
    """At one speed the slow output shows no more than another bias."""
    problem = stepped(delay_s=DELAY_S, asymmetry=0.03)
    effects = found(problem)
    assert effects["timing_offset"]["offset_s"] == pytest.approx(DELAY_S, abs=2e-4)
    alike = {"scale_asymmetry", "rate_squared"} & set(effects)
    assert set(effects) == {"timing_offset", *alike}
    assert len(alike) == 1
    found_there = effects.get("scale_asymmetry", {"fraction": 0.0})["fraction"]
    found_there += 4.0 * SWEEP_DPS * effects.get("rate_squared", {"v_per_dps2": 0.0})["v_per_dps2"]
    assert found_there == pytest.approx(0.03, rel=0.25)


def test_an_asymmetry_has_its_size_where_the_directions_shake_at_different_frequencies() -> None:
    """A filter between encoder and gyro that tells the two frequencies apart would take up a part of it."""
    problem = stepped(delay_s=DELAY_S, asymmetry=0.03, back_dps=48.0)
    effects = tuple(
        problem.effects[name].make(values, problem.circumstances)
        for name, values in (("timing_offset", {"offset_s": DELAY_S}), ("scale_asymmetry", {"fraction": 0.02}))
    )
    start = Point(baseline=problem.baseline_start, effects=effects)
    fitted = fit(problem, NoiseModel.of(problem).whitener, start, np.ones(len(problem.steps), np.bool_))
    assert fitted.point.effects[1].values["fraction"] == pytest.approx(0.03, rel=0.05)


def test_an_offset_is_no_difference_of_the_directions() -> None:
    contrast, shifted = stepped().contrast, stepped(offset=3.0).contrast
    assert contrast is not None
    assert shifted is not None
    assert shifted.measured == pytest.approx(contrast.measured, abs=1e-6)


def test_a_rail_is_seen_in_the_samples_of_a_shaking_shaft_and_stays_in_every_model() -> None:
    problem, faults = without_data_faults(stepped(limit=60.0))
    assert [(one.effect, one.parameters["limit_v"].value) for one in faults] == [("saturation", 60.0)]
    assert isinstance(problem, GyroProblem)
    assert not {"saturation", "two_rails"} & set(problem.effects)
    baseline = problem.baseline_start
    left = (problem.measured - problem.predict(baseline, ()))[problem.usable]
    unclipped = replace(problem, rails=())
    left_without = (problem.measured - unclipped.predict(baseline, ()))[problem.usable]
    assert np.mean(left**2) < 0.1 * np.mean(left_without**2)


def test_a_low_pass_is_told_from_a_delay_above_the_band() -> None:
    effects = found(stepped(low_pass_hz=SLOW_HZ))
    assert effects["sensor_bandwidth"]["cutoff_hz"] == pytest.approx(SLOW_HZ, rel=0.05)
    assert "timing_offset" not in effects


def test_only_what_both_see_is_compared() -> None:
    problem = stepped()
    response = problem.response
    assert response is not None
    assert problem.band is not None
    assert response.frequency_hz.min() > problem.band.stop_hz
    assert np.any(np.abs(response.frequency_hz - 12.8) < 0.5)  # the steps
    assert response.frequency_hz.max() < 17.0  # beyond, the encoder's own steps drown the motion
    assert "the gain is 1.0" in response.sentence(1.0)
    off = problem.spectral_residual(problem.baseline_start, ()) / problem.band.noise
    assert np.mean(off[: response.step.size] ** 2) < 0.2  # in deviations that hold more than noise
    assert np.mean(off[response.step.size :] ** 2) < 1.0  # in deviations that steps differ by, and more
    nothing = replace(problem, response=None, contrast=None)
    assert nothing.spectral_residual(problem.baseline_start, ()).size == 0


def test_stretches_too_short_for_a_band_are_compared_whole() -> None:
    problem = stepped()
    frame = problem.frame
    short = 160
    bounds = range(0, frame.rows - short, short)
    cut = replace(
        frame,
        stretches=tuple(slice(first, first + short) for first in bounds),
        motions=tuple(frame.motions[0] for _ in bounds),
    )
    band, usable = _compared(cut, np.inf)
    assert band is None
    assert np.count_nonzero(usable) > 0.5 * frame.rows
    assert _compared(frame, np.inf)[0] is not None
