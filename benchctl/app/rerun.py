"""Compare a recording with a repetition of its procedure; both are measured by the current program version."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any

from benchctl.app.accept import Accepted, plain
from benchctl.atomic import whole_file
from benchctl.campaign.differences import Differences, changed, differences
from benchctl.campaign.provenance import table_of
from benchctl.documents import json_values, read_json
from benchctl.limits import cut, require_file, shown
from benchctl.metrology.acceptance import accepted, measured_in
from benchctl.metrology.limit_file import Limits, limits_of_text, read_limits
from benchctl.metrology.observations import Settings
from benchctl.metrology.rerun import Compared, compared
from benchctl.metrology.result import Judged, Verdict
from benchctl.metrology.verdict import overall
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.recordings.model import Meta
from benchctl.recordings.reader import Recording, open_recording
from benchctl.reports import text
from benchctl.reports.acceptance.catalogue import Catalogue, catalogue, stated
from benchctl.reports.acceptance.set_up import facts_of
from benchctl.reports.acceptance.signed import JSON as ACCEPTANCE
from benchctl.reports.acceptance.write import SCHEMA as ACCEPTANCE_SCHEMA
from benchctl.reports.results import results_folder
from benchctl_instruments.errors import UsageError

_SHARE = 0.01
"""Fraction of an expanded uncertainty; a smaller difference does not affect a printed digit."""
_SAME = 1e-6
"""Relative tolerance of a value without an uncertainty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedAcceptance:
    """The content of an `acceptance.json`: its limits as text with their SHA-256, and the tests by name."""

    path: Path
    limits_text: str
    limits_sha256: str
    tests: Mapping[str, Mapping[str, Any]]

    def limits(self) -> Limits:
        """Return the limits that the recording was judged by.

        Raises
        ------
        UsageError
            If the file contains none, or if they were changed or are not supported by this version.
        """
        if not self.limits_text:
            raise UsageError(f"{self.path}: keeps no text of its limits; name them with --limits FILE")
        limits = limits_of_text(self.limits_text, self.path)
        if limits.sha256 != self.limits_sha256:
            raise UsageError(f"{self.path}: its limits were changed since it was written; name them with --limits FILE")
        return limits

    def unlike(self, judged: Sequence[Judged]) -> Iterator[str]:
        """Yield sentences on differences from the same recording measured today by the same limits."""
        for one in judged:
            test = self.tests.get(one.measured.name, {})
            value, now = _number(test.get("value")), one.measured.value
            if test.get("unit") != one.measured.unit or not _alike(value, one):
                before = f"{shown(value)} {shown(test.get('unit'))}"
                yield f"{one.measured.name} was stated as {before}, is found as {now!r} {one.measured.unit!r} today"
            elif test.get("verdict") != one.verdict:
                yield f"{one.measured.name} was stated as {shown(test.get('verdict'))}, is found {one.verdict!r} today"


def acceptance_beside(recording: Path, digest: str) -> StatedAcceptance | None:
    """Return the acceptance next to a recording with that digest; None if there is none.

    Raises
    ------
    UsageError
        If it cannot be read, or belongs to another recording.
    """
    path = results_folder(recording, "acceptance") / ACCEPTANCE
    if not path.exists():
        return None
    require_file(path, "acceptance ")
    content = read_json(path, "acceptance")
    limits = content.get("limits") if isinstance(content, dict) else None
    tests = content.get("tests") if isinstance(content, dict) else None
    if not isinstance(limits, dict) or not isinstance(tests, list) or content.get("schema") != ACCEPTANCE_SCHEMA:
        raise UsageError(
            f"{path}: is no acceptance of ours (schema {ACCEPTANCE_SCHEMA!r}); write it again with benchctl accept"
        )
    if content.get("recording_digest") != digest:
        raise UsageError(
            f"{path}: is the acceptance of another recording than {recording}; write it again with benchctl accept, or "
            "take it away"
        )
    return StatedAcceptance(
        path=path,
        limits_text=str(limits.get("text") or ""),
        limits_sha256=str(limits.get("sha256") or ""),
        tests={str(test.get("name")): test for test in tests if isinstance(test, dict)},
    )


