"""How a table is stopped and a chamber sent to its safe set point, each confirmed by reading back.

The runner does it with its own links, the guard with new ones; so nothing here knows of a campaign.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from benchctl_instruments.errors import InstrumentError, SafetyError
from benchctl_instruments.interfaces import Chamber, Clock, RateTable, TableState

AT_REST_DPS = 0.05
"""A table slower than this is at rest: its controller's reading has noise."""

STILL_S = 0.1
"""So long, in bench time, every look has to find it at rest: a servo that swings out passes zero as well."""

_LOOK_AGAIN_S = 0.05


def stop_table(table: RateTable, clock: Clock, within_s: float, beat: Callable[[], None]) -> float:
    """Stop the table and wait until it rests; returns the rate [deg/s] that was read. See `wait_for_rest`."""
    if table.state() not in (TableState.DISABLED, TableState.FAULT):
        table.stop()
    return wait_for_rest(table, clock, within_s, beat)  # whose servo is off is stopped by its controller, or runs out


def wait_for_rest(table: RateTable, clock: Clock, within_s: float, beat: Callable[[], None]) -> float:
    """Wait until the table has come to rest, and return the rate [deg/s] that was read; `beat` is called at each look.

    Raises
    ------
    SafetyError
        Where it still turns after `within_s` of bench time.
    """
    deadline_s = clock.now() + within_s
    still_since_s = math.inf
    while True:
        rate_dps, now_s = table.read().rate_dps, clock.now()
        if abs(rate_dps) <= AT_REST_DPS:
            still_since_s = min(still_since_s, now_s)
            if now_s - still_since_s >= STILL_S:
                return rate_dps
        elif now_s > deadline_s:
            raise SafetyError(
                f"rate_table: should have come to rest, but still turns at {rate_dps:+.3f} deg/s; "
                "keep clear of it, and stop it at its controller"
            )
        else:
            still_since_s = math.inf
        beat()
        clock.sleep(_LOOK_AGAIN_S)


def send_home(chamber: Chamber, safe_c: float, remark: Callable[[str], None]) -> float:
    """Send the chamber to its safe set point; returns the set point [°C] that it then has.

    It is the set point that is safe, and its driver has read it back by then. A chamber that cannot tell its air, as
    with a sensor over range, has gone there all the same: what it says of its air goes to `remark`.
    """
    chamber.go_to(safe_c)
    try:
        return chamber.read().setpoint_c
    except InstrumentError as err:
        remark(f"chamber: its set point was read back, its air is not known: {err}")
        return safe_c


def rest_within_s(rate_dps: float, acceleration_dps2: float) -> float:
    """Bench time [s] after which a table with these limits should rest: four times what the ramp takes, and 5 s."""
    return 5.0 + 4 * rate_dps / acceleration_dps2
