"""One finished trial, from the seal to the score, and its file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchctl.atomic import whole_file
from benchctl.documents import json_values, read_json
from benchctl.proof.classes import ClassName
from benchctl.proof.score import ParameterScore, Score
from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The answer of an arm for a recording and its score; `error` if there is no answer.

    `stated` are the effects that it named; `unexplained`: whether it found unknown structure in addition, at
    `coordinates`, and `models` are its models of that structure; `alternatives` are the look-alikes of each effect.
    """

    score: Score | None
    stated: tuple[str, ...] = ()
    verdict: str = ""
    unexplained: bool = False
    coordinates: tuple[str, ...] = ()
    models: tuple[str, ...] = ()
    alternatives: Mapping[str, Sequence[str]] = field(default_factory=dict)
    seconds: float = math.nan
    peak_bytes: int | None = None
    error: str = ""

    @property
    def right(self) -> bool:
        """Whether the answer meets the requirement of its class."""
        return self.score is not None and self.score.right


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """A finished trial; `truth` is what was sealed under `digest`; `generic` is None if that arm was left out."""

    index: int
    kind: ClassName
    digest: str
    truth: Mapping[str, Any]
    rows: int
    recorded_s: float
    physics: Answer
    generic: Answer | None

    @property
    def drawn(self) -> tuple[str, ...]:
        """The concealed effects for which a diagnosis has hypotheses."""
        return tuple(name for name in self.truth["effects"] if name not in self.truth["withheld"])

    def as_json(self) -> dict[str, Any]:
        """Return the trial as JSON data."""
        plain: dict[str, Any] = json_values(asdict(self))
        return plain


def write_trial(path: Path, trial: Trial) -> None:
    """Write the file of a trial, atomically."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(trial.as_json(), ensure_ascii=False, indent=1) + "\n", encoding="utf-8")


def read_trial(path: Path) -> Trial:
    """Read the file of a trial; raise `UsageError` if it is not one."""
    try:
        kept = read_json(path, "trial")
        return Trial(**{**kept, "physics": _answer(kept["physics"]), "generic": _answer(kept["generic"])})
    except (UsageError, ValueError, TypeError, KeyError) as err:
        raise UsageError(f"{path}: is no trial of this program's; remove it, and it is run again ({err})") from err


def _answer(kept: dict[str, Any] | None) -> Any:
    if kept is None:
        return None
    score = kept["score"]
    if score is not None:
        parameters = tuple(
            ParameterScore(**{**one, "error": math.inf if one["error"] is None else one["error"]})
            for one in score["parameters"]
        )
        score = Score(
            **{
                **score,
                "parameters": parameters,
                "missed": tuple(score["missed"]),
                "made_up": tuple(score["made_up"]),
            }
        )
    seconds = math.nan if kept["seconds"] is None else kept["seconds"]
    texts = {name: tuple(kept.get(name, ())) for name in ("stated", "coordinates", "models")}
    return Answer(**{**kept, **texts, "score": score, "seconds": seconds})