def _alike(stated: float | None, one: Judged) -> bool:
    """Return whether two values print alike."""
    now, uncertainty = one.measured.value, one.measured.uncertainty
    if stated is None or now is None:
        return stated is None and (now is None or not math.isfinite(now))
    allowed = _SHARE * uncertainty.expanded if uncertainty else _SAME * abs(now)
    return abs(stated - now) <= allowed


def _number(value: object) -> float | None:
    known = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if known and isinstance(value, int | float) else None


SCHEMA = "benchctl-rerun/1"
JSON = "rerun.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstRun:
    """The first of two runs, measured today; `limits` judge both, or None. `stated` is its original acceptance."""

    path: Path
    meta: Meta
    digest: str
    limits: Limits | None
    stated: StatedAcceptance | None
    judged: tuple[Judged, ...]

    @property
    def unlike_stated(self) -> tuple[str, ...]:
        """The differences between the acceptance next to the recording and today's results."""
        if self.stated is None:
            return ()
        if self.limits is not None and self.limits.sha256 != self.stated.limits_sha256:
            return (changed("limits (SHA-256)", self.stated.limits_sha256[:12], self.limits.sha256[:12]),)
        return tuple(self.stated.unlike(self.judged))


@dataclass(frozen=True, slots=True, kw_only=True)
class Rerun:
    """Two runs of one procedure on one unit.

    `seeds` are those of their simulated benches, None for real ones. `accepted` is the acceptance of the second run,
    None if there are no limits.
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
        """The unit's verdicts in the first and the second run; None if it was not judged."""
        if self.accepted is None:
            return None
        return overall(self.first.judged), self.accepted.verdict

    def values(self) -> dict[str, Any]:
        """Return the data of `again` in `--json` and of `rerun.json`."""
        return {
            "first": str(self.first.path),
            "first_digest": self.first.digest,
            "recording": str(self.again),
            "recording_digest": self.again_digest,
            "first_seed": self.seeds[0],
            "seed": self.seeds[1],
            "first_verdict": self.verdicts[0] if self.verdicts else None,
            "verdict": self.verdicts[1] if self.verdicts else None,
            "differences": {name: list(changes) for name, changes in asdict(self.differences).items()},
            "first_acceptance": list(self.first.unlike_stated),
            "tests": [_test(one) for one in self.tests if one.is_told],
        }

    def write(self, folder: Path) -> Path:
        """Write `rerun.json` into a campaign's folder and its manifest; raises `UsageError` if that fails."""
        path = folder / JSON
        text = json.dumps({"schema": SCHEMA, **self.values()}, indent=1, ensure_ascii=False, allow_nan=False)
        with whole_file(path) as temporary:
            temporary.write_text(f"{text}\n", encoding="utf-8")
        add_to_manifest(folder, [path])
        return path


def first_run(path: Path, limits_file: Path | None) -> FirstRun:
    """Measure the first run and judge it by a file of limits, else by those of the acceptance next to it, if any.

    Raises
    ------
    UsageError
        If it cannot be read, its provenance is damaged, or it contains no reading; or if the limits cannot be used.
    """
    limits = None if limits_file is None else read_limits(limits_file)
    with open_recording(path) as recording:
        stated = acceptance_beside(path, recording.digest)
        if limits is None and stated is not None:
            limits = stated.limits()
        differences(recording.meta, recording.meta)  # rejects damaged tables before the run
        return FirstRun(
            path=path,
            meta=recording.meta,
            digest=recording.digest,
            limits=limits,
            stated=stated,
            judged=_judged(recording, limits),
        )


def rerun_of(first: FirstRun, again: Path, *, expected: Collection[str]) -> Rerun:
    """Compare a run with the first one; `expected` as in `differences`. Raises as `measured_in` does."""
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
    """Return the seed of a simulated bench, None if there is no bench or no seed."""
    seed = table_of(meta, "bench_physics", "the first run").get("seed")
    return seed if isinstance(seed, int) else None


