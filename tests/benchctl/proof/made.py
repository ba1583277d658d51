"""Trials and answers as they would have come out."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchctl.proof.classes import ClassName
from benchctl.proof.score import score_diagnosis, score_regression
from benchctl.proof.trial import Answer, Trial
from benchctl.proof.truth import Truth
from benchctl.proof.unit import draw_unit


def truth(kind: ClassName, effects: dict[str, dict[str, float]] | None = None, **more: Any) -> Truth:
    unit = draw_unit(np.random.default_rng(5), moved=False, lacking=frozenset(), warm=True)
    return Truth(index=0, kind=kind, unit=unit, seed=1, effects=effects or {}, nonce="n", **more)


def finding(effect: str, **parameters: tuple[float, float, float]) -> dict[str, Any]:
    """A finding with parameters as (value, low, high)."""
    return {
        "effect": effect,
        "parameters": {name: {"value": v, "ci95": [low, high]} for name, (v, low, high) in parameters.items()},
        "alternatives": [],
    }


def said(*findings: dict[str, Any], verdict: str = "missing-physics", where: tuple[str, ...] = ()) -> dict[str, Any]:
    """A diagnosis as its JSON, as far as a score looks; `where` is where something is left."""
    return {
        "verdict": verdict,
        "findings": list(findings),
        "unexplained": {"significant": bool(where), "coordinates": list(where)},
        "fit": {"noise": 1e-3, "heldout_after": 1.01e-3},
    }


def trial(index: int, concealed: Truth, diagnosis: dict[str, Any], regression: tuple[str, ...] | None = None) -> Trial:
    """A finished trial."""
    generic = None
    if regression is not None:
        told = {"effects": list(regression), "heldout_ratio": 1.3}
        generic = Answer(score=score_regression(concealed, told), stated=regression, seconds=2.0, peak_bytes=2**28)
    return Trial(
        index=index,
        kind=concealed.kind,
        digest=concealed.digest(),
        truth=concealed.as_json(),
        rows=350_000,
        recorded_s=6.0,
        physics=Answer(
            score=score_diagnosis(concealed, diagnosis),
            stated=tuple(one["effect"] for one in diagnosis["findings"]),
            verdict=diagnosis["verdict"],
            unexplained=diagnosis["unexplained"]["significant"],
            coordinates=tuple(diagnosis["unexplained"]["coordinates"]),
            seconds=12.0,
            peak_bytes=2**29,
        ),
        generic=generic,
    )
