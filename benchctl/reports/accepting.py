"""From a recording and a file of limits to verdicts, and the files of the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchctl.metrology.acceptance import accepted
from benchctl.metrology.limit_file import Limits
from benchctl.metrology.result import Acceptance
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.recordings.verify import opened_unchanged
from benchctl.reports.acceptance.as_json import values
from benchctl.reports.acceptance.lines import lines
from benchctl.reports.acceptance.recording_facts import RecordingFacts, facts_of
from benchctl.reports.acceptance.write import write_acceptance


@dataclass(frozen=True, slots=True, kw_only=True)
class Accepted:
    """An acceptance and the recording that it is of."""

    acceptance: Acceptance
    facts: RecordingFacts

    def values(self) -> dict[str, Any]:
        """As `--json` gives it."""
        return values(self.acceptance, self.facts)

    def lines(self, language: str) -> str:
        """For a terminal."""
        return lines(self.acceptance, language)

    def write(self, folder: Path, language: str) -> Mapping[str, Path]:
        """The report's files, also in the manifest where the folder is a campaign's; raises `write_acceptance`'s."""
        written = write_acceptance(self.acceptance, self.facts, folder, language)
        add_to_manifest(folder, written.values())
        return written

    @property
    def fails(self) -> str:
        """Why it is no PASS, in a few words; empty where it is one."""
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
        Where it cannot be read, was changed, or holds no reading at all.
    """
    with opened_unchanged([path], "accepted") as (recording,):
        found = Accepted(acceptance=accepted(recording, limits), facts=facts_of(recording))
    return found
