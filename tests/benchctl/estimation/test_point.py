"""The numbers of a model: which are fitted, in what scale, and how far they go."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchctl.estimation.point import Free, Point, interval_of
from benchctl_instruments.physics.chamber_effects.heater_nonlinearity import HeaterNonlinearity
from tests.benchctl.diagnosis.toy_problem import Cubic, Decay, Ripple

NAMES = ("K0_v_per_dps", "U0_v")
DECAY = Decay(amplitude_v=2e-3, tau_s=300.0)
RIPPLE = Ripple(amplitude_v=1e-3, phase_deg=350.0, order=2.0)
POINT = Point(baseline=np.array([0.02, 0.01]), effects=(DECAY, RIPPLE))


def values_of(point: Point) -> list[float]:
    return [point.value(number, i) for i, number in enumerate(point.free(NAMES))]


def moved(point: Point, **by: float) -> Point:
    """The point with some of its effects' numbers changed by so much in the scale in which they are moved."""
    numbers = point.free(NAMES)
    changed = [value + by.get(number.name, 0.0) for number, value in zip(numbers, values_of(point), strict=True)]
    return point.moved(numbers, np.array(changed))


def test_all_but_choices_are_free_the_baseline_first() -> None:
    free = [(number.effect, number.name) for number in POINT.free(NAMES)]
    assert free == [
        (None, "K0_v_per_dps"),
        (None, "U0_v"),
        (0, "amplitude_v"),
        (0, "tau_s"),
        (1, "amplitude_v"),
        (1, "phase_deg"),
    ]


def test_a_time_constant_goes_in_its_logarithm_and_all_else_as_it_is() -> None:
    assert values_of(POINT) == pytest.approx([0.02, 0.01, 2e-3, math.log(300.0), 1e-3, 350.0])
    longer, _ = moved(POINT, tau_s=math.log(2.0)).effects
    assert longer.values == pytest.approx({"amplitude_v": 2e-3, "tau_s": 600.0})


def test_a_phase_goes_round() -> None:
    _, turned = moved(POINT, phase_deg=20.0).effects
    assert turned.values["phase_deg"] == pytest.approx(10.0)


@pytest.mark.parametrize(("by", "stops_at"), [(50.0, 1e4), (-50.0, 10.0), (1e6, 1e4), (-1e6, 10.0)])
def test_a_number_stops_at_its_bounds(by: float, stops_at: float) -> None:
    decay, _ = moved(POINT, tau_s=by).effects
    assert decay.values["tau_s"] == pytest.approx(stops_at)


def test_the_logarithm_of_nothing_is_a_number() -> None:
    nothing = Point(baseline=POINT.baseline, effects=(Decay(amplitude_v=0.0, tau_s=0.0),))
    number = Free("tau_s", 0, Decay.parameters["tau_s"])
    assert math.isfinite(nothing.value(number, 3))


def test_a_model_that_is_moved_leaves_the_one_that_it_came_from() -> None:
    numbers = POINT.free(NAMES)
    other = POINT.moved(numbers, np.array(values_of(POINT)) + 1e-3)
    assert other.baseline.tolist() == pytest.approx([0.021, 0.011])
    assert POINT.baseline.tolist() == [0.02, 0.01]
    assert POINT.effects == (DECAY, RIPPLE)


def test_without_effects_only_the_baseline_is_free() -> None:
    assert Point(baseline=np.zeros(2)).free(NAMES) == [Free(name, None, None) for name in NAMES]
    assert Point(baseline=np.zeros(1), effects=(Cubic(size_v=1.0),)).free(["U0_v"])[1].effect == 0


def test_of_a_heater_far_from_proportional_the_sign_is_sure_though_its_size_is_not() -> None:
    curvature = HeaterNonlinearity.parameters["curvature"]
    low, high = interval_of(curvature, 5.2, 9.0)
    assert 0.0 < low < 5.2 < high
    assert (1.0 + low) * (1.0 + high) == pytest.approx(6.2**2)
    assert interval_of(curvature, 0.01, 0.002) == pytest.approx((0.008, 0.012), abs=1e-5)
