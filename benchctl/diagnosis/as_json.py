"""A diagnosis as the JSON that other programs rely on (`benchctl-diagnosis/2`).

Numbers are rounded so far that the last bits of a sum, which depend on the machine, do not show: an estimate to a
thousandth of its interval, all others to six significant digits. There are no times and no paths in it: the same
recording and the same seed give the same text.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import benchctl
from benchctl.diagnosis.result import SCHEMA, Diagnosis, Estimate, Finding, NotFound, StepFigures, StructureModel, Where

_DIGITS = 6
_DIGITS_OF_AN_INTERVAL = 3


def as_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """Plain data: numbers, texts, lists and mappings; what is not finite is None."""
    unexplained, following = diagnosis.unexplained, diagnosis.next_experiment
    return {
        "schema": SCHEMA,
        "recording": diagnosis.recording,
        "software": {"benchctl": benchctl.__version__},
        "part": diagnosis.part,
        "verdict": diagnosis.verdict,
        "says": diagnosis.says,
        "baseline": {"parameters": _estimates(diagnosis.baseline)},
        "findings": [_finding(finding) for finding in diagnosis.findings],
        "unexplained": {
            "significant": bool(unexplained.significant),
            "share": _rounded(unexplained.share),
            "coordinates": list(unexplained.coordinates),
            "says": unexplained.says,
            **({"model": _model(unexplained.models[0])} if unexplained.models else {}),
            **({"further": [_model(one) for one in unexplained.models[1:]]} if unexplained.models[1:] else {}),
        },
        "fit": {
            "unit": diagnosis.fit.unit,
            **{
                name: _rounded(getattr(diagnosis.fit, name))
                for name in ("noise", "before", "after", "heldout_before", "heldout_named", "heldout_after")
            },
        },
        "next_experiment": {
            "says": following.says,
            "procedure": following.procedure,
            "parameters": _plain(following.parameters),
            "separates": list(following.separates),
            "separation": _rounded(following.separation),
        },
        "not_found": [_not_found(one) for one in diagnosis.not_found],
        "steps": [_step(one) for one in diagnosis.steps],
        "notes": list(diagnosis.notes),
        "threshold": _rounded(diagnosis.threshold),
        "seed": int(diagnosis.seed),
    }


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "effect": finding.effect,
        "probability": _rounded(finding.probability),
        "parameters": _estimates(finding.parameters),
        "where": _where(finding.where),
        "explains": _rounded(finding.explains),
        "gain": _rounded(finding.gain),
        "gain_heldout": _rounded(finding.gain_heldout),
        "says": finding.says,
        "alternatives": [
            {"effect": other.effect, "probability": _rounded(other.probability), "loss": _rounded(other.loss)}
            for other in finding.alternatives
        ],
    }


def _model(one: StructureModel) -> dict[str, Any]:
    return {
        "name": one.identifier,
        "stage": one.stage,
        "coordinates": list(one.coordinates),
        "shape": one.shape,
        "formula": one.formula,
        "parameters": _estimates(one.parameters),
        "explains": _rounded(one.explains),
        "says": one.says,
        "hints": list(one.hints),
    }


def _where(where: Where) -> dict[str, Any]:
    return {
        "coordinate": where.coordinate,
        "ranges": [[_rounded(low), _rounded(high)] for low, high in where.ranges],
        "steps": list(where.steps),
        "share_of_excess": _rounded(where.share_of_excess),
    }


def _estimates(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: _estimate(estimate) for name, estimate in estimates.items()}


def _estimate(estimate: Estimate) -> dict[str, Any]:
    width = estimate.high - estimate.low
    told = {
        "value": _rounded(estimate.value, width),
        "ci95": [_rounded(estimate.low, width), _rounded(estimate.high, width)],
        "unit": estimate.unit,
    }
    return told if estimate.was is None else {**told, "was": _rounded(estimate.was, width)}


def _not_found(one: NotFound) -> dict[str, Any]:
    return {
        "effect": one.effect,
        "parameter": one.parameter,
        "would_show_from": {"value": _rounded(one.smallest), "unit": one.unit},
        "injected": True,
        "others": {name: _rounded(value) for name, value in one.others.items()},
    }


def _step(one: StepFigures) -> dict[str, Any]:
    return {
        "name": one.name,
        "kind": one.kind,
        "t_start": _rounded(one.t_start),
        "t_end": _rounded(one.t_end),
        "heldout": bool(one.heldout),
        "as_it_came": _rounded(one.as_it_came),
        "before": _rounded(one.before),
        "after": _rounded(one.after),
    }


def _plain(value: Any) -> Any:
    """Parameters of a procedure: numbers, texts, flags, and sequences of them."""
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if isinstance(value, bool | int | str) or value is None else _rounded(value)


def _rounded(value: float | None, width: float = 0.0) -> float | None:
    """A plain float to six significant digits; to three of `width` where that is more; None where not finite."""
    if value is None or not math.isfinite(value):
        return None
    value = float(value)
    digits = _DIGITS
    if value and math.isfinite(width) and width > 0:
        digits = max(digits, _order(value) - _order(width) + _DIGITS_OF_AN_INTERVAL)
    return float(f"{value:.{min(digits, 15)}g}") + 0.0


def _order(value: float) -> int:
    return math.floor(math.log10(abs(value)))
