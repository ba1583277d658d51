"""Judge a recording by a file of limits, and write the files of the report."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchctl.limits import cut
from benchctl.metrology.acceptance import accepted
from benchctl.metrology.limit_file import Limits
from benchctl.metrology.result import Acceptance
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.recordings.verify import opened_unchanged
from benchctl.reports.acceptance.build import tally
from benchctl.reports.acceptance.catalogue import catalogue, limits, stated, verdict_of
from benchctl.reports.acceptance.set_up import RecordingFacts, facts_of
from benchctl.reports.acceptance.write import values, write_acceptance


@dataclass(frozen=True, slots=True, kw_only=True)
class Accepted:
    """An acceptance and the facts of its recording."""

    acceptance: Acceptance
    facts: RecordingFacts

    def values(self) -> dict[str, Any]:
        """Return the data for `--json`."""
        return values(self.acceptance, self.facts)

    def lines(self, language: str) -> str:
        """Return the text for a terminal."""
        return lines(self.acceptance, language)

    def write(self, folder: Path, language: str) -> Mapping[str, Path]:
        """Write the report and add it to the manifest of a campaign's folder; raises as `write_acceptance` does."""
        written = write_acceptance(self.acceptance, self.facts, folder, language)
        add_to_manifest(folder, written.values())
        return written

    @property
    def fails(self) -> str:
        """The reason why the verdict is not PASS, in a few words; empty for PASS."""
        open_ones = [one.measured.name for one in self.acceptance.judged if one.verdict == "INCONCLUSIVE"]
        failed = [one.measured.name for one in self.acceptance.judged if one.verdict == "FAIL"]
        if failed:
            return f"fails {', '.join(failed)}"
        return f"inconclusive: {', '.join(open_ones)}" if open_ones else ""


def accept_recording(path: Path, limits: Limits) -> Accepted:
    """Measure and judge a recording.

    Raises
    ------
    UsageError
        If it cannot be read, was changed, or contains no reading at all.
    """
    with opened_unchanged([path], "accepted") as (recording,):
        found = Accepted(acceptance=accepted(recording, limits), facts=facts_of(recording))
    return found


_WIDEST = 120
_GAP = 2


def lines(acceptance: Acceptance, language: str = "en") -> str:
    """Return a line per test with name, value ± U, limit and verdict; only the last may exceed 120 characters."""
    words = catalogue(language)
    names = [_plain(words.test(one.measured.name).name) for one in acceptance.judged]
    columns = [
        [_plain(stated(one.measured, words)) for one in acceptance.judged],
        [_plain(limits(one.limit, words, unit=False)) for one in acceptance.judged],
        [verdict_of(one, words) for one in acceptance.judged],
    ]
    widths = [max(map(len, column), default=0) for column in columns]
    room = _WIDEST - sum(widths) - _GAP * len(widths)
    names = [cut(name, room) for name in names]
    widths.insert(0, max(map(len, names), default=0))
    rows = [
        "".join(cell.ljust(width + _GAP) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in zip(names, *columns, strict=True)
    ]
    verdict = words.word(f"unit_{acceptance.verdict}", "verdicts")
    return "\n".join([*rows, f"{verdict}. {tally(acceptance, words)}"])


def _plain(cell: str) -> str:
    """Return the text with only printable characters, whitespace replaced by spaces."""
    return "".join(" " if one.isspace() else one for one in cell if not unicodedata.category(one).startswith("C"))
