"""What is gathered of a recording for all tests: above all, which of its sweeps is the reference."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from benchctl.metrology.observations import Observations, Settings, both_directions, celsius_of, observe, same_set_point
from benchctl.plan import Mount, PowerCycle, Soak, Static, Step, levels, rates_between_zeros
from tests.benchctl.metrology.altered import altered, stating
from tests.benchctl.metrology.made_unit import MadeUnit, recorded


def soak(celsius: float) -> Soak:
    return Soak(setpoint_c=celsius, hold_s=60.0)


def sweep(top_dps: float, rates: int = 2) -> list[Step]:
    return list(rates_between_zeros(levels(top_dps, rates), at_least_s=10.0, zero_s=20.0))


def obs(steps: Sequence[Step]) -> Observations:
    return observe(recorded(steps, MadeUnit(), 1, errors=False)[0], Settings())


@pytest.mark.parametrize(
    ("steps", "reference"),
    [
        ([soak(20), *sweep(50), soak(60), *sweep(50)], 0),
        ([soak(60), *sweep(50), soak(22), *sweep(50), soak(-40), *sweep(50)], 1),
        ([soak(20), *sweep(50), soak(60), *sweep(100)], 1),  # further counts more than nearer to room
        ([soak(20), *sweep(50), PowerCycle(off_s=9.0), *sweep(50)], 0),
        ([soak(20), *sweep(50), Mount(position="across"), *sweep(100)], 0),
        ([soak(20), Static(duration_s=60.0), soak(60), *sweep(50)], 1),
    ],
    ids=["first", "room", "further", "first-turn-on", "not-across", "not-rest"],
)
def test_the_reference_is_the_sweep_that_reaches_furthest_at_the_temperature_nearest_to_rooms(
    steps: Sequence[Step], reference: int
) -> None:
    assert obs(steps).reference == reference


def test_a_rest_alone_or_one_rate_is_no_reference() -> None:
    one = obs([soak(20), Static(duration_s=60.0)])
    assert one.reference is None
    assert one.at_reference is None
    assert np.isnan(one.scale_v_per_dps)
    assert obs([soak(20), *sweep(50, 1)]).reference == 0  # rest and one rate in both directions are three
    one_way = [step for step in sweep(50, 1) if getattr(step, "rate_dps", 0.0) >= 0.0]
    assert obs([soak(20), *one_way]).reference is None


def test_the_scale_is_the_slope_at_the_reference() -> None:
    unit = MadeUnit(cubic_per_dps2=0.0, asymmetry=0.0, hysteresis=0.0, dead_dps=0.0, scale_per_c=1e-3)
    steps = [soak(20), *sweep(50), soak(60), *sweep(50)]
    found = observe(recorded(steps, unit, 1, errors=False)[0], Settings())
    assert found.scale_v_per_dps == pytest.approx(unit.K_v_per_dps, rel=1e-5)
    assert found.swept_in([1]).stretch.tolist() == [1] * 5
    assert found.in_stretch(1).set_dps.size == 5


def test_set_points_that_nobody_states_are_one() -> None:
    nowhere = float("nan")
    assert same_set_point(20.0, 20.9)
    assert same_set_point(nowhere, nowhere)
    assert not same_set_point(20.0, 21.1)
    assert not same_set_point(20.0, nowhere)
    assert celsius_of(20.0, 22.0) == 21.0
    assert celsius_of(20.0, nowhere) is None


def test_two_visits_of_one_rate_are_no_two_rates_of_a_direction() -> None:
    points = obs([soak(20), *sweep(50), *sweep(50)]).points
    assert both_directions(points)
    assert not both_directions(points.of(points.set_dps > 0.0))
    assert not both_directions(points.of(np.abs(points.set_dps) == 50.0))


def test_without_any_set_point_all_is_one_temperature() -> None:
    made = recorded([*sweep(50)], MadeUnit(), 1, errors=False)[0]
    found = observe(altered(made, stating(chamber_setpoint_c=float("nan"))), Settings())
    assert found.reference == 0
    assert found.stretches[0].temperature_c == pytest.approx(20.0, abs=0.01)
