import math

import numpy as np
import pytest

from benchctl.diagnosis.search.scan_converter import converter_places
from tests.benchctl.diagnosis.pulled import FloatArray, pulled


def _swept(rows: int) -> tuple[FloatArray, FloatArray]:
    """Voltages of a sine between −2.1 and 2.5 V, and the derivatives of a polynomial in them."""
    volts = 0.2 + 2.3 * np.sin(np.arange(rows) * 0.013)
    return volts, np.stack([volts**power for power in (0, 1, 3)], axis=1)


@pytest.mark.parametrize("period_v", [0.0131, 0.21, 0.777, 2.9])
def test_a_wave_is_found_within_a_small_part_of_what_parts_it_from_the_next(period_v: float) -> None:
    volts, known = _swept(40_000)
    noise = np.random.default_rng(1).standard_normal(volts.size)
    best = converter_places(pulled(noise + 0.2 * np.sin(2 * np.pi * volts / period_v), known), volts, 0.01, 3)[0]
    assert abs(1.0 / best.value - 1.0 / period_v) < 0.06 / 4.6
    assert best.gain - 2.0 * math.log(best.places) > 50.0


def test_what_the_model_itself_can_follow_is_no_gain() -> None:
    volts, known = _swept(20_000)
    noise = np.random.default_rng(2).standard_normal(volts.size)
    places = converter_places(pulled(noise + 0.3 * volts**3 - 2.0 * volts, known), volts, 0.01, 3)
    assert all(one.gain - 2.0 * math.log(one.places) < 14.0 for one in places)


def test_the_gain_is_that_of_a_fit_of_the_column() -> None:
    volts, known = _swept(20_000)
    noise = np.random.default_rng(3).standard_normal(volts.size) + 0.1 * np.sin(2 * np.pi * volts / 1.7)
    best = converter_places(pulled(noise, known), volts, 0.01, 1)[0]
    without, with_it = (
        np.linalg.lstsq(columns, noise, rcond=None)[1][0]
        for columns in (known, np.column_stack([known, np.sin(2 * np.pi * volts / best.value)]))
    )
    assert best.gain == pytest.approx(without - with_it, rel=0.02)


def test_where_there_is_no_wave_chance_promises_no_more_than_it_may() -> None:
    volts, known = _swept(1500)
    chance, promised = np.random.default_rng(4), []
    for _ in range(300):
        places = converter_places(pulled(chance.standard_normal(volts.size), known), volts, 0.01, 1)
        promised.append(places[0].gain - 2.0 * math.log(places[0].places))
    for level in (4.0, 6.0):
        allowed = math.exp(-level / 2.0)
        assert np.mean(np.array(promised) > level) < allowed + 3.0 * math.sqrt(allowed / 300)
    assert max(promised) < 14.0


def test_a_few_constant_voltages_are_not_given_a_wave_of_a_period_that_they_do_not_resolve() -> None:
    volts = np.repeat([-2.0, -1.3, -0.8, -0.2, 0.3, 1.1, 1.6, 2.1], 500)
    known = np.stack([volts**power for power in (0, 1)], axis=1)
    unlike = np.repeat(np.random.default_rng(5).standard_normal(8), 500)
    found = converter_places(pulled(unlike, known), volts, 0.01, 3)
    assert found
    assert all(place.value > 4.1 / 4.0 for place in found)
