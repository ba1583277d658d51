"""Have an operator set the rates of a manual table, and confirm each by the encoder."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

from benchctl.campaign.operator import say, turn_question
from benchctl.campaign.play import StepPlayer, await_operator
from benchctl.campaign.rest import AT_REST_DPS
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.rate_tables.manual import ManualTable

ATTEMPTS = 3
"""Number of prompts for a rate that the encoder does not show."""

PATIENCE_CHUNKS = 40
"""Time after an answer until the encoder shows the rate, in chunks of the clock: 20 s if bench time is wall time."""


@contextmanager
def turned_by_operator(player: StepPlayer) -> Iterator[None]:
    """Send the commands of a manual table to the operator of the campaign while the block runs."""
    table = player.opened.table
    if not isinstance(table, ManualTable):
        yield
        return
    unsupervised = table.operator
    table.operator = lambda rate_dps: await_turn(player, rate_dps)
    try:
        yield
    finally:
        table.operator = unsupervised


def await_turn(player: StepPlayer, rate_dps: float) -> None:
    """Have the operator set a rate, or stop the table (0), until the encoder shows it.

    Raises
    ------
    InstrumentError
        The encoder shows another rate after `ATTEMPTS` questions.
    """
    clock, limits = player.opened.clock, player.opened.bench.limits
    tolerance_dps = limits.motion_tolerance_dps(rate_dps) if rate_dps else AT_REST_DPS
    expected, shown_dps = f"{rate_dps:+g} ± {tolerance_dps:.3g} deg/s", math.nan
    for attempt in range(ATTEMPTS):
        if attempt:
            say(f"the encoder shows {shown_dps:+.3f} deg/s, expected {expected}")
        await_operator(player, turn_question(rate_dps), lambda who, meanwhile: who.turn(rate_dps, meanwhile))
        for _ in range(PATIENCE_CHUNKS):
            player.wait(clock.chunk_s)
            shown_dps = motion.rate_dps if (motion := player.supervisor.motion) else math.nan
            if abs(shown_dps - rate_dps) <= tolerance_dps:
                return
            player.notify(f"waiting until the encoder shows {expected}")
    raise InstrumentError(
        f"rate_table: prompted {ATTEMPTS} times to {turn_question(rate_dps)}; the encoder shows {shown_dps:+.3f} "
        f"deg/s, expected {expected}; look at the table, at encoder_counts_per_rev and encoder_sign in [digitizer], "
        "and at limits.motion_error_percent"
    )
