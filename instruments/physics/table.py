"""Demanded angle profiles of a rate table, in closed form, within limits on rate and acceleration.

A profile is a sequence of pieces. Each piece begins at the demanded angle and rate at which the previous one ended, so
that both are continuous; only the acceleration jumps. `benchctl_instruments.physics.servo` models how the table
follows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from benchctl_instruments.errors import UsageError

AMPLITUDE_SHARE = 0.995
"""The fraction of a limit that a steady oscillation may use; the rest is for the growth of its amplitude."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableParameters:
    """A servo table; every default is assumed.

    `natural_hz` and `damping` are those of the servo. `ripple` is the relative ripple of the true rate, with
    `ripple_order` periods per revolution. `friction_dps2` is the deceleration of the table while the servo is off.
    """

    natural_hz: float = 15.0
    damping: float = 0.7
    rate_limit_dps: float = 400.0
    acceleration_limit_dps2: float = 2000.0
    ripple: float = 1e-4
    ripple_order: int = 36
    friction_dps2: float = 300.0
    start_angle_deg: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.damping < 1.0 or self.natural_hz <= 0.0:
            raise UsageError(
                f"a servo of {self.natural_hz} Hz and damping {self.damping}; give above 0 Hz, damping between 0 and 1"
            )
        if self.ripple_order < 1:
            raise UsageError(f"a ripple_order of {self.ripple_order}; give an integer of times a revolution, 1 or more")
        if min(self.rate_limit_dps, self.acceleration_limit_dps2, self.friction_dps2) <= 0.0:
            raise UsageError("rate_limit_dps, acceleration_limit_dps2 and friction_dps2 must lie above 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """A demanded angle [deg]: a parabola and an oscillation over the time τ [s] since the start of the piece.

        angle + rate·τ + ½·acceleration·τ² + (amplitude + growth·τ)·sin(2π·frequency·τ + phase)

    It lasts `duration_s`, which may be infinite.
    """

    duration_s: float = math.inf
    angle_deg: float
    rate_dps: float = 0.0
    acceleration_dps2: float = 0.0
    amplitude_deg: float = 0.0
    growth_deg_per_s: float = 0.0
    frequency_hz: float = 0.0
    phase_rad: float = 0.0

    def at(self, tau_s: float) -> tuple[float, float, float]:
        """Return demanded angle [deg], rate [deg/s] and acceleration [deg/s²]."""
        angle = self.angle_deg + tau_s * (self.rate_dps + 0.5 * self.acceleration_dps2 * tau_s)
        rate = self.rate_dps + self.acceleration_dps2 * tau_s
        omega = 2.0 * math.pi * self.frequency_hz
        sine, cosine = math.sin(omega * tau_s + self.phase_rad), math.cos(omega * tau_s + self.phase_rad)
        amplitude = self.amplitude_deg + self.growth_deg_per_s * tau_s
        return (
            angle + amplitude * sine,
            rate + amplitude * omega * cosine + self.growth_deg_per_s * sine,
            self.acceleration_dps2 - amplitude * omega**2 * sine + 2.0 * self.growth_deg_per_s * omega * cosine,
        )


def to_rate(angle_deg: float, rate_dps: float, target_dps: float, acceleration_dps2: float) -> tuple[Piece, ...]:
    """Return pieces from an angle and a rate to a constant rate; a target of zero is a controlled stop."""
    ramp_s = abs(target_dps - rate_dps) / acceleration_dps2
    acceleration = math.copysign(acceleration_dps2, target_dps - rate_dps)
    return _joined(angle_deg, rate_dps, [(ramp_s, acceleration)], final_rate_dps=target_dps)


def to_angle(
    angle_deg: float, rate_dps: float, target_deg: float, rate_limit_dps: float, acceleration_dps2: float
) -> tuple[Piece, ...]:
    """Return pieces from an angle and a rate to rest at another angle, in the shortest time within the limits."""
    a = acceleration_dps2
    stopping_deg = rate_dps * abs(rate_dps) / (2.0 * a)
    # direction of the remaining way after the strongest possible braking
    sign = math.copysign(1.0, target_deg - angle_deg - stopping_deg)
    distance = sign * (target_deg - angle_deg)
    start = sign * rate_dps
    peak = math.sqrt(max(a * distance + 0.5 * start**2, 0.0))
    cruise_s = 0.0
    if peak > rate_limit_dps:
        peak = rate_limit_dps
        speeding_up_deg = (peak**2 - start**2) / (2.0 * math.copysign(a, peak - start))
        cruise_s = (distance - speeding_up_deg - peak**2 / (2.0 * a)) / peak
    first = math.copysign(a, peak - start)
    legs = [(abs(peak - start) / a, sign * first), (cruise_s, 0.0), (peak / a, -sign * a)]
    moving = _joined(angle_deg, rate_dps, legs, final_rate_dps=0.0)[:-1]
    return (*moving, Piece(angle_deg=target_deg))


def to_sine(
    angle_deg: float,
    rate_dps: float,
    *,
    amplitude_deg: float,
    frequency_hz: float,
    phase_deg: float,
    growth_deg_per_s: float,
    rate_limit_dps: float,
    acceleration_dps2: float,
) -> tuple[Piece, ...]:
    """Return pieces from an angle and a rate to an oscillation amplitude·sin(2π·frequency·t + phase) about a centre.

    A turning table is stopped first; it oscillates about the angle at which it stops. The amplitude grows linearly from
    a zero of the sine to a zero of the sine, which keeps the rate continuous: with a phase other than 0 or 180° the
    table waits for the first zero, and the growth is slowed down to end at one. An amplitude above the limits is
    reduced to `AMPLITUDE_SHARE` of them; a growth that would exceed them together with the amplitude is slowed down.
    """
    if frequency_hz <= 0.0 or growth_deg_per_s <= 0.0:
        raise UsageError(
            f"an oscillation of {frequency_hz} Hz that grows by {growth_deg_per_s} deg/s; give both above 0"
        )
    stopping = to_rate(angle_deg, rate_dps, 0.0, acceleration_dps2)
    centre_deg = stopping[-1].angle_deg
    omega = 2.0 * math.pi * frequency_hz
    phase = math.radians(phase_deg) + (math.pi if amplitude_deg < 0.0 else 0.0)
    peak = min(abs(amplitude_deg), AMPLITUDE_SHARE * min(rate_limit_dps / omega, acceleration_dps2 / omega**2))
    if peak == 0.0:
        return stopping
    fastest = min(
        growth_deg_per_s,
        math.sqrt(rate_limit_dps**2 - (peak * omega) ** 2),
        math.sqrt(acceleration_dps2**2 - (peak * omega**2) ** 2) / (2.0 * omega),
    )
    half_periods = math.ceil(2.0 * frequency_hz * peak / fastest)
    growing_s = 0.5 * half_periods / frequency_hz
    zeros = math.ceil(phase / math.pi - 1e-12)
    waiting_s = max(zeros * math.pi - phase, 0.0) / omega
    start_phase = math.pi * (zeros % 2)
    oscillation = Piece(angle_deg=centre_deg, frequency_hz=frequency_hz, phase_rad=start_phase)
    pieces = [
        *stopping[:-1],
        Piece(duration_s=waiting_s, angle_deg=centre_deg),
        replace(oscillation, duration_s=growing_s, growth_deg_per_s=peak / growing_s),
        replace(oscillation, amplitude_deg=peak, phase_rad=start_phase + math.pi * (half_periods % 2)),
    ]
    return tuple(piece for piece in pieces if piece.duration_s > 0.0)


def _joined(
    angle_deg: float, rate_dps: float, legs: list[tuple[float, float]], *, final_rate_dps: float
) -> tuple[Piece, ...]:
    """Return legs of (duration [s], acceleration [deg/s²]) in sequence, followed by the final rate without end."""
    pieces = []
    for duration_s, acceleration in legs:
        if duration_s <= 0.0:
            continue
        piece = Piece(duration_s=duration_s, angle_deg=angle_deg, rate_dps=rate_dps, acceleration_dps2=acceleration)
        pieces.append(piece)
        angle_deg, rate_dps, _ = piece.at(duration_s)
    return (*pieces, Piece(angle_deg=angle_deg, rate_dps=final_rate_dps))
