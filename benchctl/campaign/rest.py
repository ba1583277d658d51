"""Stop a table and send a chamber to its safe set point, each confirmed by reading back.

The runner does this with its own links, the guard with new ones; so nothing here depends on a campaign.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from benchctl_instruments.errors import InstrumentError, SafetyError
from benchctl_instruments.interfaces import Chamber, Clock, RateTable, TableState

AT_REST_DPS = 0.05
"""A table slower than this is at rest: its controller's reading has noise."""

STILL_S = 0.1
"""Bench time during which every look must find the table at rest: a servo that overshoots passes zero as well."""

_LOOK_AGAIN_S = 0.05


def stop_table(table: RateTable, clock: Clock, within_s: float, beat: Callable[[], None]) -> float:
    """Stop the table and wait until it is at rest; return the rate [deg/s] that was read. See `wait_for_rest`."""
    if table.state() not in (TableState.DISABLED, TableState.FAULT):
        table.stop()
    return wait_for_rest(table, clock, within_s, beat)  # with its servo off, the controller stops it, or it runs down


def wait_for_rest(table: RateTable, clock: Clock, within_s: float, beat: Callable[[], None]) -> float:
    """Wait until the table is at rest, and return the rate [deg/s] that was read; `beat` is called at each look.

    Raises
    ------
    SafetyError
        The table still turns after `within_s` of bench time.
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
    """Send the chamber to its safe set point; return the set point [°C] that was read back.

    Only the set point has to be safe, and the driver has already read it back. If the chamber cannot report its air
    temperature, for example with a sensor over range, the set point is valid all the same; the error goes to `remark`.
    """
    chamber.go_to(safe_c)
    try:
        return chamber.read().setpoint_c
    except InstrumentError as err:
        remark(f"chamber: its set point was read back, its air is not known: {err}")
        return safe_c


def rest_within_s(rate_dps: float, acceleration_dps2: float) -> float:
    """Return the bench time [s] after which a table with these limits should be at rest: four times the ramp + 5 s."""
    return 5.0 + 4 * rate_dps / acceleration_dps2
