"""The acceptance that lies beside a recording: the limits that it was judged by, and what was found then."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchctl.documents import read_json
from benchctl.limits import require_file, shown
from benchctl.metrology.limit_file import Limits, limits_of_text
from benchctl.metrology.result import Judged
from benchctl.reports.acceptance.as_json import SCHEMA
from benchctl.reports.acceptance.write import JSON
from benchctl.reports.results import results_folder
from benchctl_instruments.errors import UsageError

_SHARE = 0.01
"""Of an expanded uncertainty: what is less is in no printed digit."""
_SAME = 1e-6
"""Of a value without an uncertainty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """What an `acceptance.json` says: its limits as text and their SHA-256, and the tests by name."""

    path: Path
    limits_text: str
    limits_sha256: str
    tests: Mapping[str, Mapping[str, Any]]

    def limits(self) -> Limits:
        """The limits that it was judged by.

        Raises
        ------
        UsageError
            Where it keeps none, they were changed, or are none that this program knows.
        """
        if not self.limits_text:
            raise UsageError(f"{self.path}: keeps no text of its limits; name them with --limits FILE")
        limits = limits_of_text(self.limits_text, self.path)
        if limits.sha256 != self.limits_sha256:
            raise UsageError(f"{self.path}: its limits were changed since it was written; name them with --limits FILE")
        return limits

    def unlike(self, judged: Sequence[Judged]) -> Iterator[str]:
        """How it differs from the same recording measured today by the same limits, in words."""
        for one in judged:
            told = self.tests.get(one.measured.name, {})
            value, now = _number(told.get("value")), one.measured.value
            if told.get("unit") != one.measured.unit or not _alike(value, one):
                before = f"{shown(value)} {shown(told.get('unit'))}"
                yield f"{one.measured.name} was stated as {before}, is found as {now!r} {one.measured.unit!r} today"
            elif told.get("verdict") != one.verdict:
                yield f"{one.measured.name} was stated as {shown(told.get('verdict'))}, is found {one.verdict!r} today"


def acceptance_beside(recording: Path, digest: str) -> Stated | None:
    """What lies beside a recording of that digest; None where nothing does.

    Raises
    ------
    UsageError
        Where it cannot be read, or is that of another recording.
    """
    path = results_folder(recording, "acceptance") / JSON
    if not path.exists():
        return None
    require_file(path, "acceptance ")
    content = read_json(path, "acceptance")
    limits = content.get("limits") if isinstance(content, dict) else None
    tests = content.get("tests") if isinstance(content, dict) else None
    if not isinstance(limits, dict) or not isinstance(tests, list) or content.get("schema") != SCHEMA:
        raise UsageError(f"{path}: is no acceptance of ours (schema {SCHEMA!r}); write it again with benchctl accept")
    if content.get("recording_digest") != digest:
        raise UsageError(
            f"{path}: is the acceptance of another recording than {recording}; write it again with benchctl accept, or "
            "take it away"
        )
    return Stated(
        path=path,
        limits_text=str(limits.get("text") or ""),
        limits_sha256=str(limits.get("sha256") or ""),
        tests={str(test.get("name")): test for test in tests if isinstance(test, dict)},
    )


def _alike(stated: float | None, one: Judged) -> bool:
    """Whether two values print alike."""
    now, uncertainty = one.measured.value, one.measured.uncertainty
    if stated is None or now is None:
        return stated is None and (now is None or not math.isfinite(now))
    allowed = _SHARE * uncertainty.expanded if uncertainty else _SAME * abs(now)
    return abs(stated - now) <= allowed


def _number(value: object) -> float | None:
    known = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if known and isinstance(value, int | float) else None
