"""The table's motion for a demanded piece: a second-order servo, solved in closed form, with a ripple on the motion.

The tracking error e = θ_demanded − θ obeys  e'' + 2ζωₙ·e' + ωₙ²·e = demanded acceleration. Over one `Piece` the right
hand side is a constant plus a sinusoid with a linear envelope, so e is of the same form plus a decaying oscillation:
the motion is known exactly at any instant, for pieces of any length.

The ripple belongs to the true motion:  θ_true = θ − (r/m)(180/π)·cos mθ,  hence ω_true = ω·(1 + r·sin mθ).
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.table import Piece, TableParameters

_GONE = 45.0
"""Number of time constants after which a decaying oscillation is below the rounding error of a double."""


@dataclass(frozen=True, slots=True)
class Motion:
    """True angle [deg, unwrapped], rate [deg/s] and acceleration [deg/s²], each of shape (n,)."""

    angle_deg: FloatArray
    rate_dps: FloatArray
    acceleration_dps2: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """The table's motion from `start_s` on, before ripple.

    parabola `angle`, `rate`, `acceleration`, plus Im[(steady + growing·τ)·e^(jΩτ)], minus the decaying
    Re[decaying·e^(λτ)].
    """

    start_s: float
    piece: Piece
    angle_deg: float
    steady: complex
    growing: complex
    decaying: complex
    decay_rate: complex

    def at(self, times_s: FloatArray) -> Motion:
        """Return the motion at instants of shape (n,), in increasing order, none before the start."""
        tau = times_s - self.start_s
        piece = self.piece
        angle = tau * (0.5 * piece.acceleration_dps2)
        angle += piece.rate_dps
        angle *= tau
        angle += self.angle_deg
        rate = tau * piece.acceleration_dps2
        rate += piece.rate_dps
        acceleration = np.full_like(tau, piece.acceleration_dps2)
        if self.steady or self.growing:
            self._add_oscillation(tau, angle, rate, acceleration)
        if self.decaying:
            self._subtract_decay(tau, angle, rate, acceleration)
        return Motion(angle, rate, acceleration)

    def _add_oscillation(self, tau: FloatArray, angle: FloatArray, rate: FloatArray, acceleration: FloatArray) -> None:
        omega = 2.0 * math.pi * self.piece.frequency_hz
        phase = tau * omega
        sine, cosine = np.sin(phase), np.cos(phase)

        def add(target: FloatArray, steady: complex, growing: complex) -> None:
            if growing:
                target += (steady.real + growing.real * tau) * sine + (steady.imag + growing.imag * tau) * cosine
            else:
                target += steady.real * sine
                target += steady.imag * cosine

        turn = 1j * omega
        add(angle, self.steady, self.growing)
        add(rate, turn * self.steady + self.growing, turn * self.growing)
        add(acceleration, turn**2 * self.steady + 2.0 * turn * self.growing, turn**2 * self.growing)

    def _subtract_decay(self, tau: FloatArray, angle: FloatArray, rate: FloatArray, acceleration: FloatArray) -> None:
        alive = int(np.searchsorted(tau, -_GONE / self.decay_rate.real))
        mode = self.decaying * np.exp(self.decay_rate * tau[:alive])
        angle[:alive] -= mode.real
        mode *= self.decay_rate
        rate[:alive] -= mode.real
        mode *= self.decay_rate
        acceleration[:alive] -= mode.real


def follow(parameters: TableParameters, piece: Piece, start_s: float, angle_deg: float, rate_dps: float) -> Segment:
    """Return the motion under servo, from the table's angle and rate (before ripple) at the start of the piece."""
    natural = 2.0 * math.pi * parameters.natural_hz
    drag = 2.0 * parameters.damping * natural
    lag_deg = piece.acceleration_dps2 / natural**2

    turn = 2j * math.pi * piece.frequency_hz
    swing = cmath.exp(1j * piece.phase_rad)
    demanded, demanded_growing = piece.amplitude_deg * swing, piece.growth_deg_per_s * swing
    stiffness = turn**2 + drag * turn + natural**2
    error_growing = turn**2 * demanded_growing / stiffness
    error = turn**2 * demanded + 2.0 * turn * demanded_growing - (2.0 * turn + drag) * error_growing
    steady, growing = demanded - error / stiffness, demanded_growing - error_growing

    # start values of the forced motion alone; the difference decays
    forced_angle_deg = piece.angle_deg - lag_deg + steady.imag
    forced_rate_dps = piece.rate_dps + (turn * steady + growing).imag
    excess_deg, excess_dps = forced_angle_deg - angle_deg, forced_rate_dps - rate_dps
    decay_rate = natural * complex(-parameters.damping, math.sqrt(1.0 - parameters.damping**2))
    decaying = complex(excess_deg, (decay_rate.real * excess_deg - excess_dps) / decay_rate.imag)
    return Segment(
        start_s=start_s,
        piece=piece,
        angle_deg=piece.angle_deg - lag_deg,
        steady=steady,
        growing=growing,
        decaying=decaying,
        decay_rate=decay_rate,
    )


def coast(piece: Piece, start_s: float) -> Segment:
    """Return the motion without servo: exactly the piece."""
    return Segment(
        start_s=start_s, piece=piece, angle_deg=piece.angle_deg, steady=0j, growing=0j, decaying=0j, decay_rate=-1 + 0j
    )


def with_ripple(parameters: TableParameters, motion: Motion) -> Motion:
    """Return the true motion, computed from the motion before ripple."""
    if parameters.ripple == 0.0:
        return motion
    r, m = parameters.ripple, parameters.ripple_order
    phase = motion.angle_deg * (m * math.pi / 180.0)
    sine, cosine = np.sin(phase), np.cos(phase)
    gain = 1.0 + r * sine
    acceleration = motion.acceleration_dps2 * gain
    acceleration += motion.rate_dps**2 * cosine * (r * m * math.pi / 180.0)
    return Motion(motion.angle_deg - (r / m * 180.0 / math.pi) * cosine, motion.rate_dps * gain, acceleration)
