"""A hold: between two steps the run waits, with the table at rest, until the interlocks that ask for it are off."""

from __future__ import annotations

from benchctl.campaign.interlocks import Change
from benchctl.campaign.play import StepPlayer
from benchctl_instruments.errors import SafetyError


def hold_if_asked(player: StepPlayer) -> None:
    """Look at everything that is measured; where an interlock asks for a hold, wait until none does any more.

    A bench without such interlocks is not looked at, and costs no time.

    Raises
    ------
    SafetyError
        Where one has asked for longer than its `give_up_s`, counted from when the run began to wait for it.
    """
    interlocks = player.supervisor.interlocks
    if not interlocks.may_hold:
        return
    _look(player)
    if not interlocks.holds:
        return
    clock, event = player.opened.clock, player.supervisor.event
    event("hold", on=True, says=_why(interlocks.holds))
    player.rest(0.0)
    began_s = clock.now()
    while holds := interlocks.holds:
        player.notify(f"on hold, {_why(holds)}")
        for change in holds:
            waited_s = clock.now() - max(began_s, change.now_s)
            if waited_s > (change.interlock.give_up_s or 0.0):
                raise SafetyError(
                    f"on hold for {waited_s:.0f} s: {change.says} ({change.value:.6g} at first), and it is not over; "
                    "find out why, then run again"
                )
        player.wait(2 * clock.chunk_s)
        _look(player)
    event("hold", on=False, waited_s=round(clock.now() - began_s, 3))


def _look(player: StepPlayer) -> None:
    supervisor = player.supervisor
    supervisor.check_state()
    supervisor.look_at_table()
    supervisor.look_at_chamber()
    if (gyro := supervisor.look_at_gyro()) is not None:
        player.gyro_c, _ = gyro


def _why(holds: list[Change]) -> str:
    return ", ".join(change.says for change in holds)
