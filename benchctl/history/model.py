"""What a folder of campaigns holds: the frozen records that the index keeps and the charts are made from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from benchctl.recordings.campaign_manifest import Integrity

Source = Literal["acceptance", "coefficients"]
SOURCES: tuple[Source, ...] = get_args(Source)
"""The files that state figures of a campaign, in the order in which a reader wants them."""


@dataclass(frozen=True, slots=True)
class Problem:
    """Something that is not part of the history, and why; `where` is its path in the folder."""

    where: str
    says: str

    def __str__(self) -> str:
        return f"{self.where}: {self.says}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """What a recording says of itself. `started_utc` is ISO 8601 in UTC, to the second; `path` is in the folder.

    `parameters` are those of the procedure, as JSON; empty where they are not known. `integrity` is how it agrees with
    the manifest of its folder.
    """

    path: str
    serial: str
    model: str
    procedure: str
    started_utc: str
    status: str
    digest: str
    parameters: str
    integrity: Integrity = "not verified"


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One number that a document states of a campaign, in `unit`.

    `uncertainty` is expanded (95.45 %). `temperature_c` is where it holds: a test's temperature, T0 of coefficients.
    `bound` is `at least` or `at most` where the value is only a limit of what the recording can show. `low` and `high`
    are the limits of an acceptance, `verdict` what it made of them; empty or None: there is none.
    """

    name: str
    unit: str
    value: float
    uncertainty: float | None = None
    temperature_c: float | None = None
    bound: str = ""
    verdict: str = ""
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Document:
    """A file of coefficients or of an acceptance; `digests` are those of the recordings that it names, in order."""

    source: Source
    digests: tuple[str, ...]
    verdict: str
    figures: tuple[Figure, ...]
