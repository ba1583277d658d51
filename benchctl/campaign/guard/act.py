"""What the guard does once the runner is gone, and what it says of it: in the campaign's journal, and on stderr."""

from __future__ import annotations

import contextlib
import os
from dataclasses import asdict

from benchctl.campaign.guard.journal import note
from benchctl.campaign.guard.orders import Orders
from benchctl.campaign.guard.rescue import Rescued, rescue
from benchctl_instruments.errors import BenchError


def act(orders: Orders, why: str) -> bool:
    """Bring the bench to rest; `why` is the reason, in words. Returns whether all of it was read back."""
    unwritten = ""

    def tell(says: str, **data: object) -> None:
        nonlocal unwritten
        try:
            note(orders.journal, says=f"{why}; {says}", **data)
        except BenchError as err:
            unwritten = f" (not in the journal: {err})"

    rescued = rescue(orders, tell)
    tell(words(rescued), reason=why, **asdict(rescued))
    with contextlib.suppress(OSError):  # only at the end, for a terminal may be held, or gone
        os.write(2, f"benchctl guard: {why}; {words(rescued)}{unwritten}\n".encode())
    return not rescued.problems


def words(rescued: Rescued) -> str:
    """What became of the bench, in a line."""
    rest = f"table at rest ({rescued.rate_dps:+.3f} deg/s)" if rescued.rate_dps is not None else ""
    home = f"chamber set to {rescued.chamber_setpoint_c:g} °C" if rescued.chamber_setpoint_c is not None else ""
    confirmed = f"{' and '.join(filter(None, (rest, home)))}, read back" if rest or home else ""
    failed = f"NOT CONFIRMED: {'; '.join(rescued.problems)}; go and look" if rescued.problems else ""
    return "; ".join(filter(None, (confirmed, failed)))
