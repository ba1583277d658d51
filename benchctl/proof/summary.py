"""Summarize a proof: by class, over all trials, and in comparison with the sparse regression."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from benchctl.proof.classes import CLASSES, ClassName
from benchctl.proof.confusion import Confusion, confusion
from benchctl.proof.trial import Answer, Trial

NEAR, NEARER = 0.25, 0.10
SIZED: frozenset[ClassName] = frozenset({"single", "pair", "triple", "wandering", "wandering+one"})
"""Classes of full size; only there is the error of a parameter dominated by more than noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """A count out of a total."""

    count: int
    of: int

    @property
    def value(self) -> float | None:
        """The share, from 0 to 1; None if the total is 0."""
        return self.count / self.of if self.of else None

    def __str__(self) -> str:
        return f"{self.count} of {self.of}"

    def as_json(self) -> dict[str, Any]:
        """Return the share as JSON data."""
        return {"count": self.count, "of": self.of, "share": self.value}


@dataclass(frozen=True, slots=True, kw_only=True)
class ClassRow:
    """A class of trials: right answers and verdicts, missed effects and false positives."""

    kind: ClassName
    right: Share
    verdict: Share
    missed: int
    made_up: int
    generic: Share | None
    generic_made_up: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmFigures:
    """The figures of an arm over all trials.

    Attributes
    ----------
    named
        Drawn effects that were named, out of those that a diagnosis can name.
    false_alarms
        Trials without effects, with or without moved coefficients, in which something was named.
    made_up
        Effects in all trials that were named but not drawn.
    held_out
        Median of the held-out residual over the noise.
    near, nearer, inside_ci95
        Parameters of correctly named effects of full size within a quarter and a tenth of the truth; parameters of all
        correctly named effects inside their own 95 % interval.
    seconds, peak_bytes
        Median time of an answer; largest peak memory.
    silent
        Trials without an answer.
    """

    named: Share
    false_alarms: Share
    made_up: int
    held_out: float | None
    near: Share
    nearer: Share
    inside_ci95: Share
    seconds: float | None
    peak_bytes: int | None
    silent: int

    def as_json(self) -> dict[str, Any]:
        """Return the figures as JSON data."""
        return {
            "named": self.named.value,
            "false_alarms": self.false_alarms.value,
            "held_out": self.held_out,
            "named_count": self.named.as_json(),
            "false_alarms_count": self.false_alarms.as_json(),
            "made_up": self.made_up,
            "parameters": {
                "within_25_percent": self.near.as_json(),
                "within_10_percent": self.nearer.as_json(),
                "inside_ci95": self.inside_ci95.as_json(),
            },
            "median_s": self.seconds,
            "peak_bytes": self.peak_bytes,
            "silent": self.silent,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """A proof: its trials in the order of their numbers, and their summary."""

    seed: int
    trials: tuple[Trial, ...]
    classes: tuple[ClassRow, ...]
    physics: ArmFigures
    generic: ArmFigures | None
    confusion: Confusion
    generic_confusion: Confusion | None

    def as_json(self) -> dict[str, Any]:
        """Return the data of `--json`."""
        return {
            "seed": self.seed,
            "trials": len(self.trials),
            **self.physics.as_json(),
            "generic": None if self.generic is None else {"trials": len(self.trials), **self.generic.as_json()},
            "classes": [_class_json(row) for row in self.classes],
            "confusion": self.confusion.as_json(),
            "generic_confusion": None if self.generic_confusion is None else self.generic_confusion.as_json(),
            "digests": [trial.digest for trial in self.trials],
        }


def summarize(seed: int, trials: Sequence[Trial]) -> Summary:
    """Summarize the trials of a proof, one or more."""
    ordered = tuple(sorted(trials, key=lambda trial: trial.index))
    compared = all(trial.generic is not None for trial in ordered)
    return Summary(
        seed=seed,
        trials=ordered,
        classes=tuple(_row(kind, ordered, compared) for kind in CLASSES if any(t.kind == kind for t in ordered)),
        physics=_figures(ordered, _physics),
        generic=_figures(ordered, _generic) if compared else None,
        confusion=confusion(ordered, _physics),
        generic_confusion=confusion(ordered, _generic) if compared else None,
    )


def _physics(trial: Trial) -> Answer | None:
    return trial.physics


def _generic(trial: Trial) -> Answer | None:
    return trial.generic


def _row(kind: ClassName, trials: Sequence[Trial], compared: bool) -> ClassRow:
    mine = [trial for trial in trials if trial.kind == kind]
    scores = [trial.physics.score for trial in mine if trial.physics.score is not None]
    others = [trial.generic.score for trial in mine if trial.generic is not None and trial.generic.score is not None]
    return ClassRow(
        kind=kind,
        right=Share(count=sum(trial.physics.right for trial in mine), of=len(mine)),
        verdict=Share(count=sum(bool(score.verdict_right) for score in scores), of=len(mine)),
        missed=sum(len(score.missed) for score in scores),
        made_up=sum(len(score.made_up) for score in scores),
        generic=Share(count=sum(score.right for score in others), of=len(mine)) if compared else None,
        generic_made_up=sum(len(score.made_up) for score in others),
    )


def _figures(trials: Sequence[Trial], answer: Callable[[Trial], Answer | None]) -> ArmFigures:
    pairs = [(trial, found) for trial in trials if (found := answer(trial)) is not None]
    scored = [(trial, found, found.score) for trial, found in pairs if found.score is not None]
    drawn = sum(len(trial.drawn) for trial, _ in pairs)
    named = sum(len(set(trial.drawn) - set(score.missed)) for trial, _, score in scored)
    empty = [found for trial, found in pairs if not trial.truth["effects"]]
    parameters = [(trial.kind in SIZED, one) for trial, _, score in scored for one in score.parameters]
    sized = [one for full, one in parameters if full]
    ratios = [score.heldout_ratio for _, _, score in scored if score.heldout_ratio is not None]
    peaks = [found.peak_bytes for _, found, _ in scored if found.peak_bytes is not None]
    return ArmFigures(
        named=Share(count=named, of=drawn),
        false_alarms=Share(count=sum(bool(found.stated) for found in empty), of=len(empty)),
        made_up=sum(len(score.made_up) for _, _, score in scored),
        held_out=statistics.median(ratios) if ratios else None,
        near=Share(count=sum(one.within(NEAR) for one in sized), of=len(sized)),
        nearer=Share(count=sum(one.within(NEARER) for one in sized), of=len(sized)),
        inside_ci95=Share(count=sum(one.inside_ci95 for _, one in parameters), of=len(parameters)),
        seconds=statistics.median(found.seconds for _, found, _ in scored) if scored else None,
        peak_bytes=max(peaks, default=None),
        silent=len(pairs) - len(scored),
    )


def _class_json(row: ClassRow) -> dict[str, Any]:
    return {
        "class": row.kind,
        "says": CLASSES[row.kind].title,
        "right": row.right.as_json(),
        "verdict_right": row.verdict.as_json(),
        "missed": row.missed,
        "made_up": row.made_up,
        "generic_right": None if row.generic is None else row.generic.as_json(),
        "generic_made_up": None if row.generic is None else row.generic_made_up,
    }
