"""Stretches of readings: where they end, what is passed over, and where the chamber came from."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.metrology.stretches import Stretch, residual_structure_of, stretches_of
from benchctl.plan import ConstantRate, Mount, PowerCycle, Sine, Soak, Static, Step, ThermalRamp
from benchctl.recordings.reader import Recording
from tests.benchctl.metrology.altered import altered, nan_in, stating, without
from tests.benchctl.metrology.made_unit import MadeUnit, recorded

UNIT = MadeUnit()
REST, RATE = Static(duration_s=45.0), ConstantRate(rate_dps=20.0, duration_s=18.0)


def recording(*steps: Step) -> Recording:
    return recorded(steps, UNIT, 1, errors=False)[0]


def stretches(*steps: Step) -> list[Stretch]:
    return list(stretches_of(recording(*steps)))


def rates(stretch: Stretch) -> list[float]:
    return [one.set_dps for one in stretch.readings]


@pytest.mark.parametrize(
    "between",
    [
        Soak(setpoint_c=40.0, hold_s=60.0),
        Soak(setpoint_c=20.0, hold_s=60.0),
        ThermalRamp(from_c=20.0, to_c=21.0, ramp_c_per_min=1.0),
        PowerCycle(off_s=60.0),
        Mount(position="across"),
    ],
    ids=lambda step: step.label,
)
def test_a_soak_a_ramp_a_power_cycle_and_a_remounting_end_a_stretch(between: Step) -> None:
    found = stretches(Soak(setpoint_c=20.0, hold_s=60.0), RATE, between, RATE)
    assert [rates(one) for one in found] == [[20.0], [20.0]]
    assert found[1].power_on == (between.kind == "power_cycle")
    assert [one.across for one in found] == [False, between.kind == "mount"]


def test_a_swing_inside_a_stretch_is_passed_over() -> None:
    (one,) = stretches(RATE, Sine(amplitude_dps=50.0, frequency_hz=1.0, cycles=20), RATE)
    assert rates(one) == [20.0, 20.0]


def test_two_breaks_in_a_row_leave_no_empty_stretch() -> None:
    found = stretches(PowerCycle(off_s=9.0), Soak(setpoint_c=30.0, hold_s=9.0), RATE, PowerCycle(off_s=9.0))
    assert [(one.setpoint_c, one.power_on) for one in found] == [(30.0, 1)]


def test_the_rest_right_after_a_power_cycle_is_no_reading_and_the_next_is() -> None:
    (one,) = stretches(PowerCycle(off_s=9.0), REST, RATE, REST)
    assert rates(one) == [20.0, 0.0, 0.0, 0.0, 0.0]
    (one,) = stretches(PowerCycle(off_s=9.0), RATE, REST)
    assert rates(one)[0] == 20.0


def test_the_unit_lies_along_the_axis_again_once_it_is_mounted_so() -> None:
    found = stretches(RATE, Mount(position="across"), RATE, Mount(position="along"), RATE)
    assert [one.across for one in found] == [False, True, False]


def test_where_the_chamber_came_from_is_known_through_soaks_at_one_set_point_and_turn_ons() -> None:
    found = stretches(
        RATE,
        Soak(setpoint_c=60.0, hold_s=9.0),
        RATE,
        Soak(setpoint_c=60.0, hold_s=9.0),
        PowerCycle(off_s=9.0),
        RATE,
        Soak(setpoint_c=20.0, hold_s=9.0),
        RATE,
    )
    assert [one.setpoint_c for one in found] == [20.0, 60.0, 60.0, 20.0]
    assert [one.before_c for one in found][1:] == [20.0, 20.0, 60.0]
    assert np.isnan(found[0].before_c)


def test_a_first_soak_comes_from_nowhere() -> None:
    (one,) = stretches(Soak(setpoint_c=60.0, hold_s=9.0), RATE)
    assert np.isnan(one.before_c)


def test_after_a_ramp_the_chamber_has_come_from_where_the_ramp_began() -> None:
    ramp = ThermalRamp(from_c=20.0, to_c=25.0, ramp_c_per_min=5.0)
    found = stretches(Soak(setpoint_c=20.0, hold_s=9.0), RATE, ramp, Soak(setpoint_c=25.0, hold_s=9.0), RATE)
    assert [(one.setpoint_c, one.before_c) for one in found][1:] == [(25.0, 20.0)]


@pytest.mark.parametrize(("length_s", "pieces"), [(9.0, 1), (25.0, 2), (105.0, 10), (500.0, 20)])
def test_rest_is_cut_into_pieces_of_ten_seconds_and_more_but_no_more_than_twenty(length_s: float, pieces: int) -> None:
    (one,) = stretches(Static(duration_s=length_s))
    assert len(one.readings) == pieces
    lengths = np.array([piece.duration_s for piece in one.readings])
    assert lengths.sum() == pytest.approx(length_s, rel=0.03)
    assert np.ptp(lengths) < 0.3 * lengths.mean()
    assert np.all(np.diff([piece.middle_s for piece in one.readings]) > 0.0)


def test_a_reading_has_the_mean_of_its_samples_and_the_variance_of_that_mean() -> None:
    unit = MadeUnit(walk_v_per_sqrt_s=0.0, hysteresis=0.0)
    long = ConstantRate(rate_dps=20.0, duration_s=180.0)
    made = recorded([long] * 30, unit, 4, errors=False)[0]
    (one,) = stretches_of(made)
    outputs = np.array([reading.output_v for reading in one.readings])
    expected = unit.white_v_per_sqrt_hz**2 / 162.0
    stated = np.mean([reading.white_v2 for reading in one.readings])
    assert stated == pytest.approx(expected, rel=0.1)
    assert np.var(outputs, ddof=1) == pytest.approx(expected, rel=0.6)
    assert [reading.rate_dps for reading in one.readings] == pytest.approx([20.0] * 30, rel=1e-9)
    assert one.readings[0].duration_s == pytest.approx(162.0)  # whole turns, once it has settled


def test_steps_that_were_cut_are_passed_over() -> None:
    cut = altered(recording(RATE, REST), stating(whole=False))
    assert list(stretches_of(cut)) == []


def test_a_step_without_a_usable_sample_is_no_reading() -> None:
    made = recording(RATE, REST)
    (one,) = stretches_of(altered(made, nan_in("gyro_v", "static")))
    assert rates(one) == [20.0]


def test_where_no_rate_is_stated_it_is_the_encoders() -> None:
    (one,) = stretches_of(altered(recording(RATE, REST), stating(rate_dps=None)))
    assert rates(one) == pytest.approx([20.0, 0.0, 0.0, 0.0, 0.0])
    assert rates(one)[1:] == [0.0] * 4


def test_without_a_thermistor_a_stretch_is_as_warm_as_its_set_point() -> None:
    made = recording(Soak(setpoint_c=60.0, hold_s=9.0), RATE)
    (with_it,) = stretches_of(made)
    (without_it,) = stretches_of(altered(made, without("gyro_temp_c")))
    assert with_it.temperature_c == pytest.approx(60.0, abs=0.01)
    assert with_it.temperature_c != 60.0
    assert without_it.temperature_c == 60.0


def test_the_longest_rest_is_none_after_a_turn_on_or_across_or_cut() -> None:
    made = recording(
        REST,
        Static(duration_s=90.0),
        PowerCycle(off_s=9.0),
        Static(duration_s=500.0),
        Mount(position="across"),
        Static(duration_s=300.0),
    )
    found = residual_structure_of(made)
    assert found is not None
    assert found.index == 2
    assert residual_structure_of(altered(made, stating(whole=False))) is None
    assert residual_structure_of(recording(RATE)) is None
