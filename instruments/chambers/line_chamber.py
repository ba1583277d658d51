"""What chambers with a controller that speaks in lines have in common.

Fault handling: a request without an answer in time, or with an unreadable answer, is repeated, in the first case on a
new connection as in `links.lines`, since a command states a value and not a change.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NoReturn, TypeVar

from benchctl_instruments.errors import BenchError, InstrumentError, UsageError
from benchctl_instruments.interfaces import Clock, Instrument
from benchctl_instruments.links.lines import LineDialogue
from benchctl_instruments.links.wirelog import note_recovered
from benchctl_instruments.protocols.lines import UnreadableError, tenths

CONFIRM_S, LOOK_AGAIN_S = 2.0, 0.1
SETPOINT, RAMP = "set point {:g} °C", "ramp {:g} °C/min"

Answer = TypeVar("Answer")


class LineChamber(Instrument, ABC):
    """Driver of a chamber whose controller speaks in lines.

    Parameters
    ----------
    lines
        The dialogue with the controller, not yet connected.
    clock
        The clock used for waiting.
    controller
        The controller's name, for the error message of an answer that cannot be read.

    A model's driver takes also `timeout_s`, the timeout of a connection and of an answer in wall time, and `wire_log`,
    as `byte_link` does.
    """

    def __init__(self, lines: LineDialogue, *, clock: Clock, controller: str) -> None:
        self._lines = lines
        self._who = lines.who
        self._clock = clock
        self._controller = controller

    def open(self) -> None:
        """Connect and check that the right controller answers."""
        self._lines.open()
        try:
            self._check_controller()
        except BenchError:
            self._lines.close()
            raise

    def close(self) -> None:
        """Close the link; safe to call twice, and never raises."""
        self._lines.close()

    @abstractmethod
    def _check_controller(self) -> None: ...

    def _ask(self, query: str, read: Callable[[str], Answer]) -> Answer:
        return self._exchange(query, self._lines.ask, read)

    def _exchange(self, request: str, send: Callable[[str], str], read: Callable[[str], Answer]) -> Answer:
        """Return the parsed answer. An unreadable answer is requested a second time: lines have no checksum."""
        try:
            return read(send(request))
        except UnreadableError as err:
            garbled = str(err)
        try:
            answer = read(send(request))
        except UnreadableError as err:
            raise InstrumentError(
                f"{self._who}: sent {request!r}, {err}; check the cable, and that it is {self._controller}"
            ) from err
        note_recovered(f"{self._who}: sent {request!r}, {garbled}")
        return answer

    def _confirm(self, wanted: str, look: Callable[[], str]) -> None:
        """Wait briefly, in bench time, until `look` returns the wanted state; otherwise raise `InstrumentError`."""
        started_s = self._clock.now()
        while (shown := look()) != wanted:
            if self._clock.now() - started_s >= CONFIRM_S:
                raise InstrumentError(
                    f"{self._who}: it acknowledged {wanted}, and still reads {shown} after {CONFIRM_S:g} s;"
                    " check that no program or other computer sets it"
                )
            self._clock.sleep(LOOK_AGAIN_S)

    def _refuse_program(self) -> NoReturn:
        raise InstrumentError(
            f"{self._who}: it runs a program and would not keep our set point; end the program on its panel"
        )

    def _require_order(self, low_c: float, high_c: float) -> None:
        """Raise `UsageError` unless the first set point limit is the lower one, in tenths."""
        if not tenths(low_c) < tenths(high_c):
            raise UsageError(
                f"{self._who}: set point limits {low_c:g} to {high_c:g} °C; "
                "give the lower one first, 0.1 °C apart at least"
            )

    def _confirm_number(self, words: str, wanted: float, look: Callable[[], float]) -> None:
        """Confirm a number in tenths; `words` have a place for it: "set point {:g} °C"."""
        self._confirm(words.format(tenths(wanted)), lambda: words.format(tenths(look())))


class KeptLimitsChamber(LineChamber):
    """A `LineChamber` without commands for set point limits: the driver keeps them, in °C, in tenths.

    `_own_limits_c` is the controller's own range, and `_switched_on` whether this driver switched conditioning on.
    """

    _own_limits_c = (-math.inf, math.inf)
    _limits_c = (-math.inf, math.inf)
    _switched_on = False

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Keep limits for later set points, within the controller's own range."""
        self._require_order(low_c, high_c)
        own_low_c, own_high_c = self._own_limits_c
        if low_c < own_low_c or high_c > own_high_c:
            raise InstrumentError(
                f"{self._who}: set point limits {low_c:g} to {high_c:g} °C exceed the controller's own,"
                f" {own_low_c:g} to {own_high_c:g} °C; narrow those of the bench"
            )
        self._limits_c = (tenths(low_c), tenths(high_c))

    def go_to(self, setpoint_c: float) -> None:
        """Set a set point between the limits and confirm it; the air follows within the chamber's ramp."""
        low_c = max(self._limits_c[0], self._own_limits_c[0])
        high_c = min(self._limits_c[1], self._own_limits_c[1])
        if not (math.isfinite(setpoint_c) and low_c <= tenths(setpoint_c) <= high_c):
            raise UsageError(
                f"{self._who}: set point {setpoint_c:g} °C lies outside the limits {low_c:g} to {high_c:g} °C"
            )
        self._put(tenths(setpoint_c))

    @abstractmethod
    def _put(self, setpoint_c: float) -> None: ...

    def _left(self, *, on: bool, why: str = "the chamber's panel shows why") -> tuple[str, ...]:
        """Return the alarm of a chamber that stopped by itself, if it is off although this driver switched it on."""
        if on or not self._switched_on:
            return ()
        return (f"conditioning is off although it was switched on: {why}",)


def ramp_refused(ramp_c_per_min: float | None) -> None:
    """Raise `UsageError` if a controller's own ramp is none that can be written in tenths."""
    if ramp_c_per_min is not None and not 0.1 <= ramp_c_per_min < math.inf:
        raise UsageError(f"ramp_c_per_min = {ramp_c_per_min}; give °C/min, 0.1 or more")
