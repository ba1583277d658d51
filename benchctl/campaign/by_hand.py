"""Playing what a person does: the table rests, confirmed, and the runner goes on looking at the bench meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from benchctl.campaign.hands import Hands, Meanwhile
from benchctl.campaign.soak import one_poll
from benchctl.plan import Ask, Mount, PowerCycle
from benchctl.recordings.campaign_folder import StepWriter

if TYPE_CHECKING:
    from benchctl.campaign.play import StepPlayer

_SETTLE_S = 1.0
"""After somebody has touched what stands on the table, it is left alone for so long."""


def power_cycle(player: StepPlayer, step: PowerCycle, into: StepWriter) -> tuple[float, float]:
    """Have the supply switched off and on; when it went off and came on, seconds since the start of the recording."""
    clock = player.opened.clock
    _rest(player)
    _have_done(player, "supply off", lambda hands, meanwhile: hands.power(False, meanwhile))
    off_s, end_s, polled = player.now_s(), clock.now() + step.off_s, False
    while clock.now() < end_s or not polled:
        player.notify("supply off")
        left_s = end_s - clock.now()
        player.wait(min(left_s, 6 * clock.chunk_s) if left_s > 0 else clock.chunk_s)
        polled |= _poll(player, into)
    _have_switched_on(player)
    return off_s, player.now_s()


def mount(player: StepPlayer, step: Mount, into: StepWriter) -> tuple[float, float]:
    """Have the unit mounted; from when to when, seconds since the start of the recording."""
    begun_s = _begin(player)
    _have_done(player, step.label, lambda hands, meanwhile: hands.mount(step.position, meanwhile))
    player.position = step.position
    return begun_s, _end(player, into)


def ask(player: StepPlayer, step: Ask, into: StepWriter) -> tuple[float, float]:
    """Have done what is asked; from when to when, seconds since the start of the recording."""
    begun_s = _begin(player)
    _have_done(player, step.says, lambda hands, meanwhile: hands.ask(step.says, meanwhile))
    return begun_s, _end(player, into)


def switch_on(player: StepPlayer) -> None:
    """Have the supply switched on, or made sure that it is, before a run goes on."""
    _rest(player)
    _have_switched_on(player)


def _have_switched_on(player: StepPlayer) -> None:
    _have_done(player, "supply on", lambda hands, meanwhile: hands.power(True, meanwhile))


def _begin(player: StepPlayer) -> float:
    _rest(player)
    return player.now_s()


def _end(player: StepPlayer, into: StepWriter) -> float:
    _rest(player)
    while not _poll(player, into):
        player.wait(player.opened.clock.chunk_s)
    return player.now_s()


def _rest(player: StepPlayer) -> None:
    """The table at rest, read back, its servo on and without a fault."""
    player.supervisor.check_state()
    player.rest(_SETTLE_S)


def _have_done(player: StepPlayer, says: str, act: Callable[[Hands, Meanwhile], None]) -> None:
    opened, supervisor = player.opened, player.supervisor
    began_s = opened.clock.now()

    def meanwhile() -> None:
        # not the table's state: to open the chamber's door may cut the servo off
        player.notify(f"waiting for {opened.hands.who}: {says}")
        player.wait(opened.clock.chunk_s)
        supervisor.look_at_chamber()

    act(opened.hands, meanwhile)
    supervisor.event("operator", says=says, by=opened.hands.who, waited_s=round(opened.clock.now() - began_s, 3))


def _poll(player: StepPlayer, into: StepWriter) -> bool:
    """Record what the chamber and the gyro's terminals say, whether they have answered.

    No interlock is held against the gyro: without its supply its words are void.
    """
    opened, supervisor = player.opened, player.supervisor
    air, scan = supervisor.look_at_chamber(), supervisor.ask("digitizer", opened.digitizer.read_once)
    if air is None or scan is None:
        return False
    player.gyro_c = opened.bench.digitizer.gyro_celsius(scan.thermistor_v)
    into.append_point(one_poll(player.now_s(), air, {"poll_gyro_temp_c": player.gyro_c, "poll_gyro_v": scan.gyro_v}))
    return True
