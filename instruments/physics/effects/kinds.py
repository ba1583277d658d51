"""Three kinds of effect that the simulated bench and a diagnosis must each treat in their own way.

The bench plays them forwards, sample by sample, and knows the true motion. A diagnosis holds what the encoder said, on
the recording's own samples, which are too coarse for a difference equation but, being band-limited, exact in frequency.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar, Literal

import numpy as np
import scipy  # which loads signal when it is first used

from benchctl_instruments.arrays import ComplexArray, FloatArray
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.effects.effect import PhysicalEffect

FORGETTING_TIME_CONSTANTS = 20.0
"""After that many of its slowest time constant a filter has forgotten its start, to 2e-9 of it."""


class FilterEffect(PhysicalEffect):
    """A linear filter of one signal, given in continuous time; its gain at 0 Hz is 1.

    On a dense grid it is a difference equation (triangle hold: exact for an input that runs straight from sample to
    sample), on the samples of a recording a product in frequency.
    """

    filtered: ClassVar[Literal["output_v", "sensed_rate_dps"]]

    @abstractmethod
    def transfer_function(self) -> tuple[FloatArray, FloatArray]:
        """Numerator and denominator in powers of s [rad/s], highest first."""

    @property
    @abstractmethod
    def memory_s(self) -> float:
        """How long, s, it remembers: after that a start from a wrong state is forgotten."""

    def response(self, frequency_hz: FloatArray) -> ComplexArray:
        """Its complex gain at frequencies [Hz], shape (m,)."""
        s = 2j * np.pi * frequency_hz
        numerator, denominator = self.transfer_function()
        gain: ComplexArray = np.polyval(numerator, s) / np.polyval(denominator, s)
        return gain

    def apply(self, signals: Signals) -> Signals:
        """The filtered signal; without the samples just before, its input was long as it begins."""
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
    """The gyro's samples are not of the instant of their stamps; the encoder's are.

    The bench asks `gyro_time_s` when it samples, a diagnosis when it predicts: `apply` has nothing left to do.
    """

    @abstractmethod
    def gyro_time_s(self, stamp_s: FloatArray) -> FloatArray:
        """The instants [s] of which the gyro's samples are, for their stamps [s]; both of shape (n,)."""

    def apply(self, signals: Signals) -> Signals:
        """The signals as they are."""
        return signals


class EncoderEffect(PhysicalEffect):
    """The encoder states another angle than the table's."""

    @abstractmethod
    def error_deg(self, angle_deg: FloatArray) -> FloatArray:
        """What it adds to true angles [deg], shape (n,)."""

    @abstractmethod
    def error_slope(self, angle_deg: FloatArray) -> FloatArray:
        """The derivative of `error_deg` by the angle, shape (n,), without unit."""

    @property
    @abstractmethod
    def waves_a_turn(self) -> float:
        """How often a turn it repeats."""

    def apply(self, signals: Signals) -> Signals:
        """What the encoder states."""
        return replace(signals, encoder_deg=signals.encoder_deg + self.error_deg(signals.angle_deg))

    def true_motion(self, signals: Signals) -> Signals:
        """Angle, rate and acceleration of the table from those that the encoder states.

        With e the error, θ + e(θ) is stated, and (1 + e′)·ω. The error is small: two steps of a fixed point are exact
        to far below its own size. The change of e′ along the way is left out of the acceleration.
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
    """A random process or a fault of the data: the bench draws it, a diagnosis knows it by its statistics.

    The circumstance `seed` makes the draw repeatable; draws do not depend on how a run is cut into stretches.
    """
