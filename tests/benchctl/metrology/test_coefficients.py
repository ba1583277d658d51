"""Q, N, B, K and R of records in which they are known."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from benchctl.metrology.allan import TERMS, AllanScatter, Terms, analysed
from benchctl.metrology.deviations import deviation
from benchctl.metrology.series import Series
from tests.benchctl.metrology.noises import FloatArray, record

SAMPLES, INTERVAL_S = 4096, 0.02


def terms(rates: FloatArray) -> Terms:
    return analysed(Series(values=rates, interval_s=INTERVAL_S, unit="deg/s", source="made")).terms


@pytest.mark.parametrize("term", ["Q", "N", "B", "K"])
def test_a_record_of_one_noise_has_its_term_and_no_other(term: str) -> None:
    chance = np.random.default_rng(11)
    for _ in range(5):
        found = terms(record(chance, SAMPLES, INTERVAL_S, **{term.lower(): 0.7})).found
        assert set(found) == {term}
        assert found[term].value == pytest.approx(0.7, rel=0.25)  # type: ignore[index]


def test_a_ramp_is_found_beside_white_noise() -> None:
    rates = record(np.random.default_rng(2), SAMPLES, INTERVAL_S, n=1.0) + 0.2 * INTERVAL_S * np.arange(SAMPLES)
    found = terms(rates).found
    assert set(found) == {"N", "R"}
    assert found["R"].value == pytest.approx(0.2, rel=0.1)


def test_three_terms_are_found_together() -> None:
    found = terms(record(np.random.default_rng(3), 1 << 15, INTERVAL_S, q=0.03, n=0.1, k=0.1)).found
    assert set(found) == {"Q", "N", "K"}
    for term, truth in (("Q", 0.03), ("N", 0.1), ("K", 0.1)):
        low, high = found[term].ci95  # type: ignore[index]
        assert low < truth < high


def test_a_term_whose_slope_lies_beyond_the_record_is_refused_and_not_guessed() -> None:
    chance = np.random.default_rng(6)
    for _ in range(5):  # the walk would show from 1700 s on, the record lasts 164 s
        said = terms(record(chance, SAMPLES, INTERVAL_S, n=1.0, k=1e-3))
        assert set(said.found) == {"N"}
        assert set(said.refused) == set(TERMS) - {"N"}


def test_a_term_that_reaches_into_the_first_samples_only_is_refused() -> None:
    chance = np.random.default_rng(7)
    said = terms(record(chance, 1 << 16, INTERVAL_S, q=0.01, n=1.0))
    assert set(said.found) == {"N"}
    assert said.refused["Q"]


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "truth", [{"Q": 1.0}, {"N": 1.0}, {"B": 1.0}, {"K": 1.0}, {"Q": 0.05, "N": 1.0}, {"N": 0.1, "K": 0.3}], ids=str
)
def test_intervals_hold_the_truth_nineteen_times_in_twenty(truth: dict[str, float]) -> None:
    """Of coefficients and of deviations, over 200 records: by chance alone 95 % are 90 to 99 % of a coefficient's."""
    chance = np.random.default_rng(17)
    held: Counter[str] = Counter()
    stated: Counter[str] = Counter()
    for _ in range(200):
        rates = record(chance, SAMPLES, INTERVAL_S, **{term.lower(): value for term, value in truth.items()})
        found = analysed(Series(values=rates, interval_s=INTERVAL_S, unit="deg/s", source="made"))
        for term, value in truth.items():
            if (one := found.terms.found.get(term)) is not None:  # type: ignore[call-overload]
                stated[term] += 1
                held[term] += one.ci95[0] <= value <= one.ci95[1]
        if set(truth) <= {"Q", "N", "K"}:  # what flicker does over a few samples depends on how it is sampled
            true = sum(
                value**2
                * {
                    "Q": 3 / found.tau_s**2,
                    "N": 1 / found.tau_s,
                    "K": found.tau_s / 3 + INTERVAL_S**2 / found.tau_s / 6,
                }[term]
                for term, value in truth.items()
            )
            inside = (found.ci95[:, 0] ** 2 <= true) & (true <= found.ci95[:, 1] ** 2)
            held["deviation"] += int(inside.sum())
            stated["deviation"] += inside.size
    for name, count in stated.items():
        room = 0.02 if name == "deviation" else 3.0 * math.sqrt(0.95 * 0.05 / count)
        assert abs(held[name] / count - 0.95) <= room, (name, held[name] / count)


SHORT, SLOW_S = 1024, 0.1
FACTORS = np.array([1, 2, 5, 16, 50, 110])


def squares(term: str) -> FloatArray:
    return np.array([float(term == one) for one in TERMS])


@pytest.mark.parametrize("term", ["Q", "N", "K"])
def test_variances_of_many_records_scatter_as_predicted_and_together(term: str) -> None:
    chance = np.random.default_rng(4)
    made = np.array(
        [deviation(record(chance, SHORT, SLOW_S, **{term.lower(): 1.0}), FACTORS) ** 2 for _ in range(1500)]
    )
    predicted = AllanScatter(FACTORS, SHORT, SLOW_S).covariance(squares(term))
    scale = np.sqrt(np.diag(predicted))
    assert made.std(axis=0) == pytest.approx(scale, rel=0.1)
    assert np.corrcoef(made.T) == pytest.approx(predicted / np.outer(scale, scale), abs=0.1)


@pytest.mark.parametrize("factor", [1, 4, 20, 100])
def test_the_degrees_of_freedom_of_white_noise_are_those_of_the_handbook(factor: int) -> None:
    """NIST SP 1065, overlapping Allan variance of white frequency noise: N points of phase."""
    points, m = SHORT + 1, factor
    handbook = (3 * (points - 1) / (2 * m) - 2 * (points - 2) / points) * 4 * m**2 / (4 * m**2 + 5)
    variance = AllanScatter(np.array([m]), SHORT, SLOW_S).covariance(squares("N"))[0, 0]
    assert 2.0 * (1.0 / (m * SLOW_S)) ** 2 / variance == pytest.approx(handbook, rel=0.08)


def test_a_ramp_lets_the_noise_beside_it_scatter_more() -> None:
    scatter = AllanScatter(FACTORS, SHORT, SLOW_S)
    chance = np.random.default_rng(5)
    ramp = 0.5 * SLOW_S * np.arange(SHORT)
    made = [deviation(ramp + record(chance, SHORT, SLOW_S, n=1.0), FACTORS) ** 2 for _ in range(1500)]
    predicted = scatter.covariance(squares("N") + 0.25 * squares("R"))
    assert np.std(made, axis=0) == pytest.approx(np.sqrt(np.diag(predicted)), rel=0.12)
    assert predicted[-1, -1] > 1.5 * scatter.covariance(squares("N"))[-1, -1]
