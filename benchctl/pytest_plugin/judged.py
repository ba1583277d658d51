"""Runs the campaign of a file and judges it: once in a session, whichever of its processes comes first."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from filelock import FileLock

from benchctl import api
from benchctl.pytest_plugin import ENDING
from benchctl.pytest_plugin.document import BenchTest
from benchctl.reports.acceptance.catalogue import catalogue
from benchctl.reports.acceptance.junit import properties_of, verdict_says
from benchctl_instruments.errors import BenchError


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Of one limit: PASS, FAIL or INCONCLUSIVE, why, and the figures by name."""

    verdict: str
    says: str
    properties: dict[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What became of a campaign: `error` says why it is not complete or could not be judged, empty where it is.

    `told` are its figures by name; `report` is where the acceptance stands, empty where the campaign is not kept.
    """

    error: str
    told: dict[str, str]
    report: str
    tests: dict[str, Verdict]


def judged(test: BenchTest, path: Path, shared: Path, out: Path | None) -> Judged:
    """What became of the campaign of a file; it is run where no process of this session has done so.

    `shared` is the folder that these processes share; the campaign is kept in `out`, where that is given.
    """
    shared.mkdir(parents=True, exist_ok=True)
    name = hashlib.sha256(str(path).encode()).hexdigest()[:16]
    with FileLock(shared / f"{name}.lock"):
        state = shared / f"{name}.json"
        if not state.exists():
            folder = _free(out or shared / "campaigns", path.name.removesuffix(ENDING))
            found = _run(test, folder, kept=out is not None)
            state.write_text(json.dumps(asdict(found)), encoding="utf-8")
        told = json.loads(state.read_text(encoding="utf-8"))
    return Judged(**{**told, "tests": {name: Verdict(**one) for name, one in told["tests"].items()}})


def _run(test: BenchTest, folder: Path, *, kept: bool) -> Judged:
    try:
        outcome = api.run(test.plan, test.bench, out=folder, check=False)
        told = {
            "recording": str(outcome.recording),
            "status": outcome.status,
            "steps": f"{outcome.whole} of {outcome.planned}",
            "samples": str(outcome.samples),
            "bench_time_s": f"{outcome.bench_time_s:.1f}",
        }
        if outcome.error is not None:
            return Judged(error=f"{outcome.status}: {outcome.error}", told=told, report="", tests={})
        if test.limits is None:
            return Judged(error="", told=told, report="", tests={})
        accepted = api.accept(outcome, test.limits.path, out=folder if kept else None)
    except BenchError as err:
        return Judged(error=str(err), told={}, report="", tests={})
    words = catalogue("en")
    tests = {
        one.measured.name: Verdict(
            verdict=str(one.verdict),
            says=" ".join([verdict_says(one, words), words.said(one.remedy) if one.remedy else ""]).strip(),
            properties={name: value for name, value in properties_of(one).items() if value},
        )
        for one in accepted.tests
        if one.limit is not None
    }
    return Judged(error="", told=told, report=str(accepted.files.get("report", "")), tests=tests)


def _free(place: Path, name: str) -> Path:
    """A folder of that name that is not there yet."""
    folder, number = place / name, 1
    while folder.exists():
        number += 1
        folder = place / f"{name}_{number}"
    return folder
