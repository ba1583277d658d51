"""Swinging shifts the bias: the output has a part in the square of the angular acceleration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class VibrationRectification(PhysicalEffect):
    """U + v·(dω/dt)²: what yields both ways alike under the coil's strain does not average out."""

    v_per_dps2_squared: float

    identifier: ClassVar[str] = "vibration_rectification"
    stage: ClassVar[Stage] = "bias"
    momentary: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The output holds a part in the square of the angular acceleration, of the same sign both ways: while the"
        " table swings the bias is another than at rest."
    )
    equation: ClassVar[str] = "U → U + v·(dω/dt)²"
    coordinate: ClassVar[str] = "acceleration"
    excited_by: ClassVar[str] = "sines of several amplitudes and frequencies"
    look_alikes: ClassVar[tuple[str, ...]] = ("rate_squared", "angular_acceleration")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "v_per_dps2_squared": Parameter(
            unit="V s4 degree-2",
            meaning="output for the square of an acceleration of one degree a second squared",
            low=-1e-5,
            high=1e-5,
            role="size",
            scan=(1e-10,),
            zero=0.0,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """The output with the square."""
        volts = self.v_per_dps2_squared * signals.acceleration_dps2**2
        return replace(signals, output_v=signals.output_v + volts)

    def says(self) -> str:
        """The finding in one sentence."""
        at_dps2 = 400.0
        return (
            "The output holds a part in the square of the angular acceleration:"
            f" {1e3 * self.v_per_dps2_squared * at_dps2**2:+.3g} mV at {at_dps2:g} °/s²."
        )
