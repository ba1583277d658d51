"""Effect: sensitivity to angular acceleration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class AngularAcceleration(PhysicalEffect):
    """U + v·dω/dt (domain facts, ACC): v divided by the scale factor is a time t; a delay of −t has the same effect."""

    v_per_dps2: float

    identifier: ClassVar[str] = "angular_acceleration"
    stage: ClassVar[Stage] = "bias"
    pointwise: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The output holds a part in proportion to the angular acceleration: the turning coil strains its fibre."
        " A shift in time looks almost the same."
    )
    equation: ClassVar[str] = "U → U + v·dω/dt"
    coordinate: ClassVar[str] = "acceleration"
    excited_by: ClassVar[str] = "sines of high frequency and quick reversals"
    look_alikes: ClassVar[tuple[str, ...]] = ("timing_offset", "sensor_bandwidth", "mount_resonance")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "v_per_dps2": Parameter(
            unit="V s2 degree-1",
            meaning="output for an acceleration of one degree a second squared",
            low=-0.1,
            high=0.1,
            role="size",
            scan=(1e-7,),
            zero=0.0,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with the acceleration-dependent part."""
        volts = self.v_per_dps2 * signals.acceleration_dps2
        volts += signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            "The output holds a part in proportion to the angular acceleration:"
            f" {1e6 * self.v_per_dps2:+.3g} µV for one °/s²."
        )
