from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.table import AMPLITUDE_SHARE, Piece, TableParameters, to_angle, to_rate, to_sine

ANGLES = st.floats(-1e4, 1e4)
RATES = st.floats(-400.0, 400.0)
RATE_LIMIT = 400.0
ACCELERATION = 2000.0


def check_profile(pieces: tuple[Piece, ...], angle_deg: float, rate_dps: float, rate_limit_dps: float) -> None:
    """A profile begins where it should, is continuous in angle and rate, keeps its limits and ends for ever."""
    assert pieces[0].at(0.0)[:2] == pytest.approx((angle_deg, rate_dps), abs=1e-7)
    for piece, following in itertools.pairwise(pieces):
        assert piece.at(piece.duration_s)[:2] == pytest.approx(following.at(0.0)[:2], abs=1e-6)
    for piece in pieces:
        for tau_s in np.linspace(0.0, min(piece.duration_s, 10.0), 200).tolist():
            _, rate, acceleration = piece.at(tau_s)
            assert abs(rate) <= rate_limit_dps * (1 + 1e-9)
            assert abs(acceleration) <= ACCELERATION * (1 + 1e-9)
    assert [math.isinf(piece.duration_s) for piece in pieces] == [False] * (len(pieces) - 1) + [True]


def duration(pieces: tuple[Piece, ...]) -> float:
    return sum(piece.duration_s for piece in pieces[:-1])


def test_a_rate_is_reached_at_the_acceleration_limit() -> None:
    ramp, steady = to_rate(10.0, -50.0, 150.0, 2000.0)
    assert ramp.duration_s == pytest.approx(0.1)
    assert steady.angle_deg == pytest.approx(10.0 + 0.1 * 50.0)
    assert steady.at(7.0)[1] == 150.0


def test_a_short_move_is_a_triangle() -> None:
    # 2·√(d/a), peak √(d·a)
    pieces = to_angle(0.0, 0.0, 5.0, 400.0, 2000.0)
    assert duration(pieces) == pytest.approx(2.0 * math.sqrt(5.0 / 2000.0))
    assert pieces[1].rate_dps == pytest.approx(math.sqrt(5.0 * 2000.0))


def test_a_long_move_is_a_trapezoid() -> None:
    # d/v + v/a
    pieces = to_angle(0.0, 0.0, -180.0, 400.0, 2000.0)
    assert duration(pieces) == pytest.approx(180.0 / 400.0 + 400.0 / 2000.0)
    assert pieces[1].rate_dps == pytest.approx(-400.0)


def test_a_move_that_cannot_stop_in_time_comes_back() -> None:
    # 10° of stopping distance at 200 deg/s, then 10° back
    pieces = to_angle(0.0, 200.0, 0.0, 400.0, 2000.0)
    assert duration(pieces) == pytest.approx(0.1 + 2.0 * math.sqrt(10.0 / 2000.0))
    assert pieces[-1].angle_deg == 0.0


@given(angle=ANGLES, rate=RATES, target=RATES)
def test_every_change_of_rate_is_continuous_and_within_limits(angle: float, rate: float, target: float) -> None:
    pieces = to_rate(angle, rate, target, ACCELERATION)
    check_profile(pieces, angle, rate, RATE_LIMIT)
    assert pieces[-1].rate_dps == target


@given(angle=ANGLES, rate=RATES, target=ANGLES)
def test_every_move_is_continuous_within_limits_and_ends_at_its_angle(angle: float, rate: float, target: float) -> None:
    pieces = to_angle(angle, rate, target, RATE_LIMIT, ACCELERATION)
    check_profile(pieces, angle, rate, RATE_LIMIT)
    assert pieces[-1].at(100.0) == (target, 0.0, 0.0)


@given(rate=st.floats(-400.0, 400.0), distance=st.floats(-500.0, 500.0))
def test_a_move_under_a_lowered_rate_limit_slows_down_to_it_and_arrives(rate: float, distance: float) -> None:
    pieces = to_angle(0.0, rate, distance, 100.0, ACCELERATION)
    check_profile(pieces, 0.0, rate, max(abs(rate), 100.0))
    assert pieces[-1].angle_deg == distance


@given(
    rate=RATES,
    amplitude=st.floats(1e-3, 1e3),
    frequency=st.floats(0.05, 20.0),
    phase=st.floats(-360.0, 360.0),
    growth=st.floats(0.1, 1e4),
)
def test_every_oscillation_is_continuous_and_within_limits(
    rate: float, amplitude: float, frequency: float, phase: float, growth: float
) -> None:
    pieces = to_sine(
        3.0,
        rate,
        amplitude_deg=amplitude,
        frequency_hz=frequency,
        phase_deg=phase,
        growth_deg_per_s=growth,
        rate_limit_dps=RATE_LIMIT,
        acceleration_dps2=ACCELERATION,
    )
    check_profile(pieces, 3.0, rate, RATE_LIMIT)
    omega = 2.0 * math.pi * frequency
    cut = AMPLITUDE_SHARE * min(RATE_LIMIT / omega, ACCELERATION / omega**2)
    assert pieces[-1].amplitude_deg == pytest.approx(min(amplitude, cut))


def oscillation(**changed: float) -> tuple[Piece, ...]:
    wanted = {"amplitude_deg": 20.0, "frequency_hz": 0.5, "phase_deg": 0.0, "growth_deg_per_s": 10.0} | changed
    return to_sine(5.0, 0.0, **wanted, rate_limit_dps=400.0, acceleration_dps2=2000.0)


def test_an_oscillation_grows_at_its_slew_over_whole_half_periods_about_the_present_angle() -> None:
    growing, steady = oscillation()
    assert growing.duration_s == pytest.approx(2.0)
    assert growing.growth_deg_per_s == pytest.approx(10.0)
    assert steady.at(0.5)[0] == pytest.approx(25.0)
    assert steady.at(1.5)[0] == pytest.approx(-15.0)


def test_an_oscillation_with_a_phase_waits_for_the_first_zero_of_its_sine() -> None:
    waiting, growing, _ = oscillation(phase_deg=90.0)
    # sin(πt + 90°) is next zero, falling, after half a second
    assert waiting.duration_s == pytest.approx(0.5)
    assert growing.at(0.5)[0] < 5.0


def test_an_oscillation_of_no_amplitude_is_rest() -> None:
    assert oscillation(amplitude_deg=0.0) == (Piece(angle_deg=5.0),)


@pytest.mark.parametrize("wrong", [{"frequency_hz": 0.0}, {"growth_deg_per_s": 0.0}, {"frequency_hz": -1.0}])
def test_an_oscillation_without_frequency_or_growth_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError, match="give both above 0"):
        oscillation(**wrong)


@pytest.mark.parametrize(
    "wrong", [{"damping": 1.0}, {"damping": 0.0}, {"natural_hz": 0.0}, {"ripple_order": 0}, {"rate_limit_dps": -1.0}]
)
def test_an_impossible_table_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError):
        TableParameters(**wrong)  # type: ignore[arg-type]
