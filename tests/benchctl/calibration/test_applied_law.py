"""The laws as they are applied: forwards against backwards, and what they do where there is no rate."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.calibration.coefficients import applied_law, checked
from benchctl.calibration.model import FASTEST_DPS, FLATTEST, STEEPEST, AppliedLaw, Factors, odd_inverse, reach
from benchctl_instruments.physics.response_gyro import one_plus
from tests.benchctl.calibration.made_coefficients import RATE_DPS, TEMPERATURE_C, contents


@given(st.lists(st.floats(-1e-4, 1e-4), min_size=1, max_size=4), st.floats(0.0, 1.0))
def test_an_odd_polynomial_is_inverted_as_far_as_it_rises(shares: list[float], part: float) -> None:
    bend = [share / 1e4**i for i, share in enumerate(shares)]
    end, _ = reach(bend)
    x = 0.999 * part * end * np.array([1.0, -1.0])
    assert odd_inverse(bend, x * one_plus(bend, x * x)) == pytest.approx(x, rel=1e-9)


def test_what_lies_beyond_the_turn_has_no_rate() -> None:
    bend = (-1e-5,)
    end, most = reach(bend)
    assert end == pytest.approx(math.sqrt((1.0 - FLATTEST) / 3e-5))
    assert most == pytest.approx(end * (1.0 - 1e-5 * end**2))
    found = odd_inverse(bend, np.array([0.999 * most, 1.001 * most, -1.001 * most, np.nan, np.inf]))
    assert np.isfinite(found).tolist() == [True, False, False, False, False]


@pytest.mark.parametrize("bend", [(), (0.0,), (5e-324,), (0.0, 0.0, 1e-300)])
def test_a_straight_line_goes_on_as_far_as_any_rate(bend: tuple[float, ...]) -> None:
    assert reach(bend) == (FASTEST_DPS, FASTEST_DPS)


def test_a_polynomial_that_bends_up_ends_where_it_is_too_steep() -> None:
    assert reach((1e-6,))[0] == pytest.approx(math.sqrt((STEEPEST - 1.0) / 3e-6))


@settings(max_examples=40, deadline=None)
@given(content=contents(), rate=st.floats(-RATE_DPS, RATE_DPS), celsius=st.floats(*TEMPERATURE_C))
def test_every_law_inverts_itself(content: dict[str, object], rate: float, celsius: float) -> None:
    law = applied_law(checked(content, "here"), "stages" if content["joint"] is None else "joint")
    rates, temperatures = np.array([rate, 0.0]), np.array([celsius, celsius])
    volts = law.volts(rates, temperatures)
    assert law.rate_dps(volts, temperatures) == pytest.approx(rates, abs=1e-8)


def test_samples_without_a_rate_are_no_numbers_and_no_error() -> None:
    bending = Factors(k_t=(-0.05,), k_omega=())  # 0 at 40 °C
    sine = AppliedLaw(
        name="sine",
        K0_v_per_dps=0.05,
        U0_v=0.0,
        T0_c=20.0,
        bias=(),
        S_rad_per_dps=0.0045,
        stages=(bending,),
        delay_s=0.0,
    )
    found = sine.rate_dps(np.array([1.0, 100.0, np.nan, 1.0, 1.0]), np.array([20.0, 20.0, 20.0, np.nan, 40.0]))
    assert np.isfinite(found).tolist() == [True, False, False, False, False]
