from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chain import run_chain
from benchctl_instruments.physics.effect_contract.behaviour import sampled
from benchctl_instruments.physics.response_gyro import ResponseParameters, response_baseline, response_v

LAB: dict[str, Any] = {
    "K0_v_per_dps": 0.016,
    "U0_v": 0.012,
    "T0_c": 23.0,
    "k_T": (1.3e-4, -2e-6),
    "k_omega": (3e-6, 6e-11),
    "noise_v_rms": 0.0005,
    "output_limit_v": 4.0,
}


def test_the_response_is_the_product_of_its_polynomials() -> None:
    volts = response_v(ResponseParameters(**LAB), np.array([0.0, 100.0, -100.0]), np.array([50.0, 33.0, 23.0]))
    # k(100) = 1 + 0.03 + 0.006, k(33 °C) = 1 + 0.0013 - 0.0002
    np.testing.assert_allclose(volts, [0.0, 1.6 * 1.036 * 1.0011, -1.6 * 1.036], rtol=1e-12)


def test_without_terms_it_is_a_straight_line() -> None:
    line = ResponseParameters(**{**LAB, "k_T": (), "k_omega": ()})
    np.testing.assert_allclose(response_v(line, np.array([-80.0, 80.0]), np.array([-40.0, 80.0])), [-1.28, 1.28])


def test_in_the_chain_the_bias_comes_after_the_scale() -> None:
    signals = sampled()
    lab = ResponseParameters(**LAB)
    expected = 0.012 + response_v(lab, signals.sensed_rate_dps, signals.coil_c)
    np.testing.assert_array_equal(run_chain(signals, response_baseline(lab)).output_v, expected)


@pytest.mark.parametrize("wrong", [{"noise_v_rms": -1e-3}, {"output_limit_v": 0.0}])
def test_no_negative_noise_and_no_limit_of_zero(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError, match="give a noise of 0 or more and a limit above 0"):
        ResponseParameters(**{**LAB, **wrong})
