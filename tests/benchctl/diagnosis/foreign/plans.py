"""What the other lab runs: at each set point of the chamber a rest, rates, sines, then a ramp to the next."""

from __future__ import annotations

from typing import Any

SET_POINTS = (
    (25.0, 50.0, 10.0, -30.0, 25.0),
    (23.0, -20.0, 0.0, 40.0, 60.0, 23.0),
    (20.0, 45.0, 65.0, 5.0, -15.0, -40.0, 20.0),
)
"""The chamber's set points (°C) of the three plans."""

_RATES = (0.03, 0.12, 0.33, 0.6, 0.85, 1.0)
_SINES = ((0.97, 0.15, 20.0), (0.6, 0.5, 12.0), (0.35, 1.5, 8.0), (0.12, 4.0, 6.0), (0.04, 9.0, 6.0))
_RAMP = (0.3, 0.2)

Steps = list[dict[str, Any]]


def plan(range_dps: float, set_points: tuple[float, ...]) -> Steps:
    """The steps as `recording.json` lists them. Amplitudes are fractions of the range; times in s from the start."""
    steps: Steps = []

    def add(name: str, kind: str, lasts_s: float, set_point: float, **motion: float) -> None:
        start = steps[-1]["t_end"] if steps else 0.0
        steps.append(
            {
                "name": name,
                "kind": kind,
                "t_start": start,
                "t_end": start + lasts_s,
                "chamber_setpoint_c": set_point,
                **motion,
            }
        )

    for station, here in enumerate(set_points):
        first = 1.0 if station % 2 == 0 else -1.0
        add(f"static {here:+.0f}", "static", 40.0, here)
        for rate in (sign * fraction * range_dps for fraction in _RATES for sign in (first, -first)):
            add(f"rate {rate:+.1f} at {here:+.0f}", "constant_rate", 4.0, here, rate_dps=rate)
        add(f"rest {here:+.0f}", "static", 5.0, here)
        for fraction, frequency, lasts in _SINES:
            amplitude = fraction * range_dps
            name = f"sine {amplitude:.1f} dps {frequency} Hz at {here:+.0f}"
            add(name, "sine", lasts, here, amplitude_dps=amplitude, frequency_hz=frequency)
        for there in set_points[station + 1 : station + 2]:
            fraction, frequency = _RAMP
            lasts = 150.0 + 10.0 * abs(there - here)
            motion = {"amplitude_dps": fraction * range_dps, "frequency_hz": frequency}
            add(f"ramp to {there:+.0f}", "thermal_ramp", lasts, there, **motion)
    return steps
