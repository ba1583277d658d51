"""The classes of trials: what each conceals, and how many trials of each are run."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from benchctl.closeness import meant
from benchctl.diagnosis.result import Part, Verdict
from benchctl_instruments.errors import UsageError

ClassName = Literal[
    "nothing",
    "moved",
    "single",
    "quarter",
    "tenth",
    "faint",
    "pair",
    "triple",
    "wandering",
    "wandering+one",
    "outsider",
    "structure",
    "structure+one",
    "structure+wandering",
    "structure-faint",
    "drive",
    "drive-structure",
    "chamber",
    "chamber-structure",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialClass:
    """A class of trials.

    Attributes
    ----------
    title
        What it conceals, as text for reports.
    verdict
        The correct verdict of a diagnosis.
    weight
        Number of trials in a proof of the usual size.
    effects
        Number of effects of the vocabulary that are concealed, in addition to a wandering bias.
    share
        Their size, as a share of the full size; None: the size at which their gain is `FAINT_GAIN`.
    wandering
        Whether the bias wanders.
    structure
        Whether a structure without a name is concealed, too; such classes run only on request.
    """

    title: str
    verdict: Verdict
    weight: int
    effects: int = 0
    share: float | None = 1.0
    wandering: bool = False
    structure: bool = False
    part: Part = "gyro"

    @property
    def usual(self) -> bool:
        """Whether the class belongs to a proof that names no classes."""
        return not self.structure and self.part == "gyro"


FAINT_GAIN = 200.0
"""Gain of a faint effect, in twice the log likelihood."""

CLASSES: MappingProxyType[ClassName, TrialClass] = MappingProxyType(
    {
        "nothing": TrialClass(title="nothing missing", verdict="consistent", weight=100),
        "moved": TrialClass(title="coefficients moved only", verdict="recalibrate", weight=24),
        "single": TrialClass(title="single effects", verdict="missing-physics", weight=60, effects=1),
        "quarter": TrialClass(
            title="a quarter of the size", verdict="missing-physics", weight=24, effects=1, share=0.25
        ),
        "tenth": TrialClass(title="a tenth of the size", verdict="missing-physics", weight=24, effects=1, share=0.1),
        "faint": TrialClass(title="faint", verdict="missing-physics", weight=24, effects=1, share=None),
        "pair": TrialClass(title="pairs", verdict="missing-physics", weight=20, effects=2),
        "triple": TrialClass(title="triples", verdict="missing-physics", weight=12, effects=3),
        "wandering": TrialClass(title="wandering bias only", verdict="missing-physics", weight=16, wandering=True),
        "wandering+one": TrialClass(
            title="wandering bias and one effect", verdict="missing-physics", weight=16, effects=1, wandering=True
        ),
        "outsider": TrialClass(title="its own hypothesis withheld", verdict="unknown-structure", weight=20, effects=1),
        "structure": TrialClass(
            title="a structure without a name", verdict="unknown-structure", weight=40, structure=True
        ),
        "structure+one": TrialClass(
            title="a structure and one effect", verdict="missing-physics", weight=20, effects=1, structure=True
        ),
        "structure+wandering": TrialClass(
            title="a structure and a wandering bias",
            verdict="missing-physics",
            weight=20,
            wandering=True,
            structure=True,
        ),
        "structure-faint": TrialClass(
            title="a faint structure", verdict="unknown-structure", weight=20, share=None, structure=True
        ),
        "drive": TrialClass(
            title="up to two effects of a drive", verdict="missing-physics", weight=20, effects=2, part="drive"
        ),
        "drive-structure": TrialClass(
            title="a torque without a name, alone or with one effect of a drive",
            verdict="unknown-structure",
            weight=20,
            structure=True,
            part="drive",
        ),
        "chamber": TrialClass(
            title="up to two effects of a chamber", verdict="missing-physics", weight=20, effects=2, part="chamber"
        ),
        "chamber-structure": TrialClass(
            title="heat without a name, alone or with one effect of a chamber",
            verdict="unknown-structure",
            weight=20,
            structure=True,
            part="chamber",
        ),
    }
)

USUAL_TRIALS = sum(kind.weight for kind in CLASSES.values() if kind.usual)


def class_names(names: Collection[str]) -> tuple[ClassName, ...]:
    """Return the classes with these names, in the order of `CLASSES`; raise `UsageError` for an unknown name."""
    for name in names:
        if name not in CLASSES:
            raise UsageError(f"class {name!r}: there is no such class of trials; {meant(name, CLASSES)}")
    return tuple(name for name in CLASSES if name in names)


def allotted(trials: int, only: Collection[str] = ()) -> tuple[ClassName, ...]:
    """Return the class of each trial, in proportion to the weights and spread evenly: any first part is a fair sample.

    A longer list for the same classes begins with the shorter one. `only` names the classes; if it is empty, the usual
    ones are used.
    """
    chosen = {name: kind.weight for name, kind in CLASSES.items() if (name in only if only else kind.usual)}
    total = sum(chosen.values())
    given = dict.fromkeys(chosen, 0)
    order: list[ClassName] = []
    for count in range(1, trials + 1):
        name = max(chosen, key=lambda each: chosen[each] * count / total - given[each])
        given[name] += 1
        order.append(name)
    return tuple(order)
