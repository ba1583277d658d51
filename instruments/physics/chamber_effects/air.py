"""The air of a chamber, run freely from its first temperature: no measured temperature but that one is used."""

from __future__ import annotations

import math

import numpy as np

from instruments.interfaces import FloatArray
from instruments.physics.chamber_effects.effect import ChamberSignals

_KELVIN = 273.15
_PER_KELVIN = 1.0 / (4.0 * 300.0**3)
_HOTTEST_C = 3000.0


def air_c(signals: ChamberSignals, start_c: float, gain: float, tau_s: float) -> FloatArray:
    """The air [°C] at the samples of a run, shape (n,): τ·dT/dt = gain·u + T_room − T and what effects change.

    From sample to sample everything that drives the air is held and the loss is linear in the temperature: exact
    without radiation and stores, and with them to first order in the interval over their time constants.
    """
    steps = signals.interval_s / max(tau_s, signals.interval_s)
    room = signals.room_c.tolist()
    heating = (gain * signals.drive).tolist()
    losses = signals.loss.tolist()
    radiation = signals.radiation * _PER_KELVIN
    couplings = [coupling for coupling, _ in signals.stores]
    shares = [-math.expm1(-signals.interval_s / store_tau_s) for _, store_tau_s in signals.stores]
    temperature, stored = start_c, [start_c] * len(couplings)
    air = []
    for heat, outside, loss in zip(heating, room, losses, strict=True):
        air.append(temperature)
        slope, pull = loss, heat + loss * outside
        if radiation:
            hot, cold = temperature + _KELVIN, outside + _KELVIN
            steep = 4.0 * radiation * hot**3
            slope += steep
            pull += steep * temperature - radiation * (hot**4 - cold**4)
        for place, coupling in enumerate(couplings):
            slope += coupling
            pull += coupling * stored[place]
        before = temperature
        share = -math.expm1(-slope * steps) / slope if slope else steps
        temperature += (pull - slope * temperature) * share
        temperature = min(max(temperature, -_KELVIN), _HOTTEST_C)
        for place, part in enumerate(shares):
            stored[place] += ((before + temperature) / 2 - stored[place]) * part
    return np.array(air)
