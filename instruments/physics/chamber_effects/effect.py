"""Base class of chamber effects and the signals that they change: the drive of the air and its heat loss.

The baseline is one lag, τ·dT/dt = gain·u + T_room − T; an effect changes a term of this equation.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import DescribedEffect

ChamberStage = Literal["source", "transport", "loss"]
"""`source`: conversion of the drive to heat; `transport`: from the heater to the air; `loss`: from the air outwards."""

Drive = Literal["power", "setpoint"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ChamberSignals:
    """A run without gaps; arrays have shape (n,).

    `time_s` counts from the start of the run. `drive` is the heater's power in its own unit, or the set point [°C];
    `room_c` is the temperature of the surroundings. The air loses `loss` · (T − room) + `radiation` · (T⁴ −
    room⁴)/(4·300³), both in K, with T and room in the second term in kelvin. It cools by `capacity`/τ_store · (T −
    T_store) [K/s] for each of `stores` (capacity relative to its own, τ_store [s]), and by `exchange` [1/s] · (T −
    `second_c`) for a second body whose temperature was measured (n,). `before` is the drive before the start; None:
    equal to the drive at the start. `push_c` (n,) is an additional shift of the temperature to which the air settles
    [K]; `push_of_air` (2, k) is such a shift as a function of the air temperature in its first row
    (`structures.pushed`).
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
    """A chamber effect; `stage` orders effects, `drives` lists the kinds of drive to which it applies.

    `needs_second` marks effects that use the measured temperature of a second body.
    """

    stage: ClassVar[ChamberStage]
    drives: ClassVar[tuple[Drive, ...]] = ("power", "setpoint")
    needs_second: ClassVar[bool] = False

    @abstractmethod
    def apply(self, signals: ChamberSignals) -> ChamberSignals:
        """Return the signals with the effect."""
