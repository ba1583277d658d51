"""The whole analysis of a series."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.metrology.allan import LEAST_SAMPLES, analysed, averaging_factors
from benchctl.metrology.deviations import deviation
from benchctl.metrology.series import Series
from instruments.errors import UsageError
from tests.benchctl.metrology.noises import FloatArray, record


def series(values: FloatArray) -> Series:
    return Series(values=values, interval_s=0.1, unit="deg/s", source="made")


@pytest.mark.parametrize("samples", [LEAST_SAMPLES, 1000, 123_456])
def test_averaging_times_go_from_one_sample_to_a_third_of_the_record(samples: int) -> None:
    factors = averaging_factors(samples)
    assert factors[0] == 1
    assert samples / 4 < factors[-1] <= samples / 3
    assert (np.diff(factors) > 0).all()
    assert (factors[1:] / factors[:-1])[factors[:-1] > 20] == pytest.approx(10**0.1, rel=0.05)


def test_deviations_lie_in_their_intervals_which_widen_with_the_averaging_time() -> None:
    found = analysed(series(record(np.random.default_rng(1), 20_000, 0.1, n=1.0, k=0.05)))
    assert found.deviation == pytest.approx(deviation(found.series.values, averaging_factors(20_000), 0.1))
    assert (found.ci95[:, 0] < found.deviation).all()
    assert (found.deviation < found.ci95[:, 1]).all()
    width = found.ci95[:, 1] / found.ci95[:, 0]
    assert width[0] < 1.05
    assert (np.diff(width[5:]) > 0.0).all()
    assert found.freedom[-1] < 5.0


def test_the_shortest_record_is_analysed() -> None:
    found = analysed(series(np.random.default_rng(1).standard_normal(LEAST_SAMPLES)))
    assert np.isfinite(found.ci95).all()


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(UsageError, match=f"made: {LEAST_SAMPLES - 1} samples are too few; expected at least"):
        analysed(series(np.arange(LEAST_SAMPLES - 1.0)))


def test_samples_that_do_not_change_are_refused() -> None:
    with pytest.raises(UsageError, match=r"all 500 samples are 2\.5; check that the unit was connected"):
        analysed(series(np.full(500, 2.5)))


def test_a_pure_ramp_is_a_ramp() -> None:
    found = analysed(series(0.02 * 0.1 * np.arange(3000)))
    assert found.terms.found["R"].value == pytest.approx(0.02, rel=0.01)
