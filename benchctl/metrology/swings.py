"""Fit a swing of known frequency by its harmonics: its motion without differentiation, its output's fundamental."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchctl.recordings.model import Meta, Step
from benchctl.signals.rate import unwrap_deg
from benchctl.signals.segments import clipped, usable
from benchctl_instruments.arrays import FloatArray

_MOST_HARMONICS, _OF_NYQUIST = 40, 0.8
_MOST_CLIPPED = 0.01
"""Maximum share of clipped samples: in wider gaps, the same in every period, harmonics are not determined."""
_STRIP = 4096
"""Samples whose columns are in memory at the same time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Swing:
    """Samples of a swing, shape (n,) each, and its fundamentals as phasors.

    `rate_dps` is the rate of the fitted motion; `left_v` is the output's residual after the fit of the harmonics.
    """

    time_s: FloatArray
    rate_dps: FloatArray
    output_v: FloatArray
    left_v: FloatArray
    rate_phasor: complex
    output_phasor: complex


def fitted(step: Step, frequency_hz: float, meta: Meta) -> Swing | None:
    """Fit angle and output by a linear drift and up to 40 harmonics; the rate is jω times the angle.

    `frequency_hz` refers to the table's clock. It differs on the clock of the time stamps, so it is corrected from the
    angle. Samples that are clipped or filled in are left out. Return None if angle or output is missing, if too much of
    the output is clipped, or if there are too few samples for one harmonic.
    """
    if not {"encoder_deg", "gyro_v"} <= step.channels.keys():
        return None
    known = np.isfinite(step["encoder_deg"])
    good = usable(step, meta) & known
    room = (int(good.sum()) // 2 - 2) // 2
    if room < 1 or float(np.mean(clipped(step["gyro_v"], meta))) > _MOST_CLIPPED:
        return None
    time_s, output_v = step["time_s"][good] - step["time_s"][0], step["gyro_v"][good]
    angle_deg = unwrap_deg(step["encoder_deg"][known])[good[known]]
    highest_hz = 0.5 * _OF_NYQUIST * (time_s.size - 1) / float(time_s[-1] - time_s[0])
    if frequency_hz > highest_hz:
        return None
    frequency_hz = _by_the_stamps(time_s, angle_deg, frequency_hz)
    harmonics = max(1, min(int(highest_hz / frequency_hz), _MOST_HARMONICS, room))
    omega = 2.0 * np.pi * frequency_hz
    solution = _solved(time_s, omega, harmonics, np.stack([angle_deg, output_v], axis=1))
    phasors = solution[:harmonics] - 1j * solution[harmonics:-2]
    rates = 1j * omega * np.arange(1.0, harmonics + 1.0) * phasors[:, 0]
    moving = np.concatenate([rates.real, -rates.imag, [solution[-1, 0], 0.0]])
    rate_dps, left_v = np.empty_like(time_s), output_v.copy()
    for strip in _strips(time_s.size):
        columns = _columns(time_s[strip], omega, harmonics)
        rate_dps[strip] = columns @ moving
        left_v[strip] -= columns @ solution[:, 1]
    return Swing(
        time_s=step["time_s"][good],
        rate_dps=rate_dps,
        output_v=output_v,
        left_v=left_v,
        rate_phasor=complex(rates[0]),
        output_phasor=complex(phasors[0, 1]),
    )


def _solved(time_s: FloatArray, omega: float, harmonics: int, values: FloatArray) -> FloatArray:
    """Return the least-squares solution for values (n, k) on the columns; shape (2·harmonics + 2, k).

    The columns are well scaled, so the normal equations are accurate; they are accumulated from one strip at a time.
    """
    size = 2 * harmonics + 2
    gram, moment = np.zeros((size, size)), np.zeros((size, values.shape[1]))
    for strip in _strips(time_s.size):
        columns = _columns(time_s[strip], omega, harmonics)
        gram += columns.T @ columns
        moment += columns.T @ values[strip]
    return np.asarray(np.linalg.solve(gram, moment))


def _columns(time_s: FloatArray, omega: float, harmonics: int) -> FloatArray:
    """Return cosines, sines, 1 and t, shape (n, 2·harmonics + 2); harmonics are powers of the fundamental."""
    once = np.exp(1j * omega * time_s)
    powers = np.cumprod(np.broadcast_to(once[:, None], (time_s.size, harmonics)), axis=1)
    return np.concatenate([powers.real, powers.imag, np.stack([np.ones_like(time_s), time_s], axis=1)], axis=1)


def _strips(samples: int) -> Iterator[slice]:
    return (slice(start, start + _STRIP) for start in range(0, samples, _STRIP))


def _by_the_stamps(time_s: FloatArray, angle_deg: FloatArray, frequency_hz: float) -> float:
    """Correct the frequency by the phase shift of the angle from the first half of the swing to the second."""
    half = time_s.size // 2
    if time_s[half] * frequency_hz < 1.0:
        return frequency_hz
    phases: list[float] = []
    middles: list[float] = []
    for part in (slice(0, half), slice(half, None)):
        solution = _solved(time_s[part], 2.0 * np.pi * frequency_hz, 1, angle_deg[part, None])[:, 0]
        phases.append(float(np.angle(solution[0] - 1j * solution[1])))
        middles.append(float(time_s[part].mean()))
    moved = float(np.angle(np.exp(1j * (phases[1] - phases[0]))))
    return frequency_hz + moved / (2.0 * np.pi * (middles[1] - middles[0]))
