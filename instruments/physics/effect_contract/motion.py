"""Test signals for effects: a smooth, periodic, band-limited motion while the coil warms, cools and warms again."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import lru_cache

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.effects.effect import PhysicalEffect

COARSE_HZ = 125.0
FINE = 16
PERIOD_S = 16.0
N = round(PERIOD_S * COARSE_HZ)

CIRCUMSTANCES = {"T0_c": 20.0, "range_dps": 180.0, "seed": 3.0, "start_s": 0.0}

_SINES = ((1.0 / 16.0, 150.0, 0.3), (1.5, 20.0, 1.1), (6.25, 5.0, 2.0))
"""Frequency [Hz], amplitude [deg/s] and phase [rad] of the parts of the motion: complete turns, up to 172 deg/s."""


def at(time_s: FloatArray, interval_s: float, first_index: int = 0) -> Signals:
    """Return the motion at instants, in read-only arrays."""
    angle, rate, acceleration = (np.zeros_like(time_s) for _ in range(3))
    for frequency, amplitude, phase in _SINES:
        omega = 2.0 * np.pi * frequency
        angle -= amplitude / omega * np.cos(omega * time_s + phase)
        rate += amplitude * np.sin(omega * time_s + phase)
        acceleration += amplitude * omega * np.cos(omega * time_s + phase)
    slow = 2.0 * np.pi / PERIOD_S
    coil = 30.0 + 25.0 * np.sin(slow * time_s - 0.5)
    signals = Signals(
        interval_s=interval_s,
        time_s=time_s,
        angle_deg=angle,
        rate_dps=rate,
        acceleration_dps2=acceleration,
        housing_c=coil,
        coil_c=coil,
        sensed_rate_dps=rate,
        output_v=0.05 * rate,
        encoder_deg=angle,
        thermistor_c=coil,
        coil_rate_c_per_s=25.0 * slow * np.cos(slow * time_s - 0.5),
        first_index=first_index,
        auxiliary={"supply_v": 5.0 + 0.2 * np.sin(slow * time_s)},
    )
    for array in (*arrays(signals).values(), *signals.auxiliary.values()):
        array.setflags(write=False)
    return signals


@lru_cache(maxsize=8)
def sampled(finer: int = 1, periods: int = 1) -> Signals:
    """Return `periods` periods at `finer` times the coarse rate; every `finer`-th sample is a coarse sample."""
    interval_s = 1.0 / (COARSE_HZ * finer)
    return at(np.arange(periods * N * finer, dtype=np.float64) * interval_s, interval_s)


def stretch(signals: Signals, low: int, high: int, memory: Mapping[str, FloatArray]) -> Signals:
    """Return a segment of signals with the memory of the preceding one."""
    part = {name: array[low:high] for name, array in arrays(signals).items()}
    auxiliary = {name: array[low:high] for name, array in signals.auxiliary.items()}
    return replace(signals, **part, auxiliary=auxiliary, memory=memory, first_index=signals.first_index + low)  # type: ignore[arg-type]  # every field of `part` is an array


def in_chunks(effect: PhysicalEffect, signals: Signals, cuts: Sequence[int]) -> dict[str, FloatArray]:
    """Return the effect's output for signals cut into segments."""
    memory: dict[str, FloatArray] = {}
    parts = []
    for low, high in itertools.pairwise((0, *cuts, signals.time_s.size)):
        done = effect.apply(stretch(signals, low, high, memory))
        memory = {name: np.array(array) for name, array in done.memory.items()}
        for array in memory.values():
            array.setflags(write=False)
        parts.append(arrays(done))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def arrays(signals: Signals) -> dict[str, FloatArray]:
    """Return the arrays of signals by name."""
    values = {field.name: getattr(signals, field.name) for field in fields(signals)}
    return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
