from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
import scipy.integrate

from benchctl_instruments.physics.servo import Motion, coast, follow, with_ripple
from benchctl_instruments.physics.table import Piece, TableParameters

TABLE = TableParameters()
NATURAL = 2.0 * math.pi * TABLE.natural_hz
TIMES = np.linspace(0.0, 0.4, 801)

PIECES = [
    Piece(angle_deg=3.0, rate_dps=20.0, acceleration_dps2=1000.0),
    Piece(angle_deg=-1.0, amplitude_deg=4.0, frequency_hz=3.0, phase_rad=0.4),
    Piece(angle_deg=0.0, growth_deg_per_s=30.0, frequency_hz=5.0, phase_rad=math.pi),
    Piece(angle_deg=2.0, rate_dps=-10.0, amplitude_deg=1.0, growth_deg_per_s=-3.0, frequency_hz=8.0),
]


def test_the_error_under_a_step_of_acceleration_is_the_textbook_step_response() -> None:
    acceleration, damping = 1500.0, TABLE.damping
    motion = follow(TABLE, Piece(angle_deg=0.0, acceleration_dps2=acceleration), 0.0, 0.0, 0.0).at(TIMES)
    damped = NATURAL * math.sqrt(1.0 - damping**2)
    ringing = np.cos(damped * TIMES) + damping / math.sqrt(1.0 - damping**2) * np.sin(damped * TIMES)
    error = acceleration / NATURAL**2 * (1.0 - np.exp(-damping * NATURAL * TIMES) * ringing)
    np.testing.assert_allclose(0.5 * acceleration * TIMES**2 - motion.angle_deg, error, atol=1e-12)


@pytest.mark.parametrize("piece", PIECES)
def test_the_motion_solves_the_servo_equation(piece: Piece) -> None:
    start_angle, start_rate = piece.angle_deg + 0.3, piece.rate_dps - 5.0

    def derivative(tau: float, state: npt.NDArray[np.float64]) -> list[float]:
        angle, rate, _ = piece.at(tau)
        drag, stiffness = 2.0 * TABLE.damping * NATURAL, NATURAL**2
        return [state[1], drag * (rate - state[1]) + stiffness * (angle - state[0])]

    solved = scipy.integrate.solve_ivp(
        derivative, (0.0, 0.4), [start_angle, start_rate], t_eval=TIMES, method="DOP853", rtol=1e-12, atol=1e-12
    )
    motion = follow(TABLE, piece, 100.0, start_angle, start_rate).at(TIMES + 100.0)
    np.testing.assert_allclose(motion.angle_deg, solved.y[0], atol=1e-9)
    np.testing.assert_allclose(motion.rate_dps, solved.y[1], atol=1e-7)


@pytest.mark.parametrize("piece", PIECES)
def test_rate_and_acceleration_are_the_derivatives_of_the_true_angle(piece: Piece) -> None:
    rippled = TableParameters(ripple=1e-2)
    step = 1e-5
    times = np.arange(0.01, 0.02, step)
    motion = with_ripple(rippled, follow(rippled, piece, 0.0, piece.angle_deg, piece.rate_dps).at(times))
    np.testing.assert_allclose(np.gradient(motion.angle_deg, step)[1:-1], motion.rate_dps[1:-1], rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(
        np.gradient(motion.rate_dps, step)[1:-1], motion.acceleration_dps2[1:-1], rtol=1e-5, atol=2e-2
    )


def test_a_steady_oscillation_has_the_gain_of_the_closed_loop() -> None:
    frequency = 4.0
    s = 2j * math.pi * frequency
    loop = 2.0 * TABLE.damping * NATURAL * s + NATURAL**2
    gain = abs(loop / (s**2 + loop))
    times = np.linspace(5.0, 6.0, 20_001)
    piece = Piece(angle_deg=0.0, amplitude_deg=2.0, frequency_hz=frequency)
    motion = follow(TABLE, piece, 0.0, 0.0, 0.0).at(times)
    assert np.abs(motion.angle_deg).max() == pytest.approx(2.0 * gain, rel=1e-7)


def test_at_a_constant_rate_the_ripple_has_its_size_and_its_order() -> None:
    table = TableParameters(ripple=1e-3, ripple_order=36)
    turn = Motion(np.linspace(0.0, 360.0, 36_000, endpoint=False), np.full(36_000, 100.0), np.zeros(36_000))
    lines = np.abs(np.fft.rfft(with_ripple(table, turn).rate_dps)) / 18_000
    assert lines[36] == pytest.approx(100.0 * 1e-3)
    assert np.delete(lines[1:], 35).max() < 1e-9


def test_without_servo_the_table_moves_exactly_as_the_piece() -> None:
    piece = Piece(angle_deg=7.0, rate_dps=30.0, acceleration_dps2=-300.0)
    motion = coast(piece, 2.0).at(np.array([2.0, 2.1]))
    np.testing.assert_allclose(motion.angle_deg, [7.0, 7.0 + 3.0 - 1.5])
    np.testing.assert_allclose(motion.rate_dps, [30.0, 0.0], atol=1e-12)
