"""Static points whose largest rates have left the law: rails, an overload, a fold, or none of these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from benchctl.diagnosis.gyro.points_end import PointsEnd
from benchctl.recordings.static_points import StaticPoints
from benchctl_instruments.physics.effects.fringe_ambiguity import folded_dps

FloatArray = npt.NDArray[np.float64]

RATES = np.array([-200, -160, -120, -80, -40, 0, 40, 80, 120, 160, 200, -100, -60, -20, 20, 60, 100], np.float64)
K0, U0, S, SCATTER_V = -0.02, 2.65, 0.0045, 5e-4


def table(volts: FloatArray, rates: FloatArray = RATES) -> StaticPoints:
    scatter = SCATTER_V * np.random.default_rng(1).standard_normal(rates.size)
    return StaticPoints(rate_dps=rates, mean_v=volts + scatter)


def line(rates: FloatArray = RATES) -> FloatArray:
    return U0 + K0 * rates


def sine(rates: FloatArray) -> FloatArray:
    return np.asarray(U0 + K0 / S * np.sin(S * rates))


def end_of(points: StaticPoints) -> PointsEnd:
    end = PointsEnd.of(points)
    assert end is not None
    return end


def test_points_that_all_follow_the_law_have_no_end() -> None:
    assert PointsEnd.of(table(sine(RATES))) is None


def test_means_that_agree_at_several_rates_stand_at_rails_of_their_own() -> None:
    end = end_of(table(np.clip(line(), 0.136, 5.135)))
    rails = end.rails()
    assert rails is not None
    assert (rails.lower_v, rails.upper_v) == pytest.approx((0.136, 5.135), abs=2 * SCATTER_V)
    assert end.overload() is None


def test_one_rail_leaves_the_other_side_to_its_outputs() -> None:
    points = table(np.maximum(line(), 0.136))
    rails = end_of(points).rails()
    assert rails is not None
    assert rails.lower_v == pytest.approx(0.136, abs=2 * SCATTER_V)
    assert rails.upper_v == points.mean_v.max()


@pytest.mark.parametrize(("std_v", "stands"), [(0.0015, True), (0.0045, False)])
def test_a_single_rate_beyond_the_law_is_a_rail_where_its_deviation_collapses(std_v: float, stands: bool) -> None:
    rates = RATES[np.abs(RATES) != 160.0]
    stated = np.where(np.abs(rates) == 200.0, std_v, 0.004)
    end = end_of(replace(table(np.clip(line(rates), 0.136, 5.135), rates), std_v=stated))
    assert (end.rails() is not None) == stands
    assert bool(list(end.remarks())) == stands


def test_an_output_that_falls_again_is_an_overload_and_no_rail() -> None:
    rates = np.concatenate([RATES, [-240.0, -320.0, -400.0, 240.0, 320.0, 400.0]])
    beyond = np.maximum(np.abs(rates) - 220.0, 0.0)
    end = end_of(table(sine(rates) - 1.2 * K0 * np.sign(rates) * beyond, rates))
    fault = end.overload()
    assert fault is not None
    assert end.rails() is None
    assert fault.rows.tolist() == (np.abs(rates) > 200.0).tolist()
    onset, loss = (fault.parameters[name] for name in ("onset_dps", "loss_v_per_dps"))
    assert (onset.low, onset.high) == (200.0, 240.0)
    assert loss.low < 1.2 * abs(K0) < loss.high
    assert fault.where is not None
    assert fault.where.ranges == ((240.0, 400.0),)


def test_a_fold_falls_by_the_law_itself_and_is_no_overload() -> None:
    rates = np.concatenate([RATES, [-240.0, -280.0, -320.0, 240.0, 280.0, 320.0]])
    assert end_of(table(line(folded_dps(rates, 225.0)), rates)).overload() is None


def test_an_output_that_grows_less_is_no_overload() -> None:
    rates = np.concatenate([RATES, [-240.0, -320.0, -400.0, 240.0, 320.0, 400.0]])
    beyond = np.maximum(np.abs(rates) - 220.0, 0.0)
    assert end_of(table(line(rates) - 0.5 * K0 * np.sign(rates) * beyond, rates)).overload() is None
