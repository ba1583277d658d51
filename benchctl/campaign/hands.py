"""Who does what no instrument of the bench can: switch the unit's supply, mount the unit, whatever a plan asks for."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Callable, Iterable
from typing import Protocol, TextIO

from benchctl.bench import Bench
from benchctl.campaign.questions import mount_question, power_question
from benchctl.campaign.stop import StoppedError
from benchctl.plan import Step
from benchctl.plan.steps import ByHand
from benchctl_instruments.errors import SafetyError, UsageError
from benchctl_instruments.mounting import Position
from benchctl_instruments.simulated.world import World

Meanwhile = Callable[[], None]
"""Called over and over until somebody says that it is done; what it raises ends the waiting."""


class Hands(Protocol):
    """Somebody who touches the unit; each method returns once it is done. `who` they are; empty: nobody is there."""

    who: str

    def power(self, on: bool, meanwhile: Meanwhile) -> None:
        """Switch the unit's supply."""

    def mount(self, position: Position, meanwhile: Meanwhile) -> None:
        """Mount the unit with its input axis along or across the table's axis."""

    def ask(self, says: str, meanwhile: Meanwhile) -> None:
        """Do what is asked."""


class NoHands:
    """Nobody: a plan that needs somebody is refused."""

    who = ""

    def power(self, on: bool, meanwhile: Meanwhile) -> None:
        """Raises `SafetyError`."""
        raise SafetyError(
            f"the unit's supply was to be switched {'on' if on else 'off'}, and nobody is there; run it at a terminal"
        )

    def mount(self, position: Position, meanwhile: Meanwhile) -> None:
        """Raises `SafetyError`."""
        raise SafetyError(f"the unit was to be mounted {position}, and nobody is there; run it at a terminal")

    def ask(self, says: str, meanwhile: Meanwhile) -> None:
        """Raises `SafetyError`."""
        raise SafetyError(f"somebody was asked to {says}, and nobody is there; run it at a terminal")


class SimulatedHands:
    """Those of a simulated bench in this process; they take no time."""

    who = "the simulated bench"

    def __init__(self, world: World) -> None:
        self._world = world

    def power(self, on: bool, meanwhile: Meanwhile) -> None:
        """Switch the supply of the simulated gyro."""
        self._world.power(on)

    def mount(self, position: Position, meanwhile: Meanwhile) -> None:
        """Mount the simulated gyro."""
        self._world.mount(position)

    def ask(self, says: str, meanwhile: Meanwhile) -> None:
        """Nothing: the simulated bench has neither door nor cable."""


class OperatorHands:
    """Somebody at the terminal, who reads on stderr what to do and answers on stdin: Enter once it is done, or refuse.

    `StoppedError` where they refuse, `SafetyError` where the terminal goes away before the answer.
    """

    def __init__(self, unit: str, operator: str = "") -> None:
        self.who = f"{operator}, at the terminal" if operator else "the operator at the terminal"
        self._unit = unit

    def power(self, on: bool, meanwhile: Meanwhile) -> None:
        """Ask for the supply to be switched."""
        _ask(power_question(self._unit, on), meanwhile)

    def mount(self, position: Position, meanwhile: Meanwhile) -> None:
        """Ask for the unit to be mounted."""
        _ask(mount_question(self._unit, position), meanwhile)

    def ask(self, says: str, meanwhile: Meanwhile) -> None:
        """Ask for whatever it is."""
        _ask(says, meanwhile)


def hands_at_the_terminal(bench: Bench) -> Hands:
    """The operator of a bench where stdin and stderr are a terminal, else nobody."""
    if _is_terminal(sys.stdin) and _is_terminal(sys.stderr):
        return OperatorHands(bench.unit.serial, bench.operator)
    return NoHands()


def refuse_without_hands(procedure: str, steps: Iterable[tuple[int, Step]], hands: Hands) -> None:
    """Raise `UsageError` where a step, given with its number in the plan, needs somebody and nobody is there."""
    for number, step in steps:
        if isinstance(step, ByHand) and not hands.who:
            raise UsageError(
                f"procedure {procedure}, step {number}: {step.label}: somebody has to do it by hand, and nobody can be "
                "asked; run it at a terminal (stdin and stderr), with --answers FILE, or on a bench with simulated = "
                "true; benchctl check lists the questions"
            )


def _is_terminal(stream: TextIO | None) -> bool:
    return stream is not None and not stream.closed and stream.isatty()


_DONE = {b"", b"done", b"ok", b"y", b"yes"}
_REFUSED = {b"refuse", b"n", b"no"}


def _ask(what: str, meanwhile: Meanwhile) -> None:
    """Say what to do and wait until somebody says that it is done; what is neither that nor a refusal is asked back."""
    terminal = sys.stdin.fileno()
    _forget_typed(terminal)
    _say(f"the table is at rest: {what}; then press Enter. (To end the run instead, type refuse.)")
    while (answer := _answered(terminal, what, meanwhile)) not in _DONE:
        if answer in _REFUSED:
            raise StoppedError(f"stopped by the operator at the terminal: refused to {what}")
        _say("press Enter once it is done, or type refuse and press Enter.")


def _say(text: str) -> None:
    with contextlib.suppress(OSError):  # a terminal that is gone gives no answer either
        sys.stderr.write(f"benchctl: {text}\n")
        sys.stderr.flush()


def _answered(terminal: int, what: str, meanwhile: Meanwhile) -> bytes:
    answer = _Answer(terminal)
    while not answer.came:
        meanwhile()
    if answer.lost:
        raise SafetyError(
            f"asked an operator: {what}; the terminal went away before anybody had answered; "
            "open another, then run again"
        )
    return answer.line.strip().lower()


class _Answer:
    """A line from the terminal, read in a thread of its own.

    It reads past Python's buffer: a thread that still waits in that when the program ends would hold its lock.
    """

    def __init__(self, terminal: int) -> None:
        self.lost = False
        self.line = b""
        self._terminal = terminal
        self._reader = threading.Thread(target=self._read, name="operator's answer", daemon=True)
        self._reader.start()

    @property
    def came(self) -> bool:
        """Whether there is an answer, or there will be none."""
        return not self._reader.is_alive()

    def _read(self) -> None:
        try:
            while not self.line.endswith(b"\n"):
                typed = os.read(self._terminal, 4096)
                if not typed:
                    self.lost = True
                    return
                self.line += typed
        except OSError:
            self.lost = True


def _forget_typed(terminal: int) -> None:
    """Drop what was typed before the question: an Enter among it is no answer."""
    try:
        import termios
    except ImportError:  # Windows
        return
    termios.tcflush(terminal, termios.TCIFLUSH)
