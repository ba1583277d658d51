"""Effect: dependence of the scale factor on the rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class RateNonlinearity(PhysicalEffect):
    """k(ω) is missing: the scale factor is × (1 + c2·ω² + c4·ω⁴) (domain facts, SIN).

    The output of an open-loop interferometer is sin(S·ω)/S: c2 = −S²/6 and c4 = S⁴/120.
    """

    c2: float
    c4: float
    range_dps: float = 200.0

    identifier: ClassVar[str] = "rate_nonlinearity"
    stage: ClassVar[Stage] = "scale"
    pointwise: ClassVar[bool] = True
    momentary: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The output is not in proportion to the rate: an open-loop interferometer gives the sine of its phase, so that"
        " the scale factor falls as the rate grows, alike in both directions."
    )
    equation: ClassVar[str] = "U − U0 → (U − U0)·(1 + c2·ω² + c4·ω⁴)"
    coordinate: ClassVar[str] = "rate"
    excited_by: ClassVar[str] = "rates from a third of the range up to all of it"
    look_alikes: ClassVar[tuple[str, ...]] = ("saturation", "two_rails", "overload", "fringe_ambiguity", "dead_zone")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "c2": Parameter(
            unit="(degree/s)-2",
            meaning="relative change of the scale factor with the square of the rate",
            low=-1e-4,
            high=1e-4,
            role="size",
            scan=(1e-8,),
            zero=0.0,
        ),
        "c4": Parameter(
            unit="(degree/s)-4",
            meaning="and with its fourth power",
            low=-1e-8,
            high=1e-8,
            role="size",
            scan=(1e-12,),
            zero=0.0,
        ),
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with a rate-dependent scale factor."""
        squared = signals.sensed_rate_dps * signals.sensed_rate_dps
        volts = self.c4 * squared
        volts += self.c2
        volts *= squared
        volts += 1.0
        volts *= signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        squared = self.range_dps**2
        change = squared * (self.c2 + self.c4 * squared)
        return (
            f"The output is not in proportion to the rate: at {self.range_dps:.4g} °/s the scale factor is"
            f" {100.0 * abs(change):.3g} % {'lower' if change < 0.0 else 'higher'} than near zero."
        )
