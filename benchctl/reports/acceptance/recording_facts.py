"""What the report says of the recording that was judged, beside its results."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from benchctl.recordings.model import Meta, StepInfo
from benchctl.recordings.reader import Recording
from benchctl.reports.coefficient_tables import Coefficient
from benchctl.reports.results import name_of, source_digest

_BEFORE_ANY = datetime(2000, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingFacts:
    """The recording that was judged, what was done otherwise than asked, and the coefficients that go with it.

    `digest` is the recording's SHA-256, or of an import those of its sources; `deviations` are sentences.
    """

    path: Path
    meta: Meta
    infos: tuple[StepInfo, ...]
    digest: str
    deviations: tuple[str, ...] = ()
    coefficients: tuple[Coefficient, ...] = ()

    @property
    def name(self) -> str:
        """The recording's name, without its way."""
        return name_of(self.path)

    @property
    def started(self) -> datetime:
        """When the recording was begun, UTC; 1 January 2000 where it does not say."""
        try:
            told = datetime.fromisoformat(self.meta.provenance.get("started_utc", ""))
        except ValueError:
            return _BEFORE_ANY
        return told.astimezone(UTC) if told.tzinfo else told.replace(tzinfo=UTC)


def facts_of(recording: Recording) -> RecordingFacts:
    """The facts of an open recording; raises `UsageError` where an import's sources cannot be read."""
    return RecordingFacts(
        path=recording.path,
        meta=recording.meta,
        infos=tuple(recording.infos),
        digest=source_digest(recording),
    )
