"""The scatter of Allan variances, held against many records and against the handbook's degrees of freedom."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.metrology.deviations import deviation
from benchctl.metrology.noise_terms import TERMS
from benchctl.metrology.scatter import AllanScatter
from tests.benchctl.metrology.noises import FloatArray, record

SAMPLES, INTERVAL_S = 1024, 0.1
FACTORS = np.array([1, 2, 5, 16, 50, 110])


def squares(term: str) -> FloatArray:
    return np.array([float(term == one) for one in TERMS])


@pytest.mark.parametrize("term", ["Q", "N", "K"])
def test_variances_of_many_records_scatter_as_predicted_and_together(term: str) -> None:
    chance = np.random.default_rng(4)
    made = np.array(
        [
            deviation(record(chance, SAMPLES, INTERVAL_S, **{term.lower(): 1.0}), FACTORS, INTERVAL_S) ** 2
            for _ in range(1500)
        ]
    )
    predicted = AllanScatter(FACTORS, SAMPLES, INTERVAL_S).covariance(squares(term))
    scale = np.sqrt(np.diag(predicted))
    assert made.std(axis=0) == pytest.approx(scale, rel=0.1)
    assert np.corrcoef(made.T) == pytest.approx(predicted / np.outer(scale, scale), abs=0.1)


@pytest.mark.parametrize("factor", [1, 4, 20, 100])
def test_the_degrees_of_freedom_of_white_noise_are_those_of_the_handbook(factor: int) -> None:
    """NIST SP 1065, overlapping Allan variance of white frequency noise: N points of phase."""
    points, m = SAMPLES + 1, factor
    handbook = (3 * (points - 1) / (2 * m) - 2 * (points - 2) / points) * 4 * m**2 / (4 * m**2 + 5)
    variance = AllanScatter(np.array([m]), SAMPLES, INTERVAL_S).covariance(squares("N"))[0, 0]
    assert 2.0 * (1.0 / (m * INTERVAL_S)) ** 2 / variance == pytest.approx(handbook, rel=0.08)


def test_a_ramp_lets_the_noise_beside_it_scatter_more() -> None:
    scatter = AllanScatter(FACTORS, SAMPLES, INTERVAL_S)
    chance = np.random.default_rng(5)
    ramp = 0.5 * INTERVAL_S * np.arange(SAMPLES)
    made = [deviation(ramp + record(chance, SAMPLES, INTERVAL_S, n=1.0), FACTORS, INTERVAL_S) ** 2 for _ in range(1500)]
    predicted = scatter.covariance(squares("N") + 0.25 * squares("R"))
    assert np.std(made, axis=0) == pytest.approx(np.sqrt(np.diag(predicted)), rel=0.12)
    assert predicted[-1, -1] > 1.5 * scatter.covariance(squares("N"))[-1, -1]
