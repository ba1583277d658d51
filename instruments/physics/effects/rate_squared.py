"""Effect: an output term proportional to the square of the rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class RateSquared(PhysicalEffect):
    """U + v·ω² (domain facts, SQ): for a non-reciprocal phase φ, v = −½·K0·S·φ."""

    v_per_dps2: float
    range_dps: float = 200.0

    identifier: ClassVar[str] = "rate_squared"
    stage: ClassVar[Stage] = "bias"
    pointwise: ClassVar[bool] = True
    momentary: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The output holds a part in the square of the rate, of the same sign in both directions: a non-reciprocal phase"
        " or a demodulator off its middle tilts the interferometer's sine."
    )
    equation: ClassVar[str] = "U → U + v·ω²"
    coordinate: ClassVar[str] = "abs_rate"
    excited_by: ClassVar[str] = "both directions, at three rates or more"
    look_alikes: ClassVar[tuple[str, ...]] = ("scale_asymmetry",)
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "v_per_dps2": Parameter(
            unit="V (degree/s)-2",
            meaning="output for the square of the rate",
            low=-1e-3,
            high=1e-3,
            role="size",
            scan=(1e-9,),
            zero=0.0,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with the squared term."""
        volts = signals.sensed_rate_dps * signals.sensed_rate_dps
        volts *= self.v_per_dps2
        volts += signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            "The output holds a part in the square of the rate, the same in both directions:"
            f" {1e3 * self.v_per_dps2 * self.range_dps**2:+.3g} mV at {self.range_dps:.4g} °/s."
        )
