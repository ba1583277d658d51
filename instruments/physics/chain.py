"""The signal chain from the table's motion to a sample: named stages to which effects can be added.

    motion -> sensed_rate -> coil_temperature -> scale -> bias -> electronics -> sampling

A stage is a function from `Signals` to `Signals`. The baseline provides one for each stage that changes signals;
effects of a stage follow it. All stages but the last run on a uniform grid that is dense relative to the electronics;
sampling runs on the digitizer's scans.

A stage stores what it needs from earlier samples (the state of a filter) in `Signals.memory` under its own name. A run
that is cut into chunks, each given the memory of the previous one, therefore equals the uncut run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.gyro import GyroParameters, bias_v, low_pass, sine_output_v

Stage = Literal["motion", "sensed_rate", "coil_temperature", "scale", "bias", "electronics", "sampling"]

GRID_STAGES: tuple[Stage, ...] = ("motion", "sensed_rate", "coil_temperature", "scale", "bias", "electronics")
STAGES: tuple[Stage, ...] = (*GRID_STAGES, "sampling")


@dataclass(frozen=True, slots=True, kw_only=True)
class Signals:
    """A segment of the chain's signals; every array has shape (n,), sample i at time_s[i] on the bench clock.

    `first_index` is, on the grid, the index of the first sample, so that consecutive segments join; at the sampling
    stage, it is the number of scans taken before.

    Motion is the true motion: angle [deg] unwrapped, rate [deg/s], acceleration [deg/s²]. `housing_c` and `coil_c` are
    true temperatures of the gyro. Stages compute: `sensed_rate_dps`, the rate sensed by the coil, in inertial space;
    `output_v`, the gyro's output after the stages applied so far; at the sampling stage `encoder_deg`, the encoder's
    angle before quantization, and `thermistor_c`, the thermistor's temperature. Before its stage each has its ideal
    value: the table's rate, 0 V, the true angle, the housing's temperature. `coil_rate_c_per_s` is the time derivative
    of `coil_c`; `auxiliary` holds other recorded signals, such as a supply voltage, by the name of their channel.
    """

    interval_s: float
    time_s: FloatArray
    angle_deg: FloatArray
    rate_dps: FloatArray
    acceleration_dps2: FloatArray
    housing_c: FloatArray
    coil_c: FloatArray
    sensed_rate_dps: FloatArray
    output_v: FloatArray
    encoder_deg: FloatArray
    thermistor_c: FloatArray
    coil_rate_c_per_s: FloatArray
    first_index: int = 0
    auxiliary: Mapping[str, FloatArray] = field(default_factory=dict)
    memory: Mapping[str, FloatArray] = field(default_factory=dict)


StageFunction = Callable[[Signals], Signals]
Baseline = Mapping[Stage, StageFunction]


class Effect(Protocol):
    """An effect missing from the baseline; it acts after the baseline's function of its stage."""

    @property
    def stage(self) -> Stage:
        """The stage at which the effect acts."""

    def apply(self, signals: Signals) -> Signals:
        """Return the signals with the effect."""


def run_chain(
    signals: Signals, baseline: Baseline, effects: Sequence[Effect] = (), stages: Sequence[Stage] = STAGES
) -> Signals:
    """Pass signals through the stages; effects of one stage act in the given order."""
    for stage in stages:
        if stage in baseline:
            signals = baseline[stage](signals)
        for effect in effects:
            if effect.stage == stage:
                signals = effect.apply(signals)
    return signals


def gyro_baseline(parameters: GyroParameters, earth_dps: float, interval_s: float) -> Baseline:
    """Return the gyro's stages on the grid; `earth_dps` is the Earth's rate about the input axis [deg/s].

    The bench supplies the true motion and coil temperature: the baseline has no function for these stages.
    """
    aligned = math.cos(1e-3 * parameters.misalignment_mrad)

    def sense(signals: Signals) -> Signals:
        return replace(signals, sensed_rate_dps=aligned * signals.rate_dps + earth_dps)

    def scale(signals: Signals) -> Signals:
        return replace(signals, output_v=sine_output_v(parameters, signals.sensed_rate_dps, signals.coil_c))

    def add_bias(signals: Signals) -> Signals:
        return replace(signals, output_v=signals.output_v + bias_v(parameters, signals.coil_c))

    without_low_pass: Baseline = {"sensed_rate": sense, "scale": scale, "bias": add_bias}
    if parameters.order == 0:
        return without_low_pass
    electronics = low_pass(parameters.cutoff_hz, parameters.order, interval_s)

    def smooth(signals: Signals) -> Signals:
        next_index, *kept = signals.memory.get("electronics", (-np.inf,))
        # without the previous sample, a long constant input is assumed
        state = (
            np.asarray(kept) if next_index == signals.first_index else electronics.at_rest(float(signals.output_v[0]))
        )
        smoothed, state = electronics(signals.output_v, state)
        carried = np.array([signals.first_index + smoothed.size, *state])
        return replace(signals, output_v=smoothed, memory={**signals.memory, "electronics": carried})

    return {**without_low_pass, "electronics": smooth}
