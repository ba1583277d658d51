"""A recording and the same procedure run again: both measured by today's program, and what differs between them."""

from __future__ import annotations

import json
import math
from collections.abc import Collection
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchctl.atomic import whole_file
from benchctl.campaign.changes import changed
from benchctl.campaign.differences import Differences, differences
from benchctl.campaign.provenance import table_of
from benchctl.metrology.acceptance import accepted, measured_in
from benchctl.metrology.limit_file import Limits, read_limits
from benchctl.metrology.observations import Settings
from benchctl.metrology.rerun import Compared, compared
from benchctl.metrology.result import Judged, Verdict
from benchctl.metrology.verdict import overall
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.recordings.model import Meta
from benchctl.recordings.reader import Recording, open_recording
from benchctl.reports.acceptance.recording_facts import facts_of
from benchctl.reports.accepting import Accepted
from benchctl.reports.first_acceptance import Stated, acceptance_beside

SCHEMA = "benchctl-rerun/1"
JSON = "rerun.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstRun:
    """The first of two runs, measured today; `limits` judge both, None: none do. `stated` is what was found then."""

    path: Path
    meta: Meta
    digest: str
    limits: Limits | None
    stated: Stated | None
    judged: tuple[Judged, ...]

    @property
    def unlike_stated(self) -> tuple[str, ...]:
        """How the acceptance beside it differs from what is found today."""
        if self.stated is None:
            return ()
        if self.limits is not None and self.limits.sha256 != self.stated.limits_sha256:
            return (changed("limits (SHA-256)", self.stated.limits_sha256[:12], self.limits.sha256[:12]),)
        return tuple(self.stated.unlike(self.judged))


@dataclass(frozen=True, slots=True, kw_only=True)
class Rerun:
    """Two runs of one procedure on one unit.

    `seeds` are those of their simulated benches, None of others. `accepted` is the acceptance of the run again, None
    where there are no limits.
    """

    first: FirstRun
    again: Path
    again_digest: str
    seeds: tuple[int | None, int | None]
    differences: Differences
    tests: tuple[Compared, ...]
    accepted: Accepted | None

    @property
    def verdicts(self) -> tuple[Verdict, Verdict] | None:
        """Of the unit, at first and again; None where it was not judged."""
        if self.accepted is None:
            return None
        return overall(self.first.judged), self.accepted.acceptance.verdict

    def values(self) -> dict[str, Any]:
        """As `--json` gives it under `again`, and `rerun.json` holds it."""
        return {
            "first": str(self.first.path),
            "first_digest": self.first.digest,
            "recording": str(self.again),
            "recording_digest": self.again_digest,
            "first_seed": self.seeds[0],
            "seed": self.seeds[1],
            "first_verdict": self.verdicts[0] if self.verdicts else None,
            "verdict": self.verdicts[1] if self.verdicts else None,
            "differences": {name: list(told) for name, told in asdict(self.differences).items()},
            "first_acceptance": list(self.first.unlike_stated),
            "tests": [_test(one) for one in self.tests if one.is_told],
        }

    def write(self, folder: Path) -> Path:
        """Write `rerun.json` in a campaign's folder, and into its manifest; raises `UsageError` where that fails."""
        path = folder / JSON
        text = json.dumps({"schema": SCHEMA, **self.values()}, indent=1, ensure_ascii=False, allow_nan=False)
        with whole_file(path) as temporary:
            temporary.write_text(f"{text}\n", encoding="utf-8")
        add_to_manifest(folder, [path])
        return path


def first_run(path: Path, limits_file: Path | None) -> FirstRun:
    """Measure the first run, judged by a file of limits, or by those of the acceptance beside it, or by none.

    Raises
    ------
    UsageError
        Where it cannot be read, its provenance is damaged, or it holds no reading at all; or the limits cannot be used.
    """
    limits = None if limits_file is None else read_limits(limits_file)
    with open_recording(path) as recording:
        stated = acceptance_beside(path, recording.digest)
        if limits is None and stated is not None:
            limits = stated.limits()
        differences(recording.meta, recording.meta)  # tables that are damaged are refused before anything is run
        return FirstRun(
            path=path,
            meta=recording.meta,
            digest=recording.digest,
            limits=limits,
            stated=stated,
            judged=_judged(recording, limits),
        )


def rerun_of(first: FirstRun, again: Path, *, expected: Collection[str]) -> Rerun:
    """Hold a run against the first one; `expected` as `differences` has it. Raises what `measured_in` does."""
    with open_recording(again) as recording:
        judged = None if first.limits is None else accepted(recording, first.limits)
        return Rerun(
            first=first,
            again=recording.path,
            again_digest=recording.digest,
            seeds=(_seed(first.meta), _seed(recording.meta)),
            differences=differences(first.meta, recording.meta, expected=expected),
            tests=compared(first.judged, judged.judged if judged else _judged(recording, None)),
            accepted=Accepted(acceptance=judged, facts=facts_of(recording)) if judged else None,
        )


def _judged(recording: Recording, limits: Limits | None) -> tuple[Judged, ...]:
    if limits is not None:
        return accepted(recording, limits).judged
    measured = measured_in(recording, Settings())
    return tuple(Judged(measured=one, limit=None, verdict=None) for one in measured)


def _seed(meta: Meta) -> int | None:
    """The seed of a simulated bench, None where there was none or it says nothing of it."""
    seed = table_of(meta, "bench_physics", "the first run").get("seed")
    return seed if isinstance(seed, int) else None


def _test(one: Compared) -> dict[str, Any]:
    before, now = one.first.measured, one.again.measured
    return {
        "name": one.name,
        "unit": before.unit,
        "first": _finite(before.value),
        "first_uncertainty": _finite(before.uncertainty.expanded if before.uncertainty else None),
        "first_bound": before.bound,
        "again": _finite(now.value),
        "again_uncertainty": _finite(now.uncertainty.expanded if now.uncertainty else None),
        "again_bound": now.bound,
        "difference": _finite(one.difference),
        "difference_uncertainty": _finite(one.uncertainty),
        "e_n": _finite(one.e_n),
        "differs": one.differs,
        "first_verdict": one.first.verdict,
        "again_verdict": one.again.verdict,
    }


def _finite(value: float | None) -> float | None:
    """A number as JSON can hold it: null where it is not finite."""
    return value if value is not None and math.isfinite(value) else None
