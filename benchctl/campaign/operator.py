"""Operator actions: switch the unit's supply, mount the unit, turn a manual table, or another request; and by whom.

All questions of a plan are known before anything moves. Without an operator, a file can provide the answers. It is
TOML: each question in full, as `benchctl check` lists it, and its answer, `done` or `refuse`:

    "close the chamber's door" = "done"
    "switch the supply of unit SN-17 off" = "refuse"       # ends the run there and brings the bench to rest

A question that occurs several times has one answer. Answers to questions that do not occur are ignored.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TextIO

from benchctl.bench import Bench
from benchctl.campaign.stop import StoppedError
from benchctl.closeness import nearest
from benchctl.documents import toml_document
from benchctl.limits import cut, shown
from benchctl.plan import Ask, ConstantRate, Home, Mount, PowerCycle, Step, ThermalRamp
from benchctl.plan.steps import ByHand
from benchctl.toml_file import read_text
from benchctl_instruments.errors import SafetyError, UsageError
from benchctl_instruments.mounting import Position
from benchctl_instruments.simulated.manual import turn_by_hand
from benchctl_instruments.simulated.world import World


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """A question of a step of a plan, counted from 1."""

    step: int
    text: str


def power_question(unit: str, on: bool) -> str:
    """Return the question to switch the supply of a unit on or off."""
    return f"switch the supply of unit {unit} {'on' if on else 'off'}"


def mount_question(unit: str, position: Position) -> str:
    """Return the question to mount a unit with its input axis, or one of three axes, in a position."""
    if position != "along" and position != "across":
        axis, way = position.split()
        return f"turn unit {unit} so that its {axis} axis points {way}, then stand clear of the table"
    return f"mount unit {unit} with its input axis {position} the table's axis, then stand clear of the table"


HOME_QUESTION = "stand clear of the table, which then turns to its home mark"
STOP_QUESTION = "stop the table"


def turn_question(rate_dps: float) -> str:
    """Return the question to set a rate of a manual table [deg/s], or to stop it (0)."""
    if not rate_dps:
        return STOP_QUESTION
    way = "counter-clockwise" if rate_dps > 0 else "clockwise"
    return f"set the table to {rate_dps:+g} deg/s ({way} from above) and wait until it turns steadily"


def turned_dps(step: Step) -> float:
    """Return the constant rate of the table in a step [deg/s]."""
    return step.rate_dps if isinstance(step, ConstantRate | ThermalRamp) else 0.0


def questions(
    steps: Iterable[tuple[int, Step]], unit: str, *, may_be_off: bool = False, by_hand: bool = False
) -> Iterator[Question]:
    """Yield all questions of some steps, given with their number in the plan, in the plan's order.

    `may_be_off`: the first question is to switch the unit's supply on, as after an interrupted power cycle. `by_hand`:
    the table is a manual one.
    """
    number, turns = 0, False
    for place, (number, step) in enumerate(steps):
        if may_be_off and place == 0:
            yield Question(step=number, text=power_question(unit, True))
        rate_dps = turned_dps(step) if by_hand else 0.0
        if rate_dps or turns:
            yield Question(step=number, text=turn_question(rate_dps))
        turns = bool(rate_dps)
        match step:
            case PowerCycle():
                yield Question(step=number, text=power_question(unit, False))
                yield Question(step=number, text=power_question(unit, True))
            case Mount():
                yield Question(step=number, text=mount_question(unit, step.position))
            case Ask():
                yield Question(step=number, text=step.says)
            case Home():
                yield Question(step=number, text=HOME_QUESTION)
    if turns:
        yield Question(step=number, text=STOP_QUESTION)


Meanwhile = Callable[[], None]
"""Called repeatedly until the operator confirms; an exception from it ends the waiting."""


class Operator(Protocol):
    """Performs operator actions; each method returns when done. `who` names the person; empty if there is none."""

    who: str

    def power(self, on: bool, meanwhile: Meanwhile) -> None:
        """Switch the unit's supply."""

    def mount(self, position: Position, meanwhile: Meanwhile) -> None:
        """Mount the unit in a position."""

    def turn(self, rate_dps: float, meanwhile: Meanwhile) -> None:
        """Set the rate of a manual table [deg/s], positive counter-clockwise from above, or stop it (0)."""

    def ask(self, text: str, meanwhile: Meanwhile) -> None:
        """Perform the requested action."""


