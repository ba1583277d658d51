"""What a plan asks of a person, in the words in which it is asked; all of it is known before anything moves."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from benchctl.plan import Ask, Mount, PowerCycle, Step
from benchctl_instruments.mounting import Position


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """What is asked in a step of a plan, counted from 1."""

    step: int
    says: str


def power_question(unit: str, on: bool) -> str:
    """To switch the supply of a unit."""
    return f"switch the supply of unit {unit} {'on' if on else 'off'}"


def mount_question(unit: str, position: Position) -> str:
    """To mount a unit with its input axis along or across the table's axis."""
    return f"mount unit {unit} with its input axis {position} the table's axis, then stand clear of the table"


def questions(steps: Iterable[tuple[int, Step]], unit: str, *, may_be_off: bool = False) -> Iterator[Question]:
    """Everything that is asked in some steps, given with their number in the plan, in its order.

    `may_be_off`: before the first of them the unit's supply is asked for, as where a power cycle was broken off.
    """
    for place, (number, step) in enumerate(steps):
        if may_be_off and place == 0:
            yield Question(step=number, says=power_question(unit, True))
        match step:
            case PowerCycle():
                yield Question(step=number, says=power_question(unit, False))
                yield Question(step=number, says=power_question(unit, True))
            case Mount():
                yield Question(step=number, says=mount_question(unit, step.position))
            case Ask():
                yield Question(step=number, says=step.says)
