import math

import numpy as np
import pytest

from benchctl.diagnosis.search import scan_mains
from benchctl.diagnosis.search.scan_mains import mains_places, swing_hz
from tests.benchctl.diagnosis.pulled import FloatArray, pulled

INTERVAL_S = 0.01


def _clock(rows: int) -> FloatArray:
    return np.arange(rows, dtype=np.float64) * INTERVAL_S


@pytest.mark.parametrize("frequency_hz", [0.73, 12.3456, 49.9371])
def test_a_line_is_found_well_within_its_own_lobe(frequency_hz: float) -> None:
    time_s = _clock(40_000)
    noise = np.random.default_rng(1).standard_normal(time_s.size)
    pull = pulled(noise + 0.1 * np.sin(2 * np.pi * frequency_hz * time_s + 0.4))
    best = mains_places(pull, time_s, INTERVAL_S, np.zeros(time_s.size, np.int64), 0.1, 3)[0]
    assert best.value == pytest.approx(frequency_hz, abs=0.1 / time_s[-1])
    assert best.gain == pytest.approx(0.1**2 / 2 * time_s.size, rel=0.3)
    assert best.gain - 2.0 * math.log(best.places) > 100.0


def test_stretches_off_each_other_s_grid_are_one_line_all_along() -> None:
    time_s = np.concatenate([_clock(9000), 133.3337 + _clock(9000), 260.00519 + _clock(9000)])
    pull = pulled(np.random.default_rng(2).standard_normal(time_s.size) + 0.15 * np.sin(2 * np.pi * 31.4159 * time_s))
    best = mains_places(pull, time_s, INTERVAL_S, np.zeros(time_s.size, np.int64), 0.1, 1)[0]
    assert best.value == pytest.approx(31.4159, abs=0.1 / time_s[-1])


def test_a_line_above_half_the_sampling_rate_is_reported_at_its_alias() -> None:
    time_s = _clock(20_000)
    pull = pulled(np.random.default_rng(3).standard_normal(time_s.size) + 0.3 * np.sin(2 * np.pi * 60.2 * time_s))
    best = mains_places(pull, time_s, INTERVAL_S, np.zeros(time_s.size, np.int64), 0.1, 1)[0]
    assert best.value == pytest.approx(39.8, abs=1e-3)


def test_a_multiple_of_the_one_frequency_at_which_a_table_swings_is_the_motion_s_own() -> None:
    time_s = _clock(4000)
    rate_dps = 110.0 * np.sin(2 * np.pi * 7.03 * time_s)
    swinging_hz = swing_hz(rate_dps, time_s, INTERVAL_S)
    assert swinging_hz == pytest.approx(7.03, abs=0.5 / time_s[-1])
    noise = np.random.default_rng(7).standard_normal(time_s.size)
    pull = pulled(noise + sum(0.5 * np.sin(2 * np.pi * hz * time_s) for hz in (4.0 * 7.03, 31.0)))
    one_kind = np.zeros(time_s.size, np.int64)
    values = [one.value for one in mains_places(pull, time_s, INTERVAL_S, one_kind, 0.1, 3, swinging_hz)]
    assert values[0] == pytest.approx(31.0, abs=0.01)
    assert all(abs(value - 4.0 * 7.03) > 0.02 for value in values)
    two_sines = rate_dps + 110.0 * np.sin(2 * np.pi * 3.1 * time_s)
    assert swing_hz(two_sines, time_s, INTERVAL_S) == 0.0


def test_a_line_of_one_kind_of_motion_is_the_motion_s_own() -> None:
    time_s = _clock(30_000)
    kind = (time_s > 150.0).astype(np.int64)
    line = np.sin(2 * np.pi * 0.6 * time_s)
    noise = np.random.default_rng(4).standard_normal(time_s.size)
    alone = mains_places(pulled(noise + 0.2 * line * (kind > 0)), time_s, INTERVAL_S, kind, 0.1, 3)
    assert all(abs(one.value - 0.6) > 0.01 for one in alone)
    throughout = mains_places(pulled(noise + 0.2 * line), time_s, INTERVAL_S, kind, 0.1, 3)
    assert throughout[0].value == pytest.approx(0.6, abs=1e-3)


def test_where_there_is_no_line_chance_promises_no_more_than_it_may() -> None:
    chance, time_s, promised = np.random.default_rng(5), _clock(3000), []
    one_kind = np.zeros(time_s.size, np.int64)
    for _ in range(300):
        places = mains_places(pulled(chance.standard_normal(time_s.size)), time_s, INTERVAL_S, one_kind, 0.1, 3)
        promised.append(max((one.gain - 2.0 * math.log(one.places) for one in places), default=0.0))
    for level in (2.0, 4.0, 6.0):
        allowed = math.exp(-level / 2.0)
        assert np.mean(np.array(promised) > level) < allowed + 3.0 * math.sqrt(allowed / 300)
    assert max(promised) < 14.0


def test_a_line_near_half_the_sampling_rate_beats_and_is_one_line_all_the_same() -> None:
    time_s = _clock(100_000)
    kind = (time_s % (0.5 / 0.0022) < 0.25 / 0.0022).astype(np.int64)
    line = np.sin(2 * np.pi * 49.9978 * time_s + 0.3)
    noise = np.random.default_rng(5).standard_normal(time_s.size)
    best = mains_places(pulled(noise + line), time_s, INTERVAL_S, kind, 0.1, 1)[0]
    assert best.value == pytest.approx(49.9978, abs=1e-4)


def test_a_line_far_above_a_swing_is_found_where_it_is_a_multiple_of_it() -> None:
    time_s = _clock(4000)
    noise = np.random.default_rng(8).standard_normal(time_s.size)
    pull = pulled(noise + 0.5 * np.sin(2 * np.pi * 41.1 * time_s))
    best = mains_places(pull, time_s, INTERVAL_S, np.zeros(time_s.size, np.int64), 0.1, 1, 41.1 / 60.0)[0]
    assert best.value == pytest.approx(41.1, abs=0.01)


def test_the_flank_of_a_broad_rise_of_the_spectrum_is_no_line(monkeypatch: pytest.MonkeyPatch) -> None:
    time_s = _clock(4000)
    flank = np.zeros(2001)
    flank[500:700] = 10_000.0 - 45.0 * np.arange(200) - 1e-4 * np.arange(200) ** 2
    found = np.arange(2001) * (50.0 / 2000), flank, np.ones(2001)
    monkeypatch.setattr(scan_mains, "_periodogram", lambda *_: found)
    places = mains_places(pulled(np.ones(time_s.size)), time_s, INTERVAL_S, np.zeros(time_s.size, np.int64), 0.1, 3)
    assert all(place.value > 0.0 for place in places)  # a parabola through a flank may have its top far below 0 Hz
