"""What an effect of a chamber works on: what drives the air, and how the air loses its heat.

The baseline is one lag, τ·dT/dt = gain·u + T_room − T; an effect changes what stands in that equation.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import DescribedEffect

ChamberStage = Literal["source", "transport", "loss"]
"""`source`: what the heater makes of its drive; `transport`: on its way to the air; `loss`: out of the air again."""

Drive = Literal["power", "setpoint"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ChamberSignals:
    """A run without gaps; arrays of shape (n,).

    `time_s` counts from the start of the run. `drive` is the heater's power in its own unit, or the set point [°C];
    `room_c` where the heat goes to. The air loses `loss` · (T − room) + `radiation` · (T⁴ − room⁴)/(4·300³), K each,
    with T and room there in kelvin. It cools by `capacity`/τ_store · (T − T_store) [K/s] for each of `stores` (capacity
    relative to its own, τ_store [s]), and by `exchange` [1/s] · (T − `second_c`) for a second body whose temperature
    was measured (n,). `before` is the drive before the start; None: it had long been what it is at the start. `push_c`
    (n,) is what else moves the temperature to which the air settles [K]; `push_of_air` (2, k) the same by the
    temperature of the air, which its first row holds (`structures.pushed`).
    """

    time_s: FloatArray
    interval_s: float
    drive: FloatArray
    room_c: FloatArray
    loss: FloatArray
    radiation: float = 0.0
    stores: tuple[tuple[float, float], ...] = ()
    second_c: FloatArray | None = None
    exchange: float = 0.0
    before: float | None = None
    push_c: FloatArray | None = None
    push_of_air: FloatArray | None = None

    @property
    def drive_before(self) -> float:
        """The drive before the start."""
        return float(self.drive[0]) if self.before is None else self.before


class ChamberEffect(DescribedEffect):
    """Physics of a chamber; `stage` orders effects, `drives` says with which kind of drive it makes sense.

    `needs_second` is for those that take the measured temperature of a second body.
    """

    stage: ClassVar[ChamberStage]
    drives: ClassVar[tuple[Drive, ...]] = ("power", "setpoint")
    needs_second: ClassVar[bool] = False

    @abstractmethod
    def apply(self, signals: ChamberSignals) -> ChamberSignals:
        """The signals with the effect."""
