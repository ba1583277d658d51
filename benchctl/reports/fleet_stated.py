"""The results that a fit, a diagnosis or an acceptance states for one recording and that a fleet compares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from benchctl.documents import json_values, read_json
from benchctl.history.entries import read_document
from benchctl.history.series import Figure, Source
from benchctl.limits import shown
from benchctl_instruments.errors import UsageError

FleetVerb = Literal["fit", "diagnose", "accept"]

VERBS: tuple[FleetVerb, ...] = get_args(FleetVerb)
DOCUMENTS: Mapping[FleetVerb, str] = {
    "fit": "coefficients.json",
    "diagnose": "diagnosis.json",
    "accept": "acceptance.json",
}
"""The JSON file that each verb writes."""
REPORTS: Mapping[FleetVerb, str] = {"fit": "report.html", "diagnose": "diagnosis.html", "accept": "acceptance.html"}
"""The HTML page that each verb writes."""
_SOURCES: Mapping[FleetVerb, Source] = {"fit": "coefficients", "accept": "acceptance"}


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundParameter:
    """A parameter of a finding in `unit`, with its 95 % interval if there is one."""

    name: str
    value: float
    low: float | None
    high: float | None
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundEffect:
    """An effect that a diagnosis found; `explains`: share of the mismatch, 0 to 1; the first parameter is its size."""

    effect: str
    explains: float | None
    parameters: tuple[FoundParameter, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """The results of one verb on a recording; `verdict` is empty for a fit, `figures` are those that `history` charts.

    `tests` are the verdicts of an acceptance by test name, including tests without a value.
    """

    verdict: str = ""
    figures: tuple[Figure, ...] = ()
    effects: tuple[FoundEffect, ...] = ()
    tests: tuple[tuple[str, str], ...] = ()


def stated_in(verb: FleetVerb, folder: Path) -> Stated:
    """Read the document in a folder of results; raises `UsageError` if it is malformed."""
    path = folder / DOCUMENTS[verb]
    if verb == "diagnose":
        return _diagnosis(read_json(path, "diagnosis"), path)
    document = read_document(path, _SOURCES[verb])
    tests = _tests(read_json(path, "acceptance")) if verb == "accept" else ()
    return Stated(verdict=document.verdict, figures=document.figures, tests=tests)


def _diagnosis(content: Any, path: Path) -> Stated:
    try:
        return Stated(
            verdict=str(content["verdict"]), effects=tuple(_effect(finding) for finding in content["findings"])
        )
    except (AttributeError, LookupError, TypeError, ValueError) as err:
        raise UsageError(f"{path}: is no diagnosis ({shown(err)}); write it with `benchctl diagnose`") from err


def _effect(finding: Mapping[str, Any]) -> FoundEffect:
    return FoundEffect(
        effect=str(finding["effect"]),
        explains=finding["explains"],
        parameters=tuple(
            FoundParameter(
                name=name,
                value=float(one["value"]),
                low=json_values(one["ci95"][0]),
                high=json_values(one["ci95"][1]),
                unit=str(one["unit"]),
            )
            for name, one in finding["parameters"].items()
            if one["value"] is not None
        ),
    )


def _tests(content: Any) -> tuple[tuple[str, str], ...]:
    """Return the verdict of each test that has one; the worst of a test done at several temperatures."""
    worst = ("FAIL", "INCONCLUSIVE", "PASS")
    found: dict[str, str] = {}
    for test in content["tests"]:
        name, verdict = str(test["name"]), test["verdict"]
        if verdict in worst:
            found[name] = min(found.get(name, verdict), verdict, key=worst.index)
    return tuple(found.items())
