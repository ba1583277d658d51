"""The acceptance for programs: every number unrounded, every sentence in English."""

from __future__ import annotations

import math
from typing import Any

from benchctl.metrology.result import Acceptance, Judged, Limit, Uncertainty
from benchctl.reports.acceptance.build import tally
from benchctl.reports.acceptance.catalogue import Catalogue, catalogue
from benchctl.reports.acceptance.recording_facts import RecordingFacts
from benchctl.reports.acceptance.values import stated

SCHEMA = "benchctl-acceptance/1"


def values(acceptance: Acceptance, facts: RecordingFacts) -> dict[str, Any]:
    """What `--json` says of an acceptance.

    Of each test `uncertainty` is expanded (95.45 %, `k` times the combined `standard`; `dof` null: infinite), and
    `stated` is the value with it as the report prints it.
    """
    words = catalogue("en")
    names = {info.index: info.name for info in facts.infos}
    return {
        "verdict": acceptance.verdict,
        "tally": tally(acceptance, words),
        "tests": [_test(one, acceptance, names, words) for one in acceptance.judged],
        "unit_under_test": {"serial": facts.meta.unit.serial, "model": facts.meta.unit.model},
        "started_utc": facts.meta.provenance.get("started_utc", ""),
        "stage": acceptance.papers.stage,
        "limits": {
            "file": acceptance.limits_name,
            "sha256": acceptance.limits_sha256,
            "text": acceptance.limits_text,
        },
        "rule": {"guard": acceptance.rule.guard, "says": words.said(acceptance.rule.says)},
        "recording": str(facts.path),
        "recording_digest": facts.digest,
        "anomalies": [words.said(one) for one in acceptance.anomalies],
    }


def _test(one: Judged, acceptance: Acceptance, names: dict[int, str], words: Catalogue) -> dict[str, Any]:
    measured = one.measured
    return {
        "name": measured.name,
        "value": _finite(measured.value),
        "unit": measured.unit,
        "stated": stated(measured, words),
        "limit": _limit(one.limit),
        "verdict": one.verdict,
        "remedy": words.said(one.remedy) if one.remedy else "",
        "bound": measured.bound,
        "refused": words.said(measured.refused) if measured.refused else "",
        "notes": [words.said(note) for note in measured.notes],
        "temperature_c": _finite(measured.temperature_c),
        "steps": [
            {"index": index, "name": names.get(index, ""), "digest": acceptance.step_digests.get(index, "")}
            for index in measured.steps
        ],
        **_uncertainty(measured.uncertainty),
    }


def _limit(limit: Limit | None) -> dict[str, Any] | None:
    return None if limit is None else {"low": limit.low, "high": limit.high, "unit": limit.unit}


def _uncertainty(found: Uncertainty | None) -> dict[str, Any]:
    if found is None:
        return {"uncertainty": None, "k": None, "dof": None, "standard": None, "monte_carlo": None, "budget": []}
    return {
        "uncertainty": _finite(found.expanded),
        "k": found.k,
        "dof": _finite(found.dof),
        "standard": _finite(found.standard),
        "monte_carlo": _finite(found.monte_carlo),
        "budget": [
            {
                "source": part.source,
                "standard": _finite(part.standard),
                "dof": _finite(part.dof),
                "kind": part.kind,
                "says": part.says,
            }
            for part in found.contributors
        ],
    }


def _finite(value: float | None) -> float | None:
    """A number as JSON can hold it: null where it is not finite."""
    return value if value is not None and math.isfinite(value) else None