def _test(one: Compared) -> dict[str, Any]:
    before, now = one.first.measured, one.again.measured
    return {
        "name": one.name,
        "unit": before.unit,
        "first": json_values(before.value),
        "first_uncertainty": json_values(before.uncertainty.expanded if before.uncertainty else None),
        "first_bound": before.bound,
        "again": json_values(now.value),
        "again_uncertainty": json_values(now.uncertainty.expanded if now.uncertainty else None),
        "again_bound": now.bound,
        "difference": json_values(one.difference),
        "difference_uncertainty": json_values(one.uncertainty),
        "e_n": json_values(one.e_n),
        "differs": one.differs,
        "first_verdict": one.first.verdict,
        "again_verdict": one.again.verdict,
    }


_WIDEST = 120
_GAP = 2
_GROUP = 13
_TITLES = {"bench": "bench.toml"}
_HEADINGS = ("test", "E_n", "", "first ± U", "again ± U", "difference ± U")


def lines(rerun: Rerun) -> str:
    """Return the lines on the runs, groups and tests, and the summary; none is wider than 120 characters."""
    rows = [*_of_the_runs(rerun), *_of_groups(rerun), "", *_of_tests(rerun), *_in_short(rerun)]
    return "\n".join(cut(plain(line), _WIDEST) for line in rows)


def _of_the_runs(rerun: Rerun) -> Iterator[str]:
    first, (before, now) = rerun.first, rerun.seeds
    provenance = first.meta.provenance
    made = ", ".join(filter(None, (provenance.get("procedure"), provenance.get("started_utc"), first.meta.status)))
    yield f"{'first':{_GROUP}}{first.path}: {made}, unit {first.meta.unit.serial}"
    if now is not None:
        seed = f"seed {now} where the first run had {text.NOT_KNOWN if before is None else before}"
        yield f"{'noise':{_GROUP}}simulated, {'the same: ' if now == before else 'drawn anew: '}{seed}"


def _of_groups(rerun: Rerun) -> Iterator[str]:
    for group, changes in asdict(rerun.differences).items():
        yield from _group(_TITLES.get(group, group), changes)
    if rerun.first.stated is None:
        yield f"{'acceptance':{_GROUP}}there is none next to the first run"
    else:
        yield from _group("acceptance", rerun.first.unlike_stated)


def _group(title: str, changes: Iterable[str]) -> Iterator[str]:
    first, *more = tuple(changes) or ("the same",)
    yield f"{title:{_GROUP}}{first}"
    yield from (f"{'':{_GROUP}}{line}" for line in more)


def _of_tests(rerun: Rerun) -> Iterator[str]:
    words = catalogue("en")
    rows = [_HEADINGS, *(_row(one, words) for one in rerun.tests if one.is_told)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "".join(cell.ljust(width + _GAP) for cell, width in zip(row, widths, strict=True)).rstrip()


def _row(one: Compared, words: Catalogue) -> tuple[str, ...]:
    difference = text.NOT_KNOWN if one.difference is None else text.with_uncertainty(one.difference, one.uncertainty)
    cells = (
        one.name,
        text.plain(one.e_n, "", 2),
        "differs" if one.differs else "",
        stated(one.first.measured, words),
        stated(one.again.measured, words, unit=False),
        difference,
    )
    return tuple(map(plain, cells))


def _in_short(rerun: Rerun) -> Iterator[str]:
    apart = [one.name for one in rerun.tests if one.differs]
    both = sum(one.e_n is not None for one in rerun.tests)
    if apart:
        yield from wrap(f"differ: {', '.join(apart)}", _WIDEST)
    else:
        yield f"no test differs: |E_n| ≤ 1 in all {both} that can be compared"
    for one in rerun.tests:
        if one.verdict_changed:
            yield f"judged otherwise: {one.name} is {one.again.verdict}, was {one.first.verdict}"
    if rerun.accepted is None or rerun.verdicts is None:
        yield "not judged: there is no acceptance next to the first run; name limits with --limits FILE"
        return
    before, now = rerun.verdicts
    why = f": {rerun.accepted.fails}" if rerun.accepted.fails else ""
    yield f"{now} again{why}" if now == before else f"{now}, was {before}{why}"
