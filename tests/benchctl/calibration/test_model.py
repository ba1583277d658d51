"""The laws against the published tables, and forwards against backwards."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.calibration.model import Law
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.response_gyro import one_plus

NOTHING = np.zeros(1)
SINE = Law(name="sine", rate_terms=1, temperature_terms=0)


@pytest.mark.parametrize(
    ("true", "indicated", "deficit"),
    [
        (40, 39.79, 0.53),
        (60, 59.28, 1.20),
        (100, 96.69, 3.31),
        (150, 138.96, 7.36),
        (175, 157.62, 9.93),
        (200, 174.29, 12.85),
    ],
)
def test_the_sine_gives_the_published_indications(true: float, indicated: float, deficit: float) -> None:
    volts = SINE.volts(np.array([1.0, 0.00448]), np.array([true], dtype=float), NOTHING)[0]
    assert volts == pytest.approx(indicated, abs=0.006)
    assert 100 * (1 - volts / true) == pytest.approx(deficit, abs=0.006)


@pytest.mark.parametrize(
    ("rate", "percent"), [(40, 0.498), (60, 1.164), (100, 3.61), (150, 9.78), (170, 13.6), (200, 21.5)]
)
def test_the_papers_polynomial_has_the_published_values(rate: float, percent: float) -> None:
    k = one_plus((3.02e-6, 5.89e-11), np.array([rate**2], dtype=float))[0]
    assert 100 * (k - 1) == pytest.approx(percent, abs=0.06 if percent > 10 else 0.006)


@pytest.mark.parametrize(
    ("temperature", "percent"), [(-50, -1.174), (-20, -0.346), (20, 0.180), (40, 0.195), (85, -0.375)]
)
def test_the_papers_temperature_polynomial_has_the_published_values(temperature: float, percent: float) -> None:
    k = one_plus((1.315e-4, -2.066e-6), np.array([temperature], dtype=float))[0]
    assert 100 * (k - 1) == pytest.approx(percent, abs=0.0006)


@pytest.mark.parametrize(
    ("law", "parameters"),
    [
        (Law(name="sine", rate_terms=1, temperature_terms=2), [0.05, 0.0045, -1.3e-4, 2e-6]),
        (Law(name="polynomial", rate_terms=2, temperature_terms=2), [-0.05, 3.02e-6, 5.89e-11, 1.3e-4, -2e-6]),
        (Law(name="response", rate_terms=2, temperature_terms=1), [0.02, -3e-6, 2e-11, 1.3e-4]),
        (Law(name="polynomial", rate_terms=0, temperature_terms=0), [0.05]),
    ],
)
@given(rate=st.floats(-200, 200), dt=st.floats(-60, 60))
def test_every_law_inverts_itself(law: Law, parameters: list[float], rate: float, dt: float) -> None:
    p, at, warm = np.array(parameters), np.array([rate]), np.array([dt])
    assert law.rate(p, law.volts(p, at, warm), warm) == pytest.approx(at, abs=1e-6)


@pytest.mark.parametrize("name", ["sine", "polynomial", "response"])
def test_derivatives_agree_with_differences_of_the_whole(name: str) -> None:
    law = Law(name=name, rate_terms=1 if name == "sine" else 2, temperature_terms=2)
    p = np.array([0.05, 0.0045, -1e-4, 2e-6] if name == "sine" else [0.05, 3e-6, 6e-11, 1e-4, -2e-6])
    rate, dt = np.array([-150.0, 3.0, 90.0]), np.array([-20.0, 0.0, 40.0])
    _, slopes, by_rate = law.volts_and_slopes(p, rate, dt)
    for i in range(p.size):
        moved = p.copy()
        moved[i] *= 1.001
        change = law.volts(moved, rate, dt) - law.volts(p, rate, dt)
        assert slopes[:, i] * 0.001 * p[i] == pytest.approx(change, rel=2e-2, abs=1e-9)
    assert by_rate == pytest.approx((law.volts(p, rate + 0.1, dt) - law.volts(p, rate - 0.1, dt)) / 0.2, rel=1e-5)


def test_a_polynomial_that_turns_over_says_so() -> None:
    law = Law(name="polynomial", rate_terms=1, temperature_terms=0)
    with pytest.raises(UsageError, match="beyond its range"):
        law.volts(np.array([0.05, -1e-5]), np.array([300.0]), NOTHING)


def test_the_sine_has_no_rate_beyond_its_fringe() -> None:
    assert np.isnan(SINE.rate(np.array([0.05, 0.0045]), np.array([0.05 / 0.0045 * 1.01]), NOTHING)[0])
