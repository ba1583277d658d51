"""Kinds of effects that the simulated bench and a diagnosis treat differently.

The bench simulates them forwards, sample by sample, and knows the true motion. A diagnosis has the encoder's angles at
the recording's samples, which are too coarse for a difference equation but, being band-limited, exact in frequency.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar, Literal

import numpy as np
import scipy  # scipy.signal is loaded on first use

from benchctl_instruments.arrays import ComplexArray, FloatArray
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.effects.effect import PhysicalEffect

FORGETTING_TIME_CONSTANTS = 20.0
"""After this multiple of its slowest time constant a filter has forgotten its initial state, except for 2e-9 of it."""


class FilterEffect(PhysicalEffect):
    """A linear filter of one signal, given in continuous time; its gain at 0 Hz is 1.

    On a dense grid it is a difference equation (triangle hold: exact for an input that is linear between samples), on
    the samples of a recording a product in the frequency domain.
    """

    filtered: ClassVar[Literal["output_v", "sensed_rate_dps"]]

    @abstractmethod
    def transfer_function(self) -> tuple[FloatArray, FloatArray]:
        """Return numerator and denominator in powers of s [rad/s], highest first."""

    @property
    @abstractmethod
    def memory_s(self) -> float:
        """The time [s] after which a wrong initial state is forgotten."""

    def response(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return its complex gain at frequencies [Hz], shape (m,)."""
        s = 2j * np.pi * frequency_hz
        numerator, denominator = self.transfer_function()
        gain: ComplexArray = np.polyval(numerator, s) / np.polyval(denominator, s)
        return gain

    def apply(self, signals: Signals) -> Signals:
        """Return the filtered signal; without the previous samples, a long constant input is assumed."""
        if any(getattr(self, name) == parameter.zero for name, parameter in self.parameters.items()):
            return signals
        numerator, denominator = self._difference_equation(signals.interval_s)
        x: FloatArray = getattr(signals, self.filtered)
        next_index, *kept = signals.memory.get(self.identifier, (-np.inf,))
        if next_index == signals.first_index:
            state = np.asarray(kept)
        else:
            state = scipy.signal.lfilter_zi(numerator, denominator) * x[0]
        y, state = scipy.signal.lfilter(numerator, denominator, x, zi=state)
        carried = np.array([signals.first_index + x.size, *state])
        changed: dict[str, Any] = {self.filtered: y}
        return replace(signals, **changed, memory={**signals.memory, self.identifier: carried})

    def _difference_equation(self, interval_s: float) -> tuple[FloatArray, FloatArray]:
        numerator, denominator, _ = scipy.signal.cont2discrete(self.transfer_function(), interval_s, method="foh")
        return np.ravel(numerator), np.ravel(denominator)


class ClockEffect(PhysicalEffect):
    """The gyro's sampling instants differ from their stamps; the encoder's do not.

    The bench calls `gyro_time_s` when it samples, a diagnosis when it predicts: `apply` changes nothing.
    """

    @abstractmethod
    def gyro_time_s(self, stamp_s: FloatArray) -> FloatArray:
        """Return the sampling instants [s] of the gyro for stamps [s]; both of shape (n,)."""

    def apply(self, signals: Signals) -> Signals:
        """Return the signals unchanged."""
        return signals


class EncoderEffect(PhysicalEffect):
    """The encoder's angle differs from the table's angle."""

    @abstractmethod
    def error_deg(self, angle_deg: FloatArray) -> FloatArray:
        """Return the error [deg] at true angles [deg], shape (n,)."""

    @abstractmethod
    def error_slope(self, angle_deg: FloatArray) -> FloatArray:
        """Return the derivative of `error_deg` with respect to the angle, shape (n,), dimensionless."""

    @property
    @abstractmethod
    def waves_a_turn(self) -> float:
        """Number of its periods per turn."""

    def apply(self, signals: Signals) -> Signals:
        """Return the signals with the encoder's angle."""
        return replace(signals, encoder_deg=signals.encoder_deg + self.error_deg(signals.angle_deg))

    def true_motion(self, signals: Signals) -> Signals:
        """Return angle, rate and acceleration of the table, computed from those of the encoder.

        With the error e, the encoder reports θ + e(θ) and (1 + e′)·ω. The error is small: two fixed-point iterations
        are exact to far below its own size. The change of e′ with time is neglected in the acceleration.
        """
        angle = signals.angle_deg - self.error_deg(signals.angle_deg)
        angle = signals.angle_deg - self.error_deg(angle)
        share = 1.0 / (1.0 + self.error_slope(angle))
        rate = signals.rate_dps * share
        return replace(
            signals,
            angle_deg=angle,
            rate_dps=rate,
            acceleration_dps2=signals.acceleration_dps2 * share,
            sensed_rate_dps=signals.sensed_rate_dps + rate - signals.rate_dps,
        )


class NoiseEffect(PhysicalEffect):
    """A random process or a fault of the data: the bench draws it; a diagnosis uses its statistics.

    The circumstance `seed` makes the draw reproducible; draws do not depend on how a run is cut into segments.
    """
