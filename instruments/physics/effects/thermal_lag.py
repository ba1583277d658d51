"""Effect: thermal lag of the coil behind its thermistor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import scipy  # scipy.signal is loaded on first use

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalLag(PhysicalEffect):
    """T_coil follows T through a first-order lag, in every thermal term (domain facts, LAG)."""

    tau_s: float

    identifier: ClassVar[str] = "thermal_lag"
    stage: ClassVar[Stage] = "coil_temperature"
    words: ClassVar[str] = (
        "The fibre coil is not at the temperature of its thermistor: it follows with a time constant. While the chamber"
        " heats, scale factor and bias are still those of a colder coil."
    )
    equation: ClassVar[str] = "τ·dT_coil/dt = T − T_coil; T_coil in place of T in k(T) and U0(T)"
    coordinate: ClassVar[str] = "gyro_temp_rate"
    excited_by: ClassVar[str] = "rotation while the temperature changes"
    look_alikes: ClassVar[tuple[str, ...]] = ("thermal_hysteresis", "scale_warm_up", "bias_temperature_rate")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "tau_s": Parameter(
            unit="s",
            meaning="time constant of the coil behind its thermistor",
            low=1.0,
            high=20000.0,
            role="shape",
            scan=(30.0, 100.0, 300.0, 900.0, 2000.0),
            zero=0.0,
            logarithmic=True,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the lagging coil, initially at the thermistor's temperature. T is linear between segments."""
        if self.tau_s <= 0.0:
            return signals
        last_s, last_input, last_coil = signals.memory.get(
            self.identifier, (signals.time_s[0], signals.coil_c[0], signals.coil_c[0])
        )
        coil = float(_straight(last_input, signals.coil_c[0], signals.time_s[0] - last_s, last_coil, self.tau_s))
        numerator, denominator = _triangle_hold(signals.interval_s / self.tau_s)
        state = np.array([coil - numerator[0] * signals.coil_c[0]])
        lagging, _ = scipy.signal.lfilter(numerator, denominator, signals.coil_c, zi=state)
        kept = np.array([signals.time_s[-1], signals.coil_c[-1], lagging[-1]])
        return replace(
            signals,
            coil_c=lagging,
            coil_rate_c_per_s=(signals.coil_c - lagging) / self.tau_s,
            memory={**signals.memory, self.identifier: kept},
        )

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            "The fibre coil is colder than its thermistor while the chamber heats and warmer while it cools:"
            f" it lags by {self.tau_s:.3g} s."
        )


def _straight(start: float, end: float, wait_s: float, coil: float, tau_s: float) -> float:
    """Return the coil after a linear input from start to end."""
    if wait_s <= 0.0:
        return coil
    slope, decay = (end - start) / wait_s, math.exp(-wait_s / tau_s)
    return end - slope * tau_s + (coil - start + slope * tau_s) * decay


def _triangle_hold(step: float) -> tuple[FloatArray, FloatArray]:
    """Return the exact difference equation of a lag for an input that is linear between samples."""
    decay = math.exp(-step)
    share = -math.expm1(-step) / step
    return np.array([1.0 - share, share - decay]), np.array([1.0, -decay])
