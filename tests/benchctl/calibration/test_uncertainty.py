"""Coverage factors and degrees of freedom, against the numbers that the GUM (JCGM 100:2008) prints."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.calibration.uncertainty import (
    LEVEL,
    coverage_factor,
    dof_of_factor,
    dof_of_mixture,
    effective_dof,
)


@pytest.mark.parametrize(
    ("dof", "factor"),
    [(1, 13.97), (2, 4.53), (3, 3.31), (4, 2.87), (5, 2.65), (10, 2.28), (20, 2.13), (50, 2.05), (math.inf, 2.0)],
)
def test_coverage_factors_for_95_45_percent_are_those_of_table_g_2(dof: float, factor: float) -> None:
    assert coverage_factor(dof) == pytest.approx(factor, abs=0.005)


def test_the_end_gauge_of_h_1_has_16_degrees_of_freedom_and_u_of_93_nm() -> None:
    comparison = effective_dof([(5.8, 24.0), (3.9, 5.0), (6.7, 8.0)])
    assert comparison == pytest.approx(25.6, abs=0.2), "the guide rounds 9.69 nm to 9.7 nm first"
    # nm: the standard, the comparison, the difference of the expansion coefficients, that of the temperatures
    parts = [(25.0, 18.0), (9.7, 25.6), (2.9, 50.0), (16.6, 2.0)]
    dof = effective_dof(parts)
    assert int(dof) == 16
    k = coverage_factor(int(dof), 0.99)
    assert k == pytest.approx(2.92, abs=0.005)
    assert k * math.hypot(*(standard for standard, _ in parts)) == pytest.approx(93.0, abs=1.0)


def test_the_product_of_g_4_1_has_19_degrees_of_freedom_and_u_of_2_2_percent() -> None:
    parts = [(0.25, 9.0), (0.57, 4.0), (0.82, 14.0)]
    dof = effective_dof(parts)
    assert dof == pytest.approx(19.0, abs=0.2)
    assert coverage_factor(dof, 0.95) * math.hypot(0.25, 0.57, 0.82) == pytest.approx(2.2, abs=0.05)


def test_type_b_alone_has_no_finite_degrees_of_freedom() -> None:
    assert effective_dof([(1e-9, math.inf), (2e-9, math.inf)]) == math.inf
    assert effective_dof([]) == math.inf


@given(small=st.floats(1e-90, 1e-70), dof=st.floats(1.0, 1e4))
def test_one_contributor_keeps_its_degrees_of_freedom_whatever_its_unit(small: float, dof: float) -> None:
    assert effective_dof([(small, dof), (0.0, 1.0)]) == pytest.approx(dof)


@given(st.floats(1.0, 900.0))
def test_a_factor_leads_back_to_its_degrees_of_freedom(dof: float) -> None:
    assert dof_of_factor(coverage_factor(dof)) == pytest.approx(dof, rel=1e-3)


def test_a_known_variance_has_infinite_and_an_uncertain_one_few_degrees_of_freedom() -> None:
    assert dof_of_mixture(np.array([0.3, 0.7]), [4.0, 4.0]) > 1e3
    draws = np.random.default_rng(1).standard_normal(400_000) * np.where(np.arange(400_000) % 10 == 0, 5.0, 1.0)
    factor = float(np.quantile(np.abs(draws), LEVEL) / draws.std())
    assert coverage_factor(dof_of_mixture(np.array([0.1, 0.9]), [25.0, 1.0])) == pytest.approx(factor, rel=0.02)