class NoOperator:
    """No operator: a plan that needs one is refused."""

    who = ""

    def power(self, on: bool, meanwhile: Meanwhile) -> None:
        """Raise `SafetyError`."""
        raise SafetyError(
            f"the unit's supply must be switched {'on' if on else 'off'} by an operator; run it at a terminal"
        )

    def mount(self, position: Position, meanwhile: Meanwhile) -> None:
        """Raise `SafetyError`."""
        raise SafetyError(f"the unit must be mounted {position} by an operator; run it at a terminal")

    def turn(self, rate_dps: float, meanwhile: Meanwhile) -> None:
        """Raise `SafetyError`."""
        raise SafetyError(f"an operator must {turn_question(rate_dps)}; run it at a terminal")

    def ask(self, text: str, meanwhile: Meanwhile) -> None:
        """Raise `SafetyError`."""
        raise SafetyError(f"an operator must {text}; run it at a terminal")


MANUAL_RATE_ERROR = 0.03
"""Relative error of the rates that the simulated operator sets, too high and too low in turn."""


class SimulatedOperator:
    """Operator actions on a simulated bench in this process; only those on a manual table take time."""

    who = "the simulated bench"

    def __init__(self, world: World) -> None:
        self._world, self._error = world, MANUAL_RATE_ERROR

    def power(self, on: bool, meanwhile: Meanwhile) -> None:
        """Switch the supply of the simulated gyro."""
        self._world.power(on)

    def mount(self, position: Position, meanwhile: Meanwhile) -> None:
        """Mount the simulated gyro."""
        self._world.mount(position)

    def turn(self, rate_dps: float, meanwhile: Meanwhile) -> None:
        """Turn the simulated table after a while, at nearly that rate."""
        meanwhile()
        turn_by_hand(self._world.table, rate_dps * (1.0 + self._error))
        self._error = -self._error

    def ask(self, text: str, meanwhile: Meanwhile) -> None:
        """Do nothing: the simulated bench has neither door nor cable."""


class TerminalOperator:
    """An operator at the terminal, who reads instructions on stderr and answers on stdin: Enter when done, or refuse.

    Raises `StoppedError` if the operator refuses, `SafetyError` if the terminal closes before the answer.
    """

    def __init__(self, unit: str, operator: str = "") -> None:
        self.who = f"{operator}, at the terminal" if operator else "the operator at the terminal"
        self._unit = unit

    def power(self, on: bool, meanwhile: Meanwhile) -> None:
        """Ask the operator to switch the supply."""
        _ask(power_question(self._unit, on), meanwhile)

    def mount(self, position: Position, meanwhile: Meanwhile) -> None:
        """Ask the operator to mount the unit."""
        _ask(mount_question(self._unit, position), meanwhile)

    def turn(self, rate_dps: float, meanwhile: Meanwhile) -> None:
        """Ask the operator to set the rate."""
        _ask(turn_question(rate_dps), meanwhile, at_rest=False)

    def ask(self, text: str, meanwhile: Meanwhile) -> None:
        """Ask the operator to perform the requested action."""
        _ask(text, meanwhile)


def operator_at_terminal(bench: Bench) -> Operator:
    """Return the operator of a bench if stdin and stderr are a terminal, else `NoOperator`."""
    if _is_terminal(sys.stdin) and _is_terminal(sys.stderr):
        return TerminalOperator(bench.unit.serial, bench.operator)
    return NoOperator()


def request_turn(rate_dps: float) -> None:
    """Request a rate of a manual table, or a stop, on stderr, without waiting for an answer."""
    warning = "" if rate_dps else " NOW: only the operator can; benchctl waits until the encoder shows it at rest"
    say(f"{turn_question(rate_dps)}{warning}")


def require_operator(
    procedure: str, steps: Iterable[tuple[int, Step]], operator: Operator, *, by_hand: bool = False
) -> None:
    """Raise `UsageError` if a step, given with its number in the plan, needs an operator and there is none.

    `by_hand` is as for `questions`.
    """
    for number, step in steps:
        if (isinstance(step, ByHand) or (by_hand and turned_dps(step))) and not operator.who:
            raise UsageError(
                f"procedure {procedure}, step {number}: {step.label}: needs an operator, and there is none; run it "
                "at a terminal (stdin and stderr), with --answers FILE, or on a bench with simulated = true; benchctl "
                "check lists the questions"
            )


def _is_terminal(stream: TextIO | None) -> bool:
    return stream is not None and not stream.closed and stream.isatty()


_DONE = {b"", b"done", b"ok", b"y", b"yes"}
_REFUSED = {b"refuse", b"n", b"no"}


def _ask(what: str, meanwhile: Meanwhile, *, at_rest: bool = True) -> None:
    """Print what to do and wait until the operator confirms; repeat the prompt after an unknown answer."""
    terminal = sys.stdin.fileno()
    _forget_typed(terminal)
    where = "the table is at rest: " if at_rest else ""
    say(f"{where}{what}; then press Enter. (To end the run instead, type refuse.)")
    while (answer := _answered(terminal, what, meanwhile)) not in _DONE:
        if answer in _REFUSED:
            raise StoppedError(f"stopped by the operator at the terminal: refused to {what}")
        say("press Enter once it is done, or type refuse and press Enter.")


