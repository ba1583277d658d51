from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl_instruments.physics.effect_contract.behaviour import sampled
from benchctl_instruments.physics.effects.encoder_eccentricity import EncoderEccentricity


def test_ten_micrometres_on_a_radius_of_fifty_millimetres_are_two_hundredths_of_a_percent_of_the_rate() -> None:
    grating = EncoderEccentricity(amplitude_arcsec=41.25, phase_deg=0.0)  # 10 µm / 50 mm = 2e-4 rad
    assert np.abs(grating.error_slope(np.linspace(0.0, 360.0, 721))).max() == pytest.approx(2e-4, rel=1e-3)


@pytest.mark.parametrize("order", [1.0, 2.0])
def test_the_slope_is_the_derivative_of_the_error(order: float) -> None:
    grating = EncoderEccentricity(amplitude_arcsec=300.0, phase_deg=33.0, order=order)
    angle = np.linspace(-400.0, 400.0, 101)
    numeric = (grating.error_deg(angle + 1e-3) - grating.error_deg(angle - 1e-3)) / 2e-3
    np.testing.assert_allclose(grating.error_slope(angle), numeric, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("order", [1.0, 2.0])
def test_the_true_motion_is_found_again_from_what_the_encoder_states(order: float) -> None:
    grating = EncoderEccentricity(amplitude_arcsec=80.0, phase_deg=331.5, order=order)
    true = sampled()
    slope = grating.error_slope(true.angle_deg)
    stated = replace(
        true,
        angle_deg=true.angle_deg + grating.error_deg(true.angle_deg),
        rate_dps=true.rate_dps * (1.0 + slope),
        sensed_rate_dps=true.rate_dps * (1.0 + slope) + 0.0036,
    )
    found = grating.true_motion(stated)
    np.testing.assert_allclose(found.angle_deg, true.angle_deg, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(found.rate_dps, true.rate_dps, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(found.sensed_rate_dps, true.rate_dps + 0.0036, rtol=0.0, atol=1e-8)


def test_forwards_only_the_encoder_is_wrong() -> None:
    grating, signals = EncoderEccentricity(amplitude_arcsec=3600.0, phase_deg=0.0), sampled()
    done = grating.apply(signals)
    assert np.abs(done.encoder_deg - signals.encoder_deg).max() == pytest.approx(1.0, rel=1e-3)
    assert done.angle_deg is signals.angle_deg
    assert done.output_v is signals.output_v
