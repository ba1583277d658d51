"""Recordings of another program, whose truth lies beside them."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.calibration.calibrate import calibrate
from benchctl.recordings.import_open import read_open_recording
from tests.shared import SHARED, needs_shared

EXAMPLES = SHARED / "recordings" / "examples"


@needs_shared("recordings/examples")
def test_a_recording_with_nothing_missing_gives_its_own_coefficients_back() -> None:
    meta, steps = read_open_recording(EXAMPLES / "null")
    result = calibrate(steps, meta)
    fit, simulation = result.best, meta.simulation or {}
    assert fit.law == "response"  # k(ω) of this simulation is above 1: no interferometer
    assert fit.value("K0_v_per_dps") == pytest.approx(simulation["K0_v_per_dps"], rel=1e-3)
    for name, value in zip(("a1", "a2", "b2", "b4"), [*simulation["k_T"], *simulation["k_omega"]], strict=True):
        assert abs(fit.value(name) - value) < 4 * fit.parameter(name).standard, name
    assert abs(fit.value("delay_s")) < 5e-6
    assert fit.noise.mean_excess == pytest.approx(1.0, abs=0.5)
    assert result.error_percent["joint"] < 0.1
    assert any("spin-up" in note for note in result.notes)


@needs_shared("recordings/examples")
@pytest.mark.slow
def test_a_low_pass_shows_as_its_delay() -> None:
    meta, steps = read_open_recording(EXAMPLES / "single")
    fit = calibrate(steps, meta).best
    assert fit.value("delay_s") == pytest.approx(np.sqrt(2) / (2 * np.pi * 22.2088), rel=0.01)


@needs_shared("recordings/examples")
@pytest.mark.slow
def test_an_eccentric_encoder_is_found() -> None:
    meta, steps = read_open_recording(EXAMPLES / "pair")
    fit = calibrate(steps, meta).best
    amplitude = np.hypot(fit.value("encoder_sin1_arcsec"), fit.value("encoder_cos1_arcsec"))
    assert amplitude == pytest.approx(80.17, abs=2)