def say(text: str) -> None:
    """Print a line to the operator on stderr."""
    with contextlib.suppress(OSError):  # a closed terminal gives no answer either
        sys.stderr.write(f"benchctl: {text}\n")
        sys.stderr.flush()


def _answered(terminal: int, what: str, meanwhile: Meanwhile) -> bytes:
    answer = _Answer(terminal)
    while not answer.came:
        meanwhile()
    if answer.lost:
        raise SafetyError(
            f"prompted the operator: {what}; the terminal was closed before an answer; open another, then run again"
        )
    return answer.line.strip().lower()


class _Answer:
    """A line from the terminal, read in a separate thread.

    It bypasses Python's buffer: a thread that still waits there when the program ends would hold the buffer's lock.
    """

    def __init__(self, terminal: int) -> None:
        self.lost = False
        self.line = b""
        self._terminal = terminal
        self._reader = threading.Thread(target=self._read, name="operator's answer", daemon=True)
        self._reader.start()

    @property
    def came(self) -> bool:
        """Whether there is an answer, or none can come any more."""
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
    """Discard what was typed before the question: an earlier Enter is not an answer."""
    try:
        import termios
    except ImportError:  # Windows
        return
    termios.tcflush(terminal, termios.TCIFLUSH)


DONE, REFUSE = "done", "refuse"


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """The answers in a file, by question."""

    path: Path
    by_question: Mapping[str, str]

    def refuse_unanswered(self, expected: Iterable[Question]) -> None:
        """Raise `UsageError` if a question has no answer; it lists all such questions as lines for the file."""
        without = list(dict.fromkeys(one.text for one in expected if one.text not in self.by_question))
        if not without:
            return
        close = nearest(without[0], self.by_question)
        hint = f" (for the first there is only {shown(close)})" if close else ""
        lines = ", ".join(answer_line(question) for question in without)
        raise UsageError(
            f"answers {self.path}: {len(without)} of the plan's questions have no answer{hint}; add {lines}, a line "
            "each, or refuse in the place of done"
        )


class Answering(ABC):
    """Answers from elsewhere than a terminal; on a bench simulated in this process, `then` performs the actions.

    Raises `StoppedError` if the answer refuses.
    """

    def __init__(self, who: str, unit: str, then: Operator | None) -> None:
        self.who = who
        self._unit, self._then = unit, then

    @abstractmethod
    def _answer(self, text: str, meanwhile: Meanwhile) -> None:
        """Return once the question is answered by `DONE`; raise `StoppedError` if it is refused."""

    def power(self, on: bool, meanwhile: Meanwhile) -> None:
        """Switch the unit's supply, or end the run."""
        self._answer(power_question(self._unit, on), meanwhile)
        if self._then is not None:
            self._then.power(on, meanwhile)

    def mount(self, position: Position, meanwhile: Meanwhile) -> None:
        """Mount the unit, or end the run."""
        self._answer(mount_question(self._unit, position), meanwhile)
        if self._then is not None:
            self._then.mount(position, meanwhile)

    def turn(self, rate_dps: float, meanwhile: Meanwhile) -> None:
        """Set the rate, or end the run; what somebody has to do now is printed on stderr."""
        self._answer(turn_question(rate_dps), meanwhile)
        if self._then is None:
            say(turn_question(rate_dps))
        else:
            self._then.turn(rate_dps, meanwhile)

    def ask(self, text: str, meanwhile: Meanwhile) -> None:
        """Perform the requested action, or end the run."""
        self._answer(text, meanwhile)
        if self._then is not None:
            self._then.ask(text, meanwhile)


class AnswerFile(Answering):
    """Answers from a file in place of an operator."""

    def __init__(self, answers: Answers, unit: str, then: Operator | None) -> None:
        super().__init__(f"the answers of {answers.path}", unit, then)
        self._by_question = answers.by_question

    def _answer(self, text: str, meanwhile: Meanwhile) -> None:
        if self._by_question.get(text) != DONE:
            raise StoppedError(f"stopped by {self.who}: refused to {text}")


def read_answers(path: Path) -> Answers:
    """Read a file of answers.

    Raises
    ------
    UsageError
        The file cannot be read, is not TOML, or contains an answer other than done or refuse.
    """
    found = toml_document(read_text(path, "answers"), f"answers {path}")
    for question, answer in found.items():
        if answer not in (DONE, REFUSE):
            raise UsageError(f'answers {path}: {cut(question)}: expected "{DONE}" or "{REFUSE}", got {shown(answer)}')
    return Answers(path=path, by_question=found)


def answer_line(text: str) -> str:
    """Return a question as a line of a file of answers, answered with `done`."""
    return f'{json.dumps(text, ensure_ascii=False)} = "{DONE}"'
