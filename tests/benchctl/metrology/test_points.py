"""Points of readings: which belong to a line, which leg they are on, and what is not known of them."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.calibration.noise_model import MeansNoise
from benchctl.metrology.points import DOWN, REST, UP, Points, points_of
from benchctl.metrology.stretches import Stretch
from benchctl.recordings.stated import stated_of
from tests.benchctl.metrology.made_readings import BIAS_V, LENGTH_S, SCALE_V_PER_DPS, stretch
from tests.benchctl.recordings.made import meta

STILL = [(MeansNoise(walk=0.0, excess=1.0), 1.0)]


def points(*stretches: Stretch, walk: float = 0.0) -> Points:
    return points_of(stretches, [(MeansNoise(walk=walk, excess=1.0), 1.0)])


def swept(rates_dps: list[float]) -> list[float]:
    found = points(stretch(rates_dps))
    return found.set_dps[found.swept].tolist()


def test_the_rest_comes_first_as_one_point_then_the_rates_in_time_order() -> None:
    found = points(stretch([0.0, 10.0, -10.0, 0.0, 20.0]))
    assert found.set_dps.tolist() == [0.0, 10.0, -10.0, 20.0]
    assert found.output_v == pytest.approx(SCALE_V_PER_DPS * found.rate_dps + BIAS_V)
    assert found.duration_s.tolist() == [2 * LENGTH_S, LENGTH_S, LENGTH_S, LENGTH_S]
    assert found.step.tolist() == [1, 2, 3, 5]
    assert found.covariance_v2 == pytest.approx(np.diag([0.5e-12, 1e-12, 1e-12, 1e-12]))


def test_all_the_rest_of_a_stretch_is_named_with_its_points() -> None:
    found = points(stretch([0.0, 10.0, 0.0]), stretch([5.0, 0.0], first=3))
    assert found.steps == (1, 2, 3, 4, 5)
    assert found.of(found.stretch == 1).steps == (4, 5)
    assert found.of(found.set_dps == 10.0).steps == (2,)


def test_without_rest_there_are_only_rates() -> None:
    found = points(stretch([10.0, -10.0]))
    assert found.leg.tolist() == [UP, UP]


def test_a_leg_is_by_the_rate_before_in_the_same_direction() -> None:
    found = points(stretch([0.0, 10.0, -20.0, 30.0, -10.0, 20.0, 20.0, 25.0]))
    assert found.leg.tolist() == [REST, UP, UP, UP, DOWN, DOWN, UP, UP]


def test_every_stretch_begins_its_legs_anew() -> None:
    found = points(stretch([10.0, 20.0]), stretch([10.0]))
    assert found.leg.tolist() == [UP, UP, UP]
    assert found.stretch.tolist() == [0, 0, 1]


@pytest.mark.parametrize(
    ("rates_dps", "expected"),
    [
        ([0.0, 10.0, -10.0, 20.0, -20.0, 0.0], [0.0, 10.0, -10.0, 20.0, -20.0]),
        # up and down both count, the second time on one leg does not
        ([10.0, 20.0, 10.0, 20.0, 10.0, -10.0, -20.0, -10.0], [10.0, 20.0, 10.0, -10.0, -20.0, -10.0]),
        # small steps about a base rate would weigh it more, and so would coming back to it
        ([0.0, 10.0, -10.0, 10.01, 9.99, 10.0, 10.02, 9.98, 10.0], [0.0, 10.0, -10.0]),
        # below 1 °/s a rate is too small to tell a scale factor
        ([0.0, 0.5, -0.5, 1.0, -1.0], [0.0, 1.0, -1.0]),
        # a rate in one direction only would tilt the line where there are others in both
        ([0.0, 10.0, -10.0, 50.0], [0.0, 10.0, -10.0]),
        # but where there is none in both, they are all there is
        ([0.0, 10.0, 20.0, 50.0], [0.0, 10.0, 20.0, 50.0]),
        ([0.0, 10.0, -20.0], [0.0, 10.0, -20.0]),
    ],
)
def test_a_line_is_fitted_to_the_first_visit_of_rates_in_both_directions(
    rates_dps: list[float], expected: list[float]
) -> None:
    assert swept(rates_dps) == expected


def test_each_stretch_is_swept_by_itself() -> None:
    found = points(stretch([10.0, -10.0, 30.0]), stretch([30.0, 40.0]))
    assert found.swept.tolist() == [True, True, False, True, True]


def test_base_rate_visits_after_small_steps_count_once_a_leg() -> None:
    found = points(stretch([10.0, -10.0, 10.01, 10.0, 10.0]))
    assert found.leg.tolist() == [UP, UP, UP, DOWN, UP]
    assert found.swept.tolist() == [True, True, False, True, False]


def quantities(found: Points, *, drifting: bool = True) -> dict[str, np.ndarray]:
    """Covariances by name."""
    stated = stated_of(meta())
    return {one.name: one.root @ one.root.T for one in found.quantities(stated, drifting=drifting)}


def test_what_is_not_known_of_points_is_in_their_units() -> None:
    one = points(stretch([0.0, 10.0, -10.0]))
    stated = stated_of(meta())
    found = quantities(one)
    assert found["scatter"] == pytest.approx(one.covariance_v2)
    rate = np.sqrt(2.0) * stated.encoder_arcsec.standard / 3600.0 / LENGTH_S
    assert found["encoder"] == pytest.approx(np.diag([0.0, rate**2, rate**2]))
    assert found["clock"].item() == pytest.approx((1e-6 * stated.clock_ppm.standard) ** 2)
    assert found["mounting"].item() == pytest.approx(np.deg2rad(stated.mounting_deg.standard) ** 2)
    assert found["converter's offset"].item() == pytest.approx(stated.offset_v.standard**2)


def test_between_stretches_the_bias_walks_on_and_within_one_it_is_known() -> None:
    walk = 1e-10
    one = points(stretch([0.0, 10.0]), stretch([0.0], first=5), stretch([0.0], first=9), walk=walk)
    apart = quantities(one)["scatter"] - quantities(one, drifting=False)["scatter"]
    begun_s = np.array([0.0, 0.0, 50.0, 90.0])
    assert apart == pytest.approx(walk * np.minimum.outer(begun_s, begun_s))
    assert quantities(one, drifting=False)["scatter"] == pytest.approx(one.covariance_v2)
    later = one.of(one.stretch > 0)  # the first of those that are compared is the beginning
    assert quantities(later)["scatter"] - later.covariance_v2 == pytest.approx(walk * np.diag([0.0, 40.0]))


def test_offsets_move_rates_and_volts_as_the_instruments_would_have_them() -> None:
    one = points(stretch([0.0, 10.0]))
    zero = {name: np.zeros((1, value.shape[0])) for name, value in quantities(one).items()}
    rate_dps, output_v = one.moved(zero)
    assert rate_dps[0] == pytest.approx(one.rate_dps)
    assert output_v[0] == pytest.approx(one.output_v)
    moved = {**zero, "clock": np.array([[1e-3]]), "mounting": np.array([[0.1]]), "encoder": np.array([[0.0, 0.5]])}
    assert one.moved(moved)[0][0] == pytest.approx([0.0, 10.5 * 1.001 * np.cos(0.1)])
    moved = {**zero, "converter's gain": np.array([[1e-3]]), "converter's offset": np.array([[0.2]])}
    assert one.moved(moved)[1][0] == pytest.approx(1.001 * one.output_v + 0.2)


def test_some_of_the_points_keep_their_own_covariance() -> None:
    one = points(stretch([0.0, 10.0, -10.0, 0.0, 20.0]), walk=1e-10)
    some = one.of(np.array([2, 0]))
    assert some.set_dps.tolist() == [-10.0, 0.0]
    assert some.covariance_v2 == pytest.approx(one.covariance_v2[np.ix_([2, 0], [2, 0])])
    assert one.of(one.set_dps > 0.0).set_dps.tolist() == [10.0, 20.0]


def test_of_nothing_there_are_no_points() -> None:
    assert points_of([], STILL).set_dps.size == 0
