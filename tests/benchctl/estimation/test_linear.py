"""Least squares against certified values, and clusters against many draws."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.calibration.uncertainty import coverage_factor
from benchctl.estimation.linear import clustered_covariance, fit_linear

# NIST StRD, Pontius (quadratic, lower difficulty): load cell calibration, 40 points.
LOAD = np.tile(np.arange(150_000.0, 3_000_001.0, 150_000.0), 2)
DEFLECTION = np.array(
    [
        *(0.11019, 0.21956, 0.32949, 0.43899, 0.54803, 0.65694, 0.76562, 0.87487, 0.98292, 1.09146),
        *(1.20001, 1.30822, 1.41599, 1.52399, 1.63194, 1.73947, 1.84646, 1.95392, 2.06128, 2.16844),
        *(0.11052, 0.22018, 0.32939, 0.43886, 0.54798, 0.65739, 0.76596, 0.87474, 0.98300, 1.09150),
        *(1.20004, 1.30818, 1.41613, 1.52408, 1.63159, 1.73965, 1.84696, 1.95445, 2.06177, 2.16829),
    ]
)


def test_a_certified_quadratic_is_reproduced() -> None:
    fit = fit_linear(np.stack([np.ones(40), LOAD, LOAD**2], axis=1), DEFLECTION)
    assert fit.coefficients == pytest.approx(
        [0.673565789473684e-03, 0.732059160401003e-06, -0.316081871345029e-14], rel=1e-9
    )
    certified = [0.107938612033077e-03, 0.157817399981659e-09, 0.486652849992036e-16]
    assert np.sqrt(np.diag(fit.covariance)) == pytest.approx(certified, rel=1e-8)


def test_clusters_that_hang_together_widen_the_covariance_as_they_should() -> None:
    rng = np.random.default_rng(1)
    cluster = np.repeat(np.arange(60), 20)
    x = rng.standard_normal(60)[cluster]
    columns = np.stack([np.ones(x.size), x], axis=1)
    found, stated = [], []
    for _ in range(300):
        values = rng.standard_normal(60)[cluster] + 0.1 * rng.standard_normal(x.size)
        fit = fit_linear(columns, values)
        found.append(fit.coefficients[1])
        stated.append(clustered_covariance(columns, fit.residual, cluster)[0][1, 1])
    assert np.sqrt(np.mean(stated)) == pytest.approx(np.std(found), rel=0.12)
    assert np.sqrt(np.mean(stated)) > 3 * np.sqrt(fit.covariance[1, 1])


def test_intervals_hold_where_few_clusters_determine_a_coefficient() -> None:
    rng = np.random.default_rng(3)
    cluster = np.repeat(np.arange(12), 10)
    x = np.array([3.0, -3.0, *np.zeros(10)])[cluster]  # two of the twelve determine the slope
    columns = np.stack([np.ones(x.size), x], axis=1)
    inside = 0
    for _ in range(1000):
        fit = fit_linear(columns, rng.standard_normal(12)[cluster] + 0.1 * rng.standard_normal(x.size))
        covariance, dof = clustered_covariance(columns, fit.residual, cluster)
        assert 1.0 <= dof[1] < 2.5 < 8.0 < dof[0] <= 11.0
        inside += abs(fit.coefficients[1]) < coverage_factor(dof[1]) * np.sqrt(covariance[1, 1])
    assert 0.93 < inside / 1000 < 0.98  # 0.954; with the degrees of freedom of all clusters, uncorrected, 0.63


def test_few_clusters_get_an_upper_bound() -> None:
    cluster = np.repeat(np.arange(3), 50)
    columns = np.stack([np.ones(150), np.linspace(-1, 1, 150)], axis=1)
    residual = np.random.default_rng(2).standard_normal(150)
    plain = float(residual @ residual) / 148 / float(columns[:, 1] @ columns[:, 1])
    assert clustered_covariance(columns, residual, cluster)[0][1, 1] == pytest.approx(50 * plain, rel=0.01)
