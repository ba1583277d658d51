"""Records that the five terms describe, and records that they do not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from benchctl.metrology.allan import Allan, analysed
from benchctl.metrology.misfit import Misfit
from benchctl.metrology.series import Series
from tests.benchctl.metrology.noises import FloatArray, record

SAMPLES, INTERVAL_S = 1 << 14, 0.02
TIME_S = INTERVAL_S * np.arange(SAMPLES)


def analysis(rates: FloatArray) -> Allan:
    return analysed(Series(values=rates, interval_s=INTERVAL_S, unit="deg/s", source="made"))


def misfit(rates: FloatArray) -> Misfit | None:
    return analysis(rates).misfit


def white(seed: int) -> FloatArray:
    return record(np.random.default_rng(seed), SAMPLES, INTERVAL_S, n=0.1)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    "terms", [{"q": 1.0}, {"n": 1.0}, {"b": 1.0}, {"k": 1.0}, {"q": 0.02, "n": 0.3, "b": 0.2, "k": 0.1}], ids=str
)
def test_noise_that_is_made_of_the_terms_is_described_by_them(terms: dict[str, float], seed: int) -> None:
    assert misfit(record(np.random.default_rng(seed), SAMPLES, INTERVAL_S, **terms)) is None


@pytest.mark.parametrize("slope", [1e-4, 0.01, 1.0])
def test_a_ramp_is_described_with_and_without_noise(slope: float) -> None:
    assert misfit(slope * TIME_S) is None
    assert misfit(slope * TIME_S + white(1)) is None


@pytest.mark.parametrize("frequency_hz", [0.1, 1.3, 7.0])
def test_a_line_in_the_spectrum_is_told_with_the_deviation_that_the_terms_miss(frequency_hz: float) -> None:
    found = analysis(white(2) + np.sin(2.0 * np.pi * frequency_hz * TIME_S))
    told = found.misfit
    assert told is not None
    (place,) = np.flatnonzero(found.tau_s == told.tau_s)
    assert told.deviation == found.deviation[place]
    assert told.modelled**2 == pytest.approx(found.terms.modelled(found.tau_s, INTERVAL_S)[place])
    assert not found.ci95[place, 0] < told.modelled < found.ci95[place, 1]


def test_a_line_below_the_noise_is_not_told() -> None:
    assert misfit(white(3) + 0.01 * np.sin(2.0 * np.pi * 1.3 * TIME_S)) is None


@pytest.mark.parametrize("correlated_s", [0.2, 2.0])
def test_correlated_noise_is_told(correlated_s: float) -> None:
    past = np.exp(-INTERVAL_S / correlated_s)
    assert misfit(lfilter([1.0], [1.0, -past], np.random.default_rng(4).standard_normal(SAMPLES))) is not None


def test_a_filter_before_the_samples_is_told() -> None:
    assert misfit(lfilter(*butter(2, 1.0, fs=1.0 / INTERVAL_S), white(5))) is not None


def test_an_output_that_toggles_evenly_is_told_by_a_deviation_of_nothing() -> None:
    told = misfit(np.arange(SAMPLES) % 2.0)
    assert told is not None
    assert told.deviation < 1e-9 < told.modelled


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_three_hundred_records_of_the_terms_have_no_misfit() -> None:
    chance = np.random.default_rng(8)
    told = []
    for number in range(300):
        terms = dict(zip("qnbk", 10.0 ** chance.uniform(-2.0, 0.0, 4) * (chance.uniform(size=4) < 0.6), strict=True))
        terms["n"] = max(terms["n"], 0.01)
        if found := misfit(record(chance, 4096, INTERVAL_S, **terms)):
            told.append((number, terms, found))
    assert told == []
