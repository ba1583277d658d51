"""What a calibration may be told; the defaults are the paper's orders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationOptions:
    """Orders and choices.

    `orders_1` and `orders_2` are those of k(T) and k(ω) in the two stages, `bias_order` that of U0(T). `T0_c` None
    takes the recording's own (`simulation.T0_c`), or the set point at which the fastest rates were run, of several the
    one nearest to 20 °C. `law` chooses
    the joint fit: `auto` fits sine and polynomial and prefers what the fitted runs prefer. `choose_orders` picks the
    joint polynomial's orders by cross-validation over whole runs. `hold_out`: where no run is marked `verify`, keep
    some aside.
    """

    T0_c: float | None = None
    orders_1: tuple[int, int] = (2, 2)
    orders_2: tuple[int, int] = (1, 1)
    bias_order: int = 2
    law: Literal["auto", "sine", "polynomial", "response"] = "auto"
    choose_orders: bool = False
    robust: bool = True
    encoder_errors: bool = True
    hold_out: bool = True
    latitude_deg: float | None = None

    def __post_init__(self) -> None:
        for name, orders in (
            ("orders_1", self.orders_1),
            ("orders_2", self.orders_2),
            ("bias_order", (self.bias_order,)),
        ):
            if any(order < 0 or order > 4 for order in orders):
                raise UsageError(f"calibration: {name} is {orders}, expected orders from 0 to 4")
