"""Simulation of a chamber's air from its first temperature; no later measured air temperature is used."""

from __future__ import annotations

import itertools
import math

import numpy as np
import scipy  # scipy.signal is loaded on first use

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chamber_effects.effect import ChamberSignals

_KELVIN = 273.15
_PER_KELVIN = 1.0 / (4.0 * 300.0**3)
_HOTTEST_C = 3000.0
_NEVER_PER_S = 1e-12
"""Slower rates count as no relaxation at all."""


def air_c(signals: ChamberSignals, start_c: float, gain: float, tau_s: float) -> FloatArray:
    """Return the air [°C] at the samples of a run, shape (n,): τ·dT/dt = gain·u + T_room − T, changed by effects.

    All inputs are held from sample to sample and the loss is linear in the temperature: exact without radiation, stores
    and inputs that depend on the air, and otherwise to first order in the interval.
    """
    if not signals.radiation and signals.push_of_air is None:
        return _linear(signals, start_c, gain, tau_s)
    steps = signals.interval_s / max(tau_s, signals.interval_s)
    room = signals.room_c.tolist()
    heating = (gain * signals.drive + (0.0 if signals.push_c is None else signals.push_c)).tolist()
    at_c, of_air = ((), ()) if signals.push_of_air is None else signals.push_of_air.tolist()
    lowest_c, apart_c, last = (at_c[0], at_c[1] - at_c[0], len(at_c) - 2) if at_c else (0.0, 1.0, 0)
    losses = signals.loss.tolist()
    exchange, stores = signals.exchange * tau_s, _stores(signals, tau_s)
    second = (signals.room_c if signals.second_c is None else signals.second_c).tolist()
    radiation = signals.radiation * _PER_KELVIN
    couplings = [coupling for coupling, _ in stores]
    shares = [-math.expm1(-signals.interval_s / store_tau_s) for _, store_tau_s in stores]
    temperature, stored = start_c, [start_c] * len(couplings)
    known, share, top = math.nan, steps, last + 1.0
    air = []
    for heat, outside, loss, second_body in zip(heating, room, losses, second, strict=True):
        air.append(temperature)
        slope, pull = loss + exchange, heat + loss * outside + exchange * second_body
        if radiation:
            hot, cold = temperature + _KELVIN, outside + _KELVIN
            steep = 4.0 * radiation * hot**3
            slope += steep
            pull += steep * temperature - radiation * (hot**4 - cold**4)
        if of_air:
            place = (temperature - lowest_c) / apart_c
            place = 0.0 if place < 0.0 else top if place > top else place  # min and max take twice as long
            below = int(place) if place < top else last
            pull += of_air[below] + (place - below) * (of_air[below + 1] - of_air[below])
        for store, coupling in enumerate(couplings):
            slope += coupling
            pull += coupling * stored[store]
        before = temperature
        if slope != known:
            known, share = slope, -math.expm1(-slope * steps) / slope if slope else steps
        temperature += (pull - slope * temperature) * share
        if not -_KELVIN <= temperature <= _HOTTEST_C:
            temperature = min(max(temperature, -_KELVIN), _HOTTEST_C)
        for store, part in enumerate(shares):
            stored[store] += ((before + temperature) / 2 - stored[store]) * part
    return np.array(air)


def forgetting(signals: ChamberSignals, tau_s: float) -> list[tuple[float, float]]:
    """Return the relaxation rates [1/s] of the air, without radiation, each with its power.

    White-noise disturbances cause noise of the air with a density of Σ power/(ω² + rate²).
    """
    capacity, store_tau_s = np.array(signals.stores).reshape(-1, 2).T
    back = np.diag(np.concatenate([[0.0], 1.0 / store_tau_s]))
    back[0, 0] = float(signals.loss.min()) / tau_s + float(np.sum(capacity / store_tau_s)) + signals.exchange
    back[0, 1:] = back[1:, 0] = -np.sqrt(capacity) / store_tau_s  # temperatures scaled by √capacity
    rates, modes = np.linalg.eigh(back)
    rates = np.maximum(rates, _NEVER_PER_S)
    shares = modes[0] ** 2  # shares of a disturbance that decay with each rate
    powers = shares * (2.0 * rates[:, None] / (rates[:, None] + rates) @ shares)
    return list(zip(rates.tolist(), powers.tolist(), strict=True))


def _stores(signals: ChamberSignals, tau_s: float) -> list[tuple[float, float]]:
    """Return for each store its heat exchange relative to the loss of the baseline, and its time constant."""
    return [(capacity * tau_s / store_tau_s, store_tau_s) for capacity, store_tau_s in signals.stores]


def _linear(signals: ChamberSignals, start_c: float, gain: float, tau_s: float) -> FloatArray:
    """Return the air without radiation: a linear recursion between changes of the loss, solved as a filter per mode."""
    steps = signals.interval_s / max(tau_s, signals.interval_s)
    exchange, stores = signals.exchange * tau_s, _stores(signals, tau_s)
    couplings = np.array([coupling for coupling, _ in stores])
    shares = np.array([-math.expm1(-signals.interval_s / store_tau_s) for _, store_tau_s in stores])
    heat = gain * signals.drive
    if signals.push_c is not None:
        heat = heat + signals.push_c
    if signals.second_c is not None:
        heat = heat + exchange * signals.second_c
    changes = [0, *(np.flatnonzero(np.diff(signals.loss)) + 1).tolist(), heat.size]
    slopes = signals.loss[changes[:-1]] + exchange + float(couplings.sum())
    share = np.array([-math.expm1(-slope * steps) / slope if slope else steps for slope in slopes.tolist()])
    # the air a sample later by air and stores now; a store then follows the mean of the air over that time
    onward = np.empty((slopes.size, 1 + couplings.size, 1 + couplings.size))
    onward[:, 0, 0], onward[:, 0, 1:] = 1.0 - slopes * share, share[:, None] * couplings
    onward[:, 1:] = shares[:, None] * onward[:, :1] / 2.0
    onward[:, 1:, 0] += shares / 2.0
    onward[:, 1:, 1:] += np.diag(1.0 - shares)
    into = np.concatenate([[1.0], shares / 2.0])
    driven = np.repeat(share, np.diff(changes)) * (heat + signals.loss * signals.room_c)
    state, air = np.full(into.size, start_c), np.empty_like(heat)
    for matrix, (first, last) in zip(onward, itertools.pairwise(changes), strict=True):
        states = _course(matrix, into, driven[first:last], state)
        air[first:last] = states[0, :-1]
        state = states[:, -1]
    return np.clip(air, -_KELVIN, _HOTTEST_C)


def _course(onward: FloatArray, into: FloatArray, driven: FloatArray, state: FloatArray) -> FloatArray:
    """Return the states, shape (m, n + 1), from `state` (m,) on: next = onward·state + into·driven, `driven` (n,)."""
    if state.size == 1 == driven.size:  # at the edges of an opening the loss changes with each sample
        return np.array([[state[0], onward[0, 0] * state[0] + driven[0]]])
    if state.size == 1:
        course = scipy.signal.lfilter([1.0], [1.0, -float(onward[0, 0])], np.concatenate([state, driven]))
        return np.asarray(course)[None]
    values, modes = np.linalg.eig(onward)
    ways, beginning = np.linalg.solve(modes, np.column_stack([into, state])).T
    courses = [
        scipy.signal.lfilter([1.0], [1.0, -value], np.concatenate([[begun], one * driven]))
        for value, one, begun in zip(values, ways, beginning, strict=True)
    ]
    return np.real(modes @ np.array(courses))
