"""A job, that is, one verb on one recording; and its record next to the results, so that it is not repeated."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal

from pydantic import TypeAdapter, ValidationError

import benchctl
from benchctl.fleet.located import Located
from benchctl.fleet.places import Place
from benchctl.reports.fleet_stated import DOCUMENTS, FleetVerb, Stated
from benchctl_instruments.errors import BenchError

if TYPE_CHECKING:  # the client process does no arithmetic
    from benchctl.diagnosis.result import Part
    from benchctl.metrology.limit_file import Limits

Schema = Literal["benchctl-fleet-job/1"]
SCHEMA: Schema = "benchctl-fleet-job/1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options of a verb; `model` is a model file's name and text."""

    limits: Limits | None = None
    language: str = "en"
    model: tuple[str, str] | None = None
    part: Part | None = None
    seed: int = 0

    def relevant(self, verb: FleetVerb) -> dict[str, str]:
        """Return the options that affect a verb's results; files by their digest."""
        match verb:
            case "fit":
                return {}
            case "accept":
                return {"limits": self.limits.sha256 if self.limits else "", "language": self.language}
            case "diagnose":
                name, text = self.model or ("", "")
                digest = hashlib.sha256(text.encode()).hexdigest() if name else ""
                return {"model": f"{name} {digest}".strip(), "part": self.part or "", "seed": str(self.seed)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One verb on one recording. `run` identifies the run of the fleet; `again`: repeat the job even if it was done."""

    verb: FleetVerb
    recording: Located
    place: Place
    options: Options
    run: str
    again: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class JobRecord:
    """The record next to the results: the job, the version and run of the fleet, and its result.

    `sha256` is over the recording's files, `files` are the results' names and `document_sha256` belongs to the JSON
    document, so that results replaced later are not attributed to this job.
    """

    schema: Schema
    verb: FleetVerb
    options: Mapping[str, str]
    version: str
    run: str
    recording: str
    stamp: tuple[str, ...]
    sha256: str
    serial: str
    model: str
    files: tuple[str, ...]
    document_sha256: str
    stated: Stated

    def as_bytes(self) -> bytes:
        """Return the content of the file."""
        return (json.dumps(asdict(self), indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


@dataclass(frozen=True, slots=True, kw_only=True)
class JobOutcome:
    """The outcome of a job: `done`, `kept` (done before and unchanged) or `failed`, with the reason in one line."""

    state: Literal["done", "kept", "failed"]
    record: JobRecord | None = None
    reason: str = ""


def record_name(verb: FleetVerb) -> str:
    """Return the name of a job's record; it is hidden, so that a campaign's manifest does not include it."""
    return f".benchctl-fleet-{verb}.json"


def record_at(place: Place, verb: FleetVerb) -> JobRecord | None:
    """Return the record at a place if its results are still there unchanged; None otherwise."""
    content = place.read(record_name(verb))
    if content is None:
        return None
    try:
        record = _ADAPTER.validate_json(content)
    except ValidationError:
        return None
    if record.verb != verb or not set(record.files) <= place.names():
        return None
    document = place.read(DOCUMENTS[verb])
    return record if hashlib.sha256(document or b"").hexdigest() == record.document_sha256 else None


def earlier(job: Job) -> JobRecord | None:
    """Return the record of the same job by the same version, even if the recording has changed since."""
    record = None if job.again else record_at(job.place, job.verb)
    if record is None or record.version != benchctl.__version__ or record.options != job.options.relevant(job.verb):
        return None
    return record if record.recording == job.recording.where else None


def kept(job: Job) -> JobOutcome | None:
    """Return the outcome of a job that is up to date by the recording's stamp; None if it may have to be done."""
    try:
        record = earlier(job)
    except BenchError:  # the worker meets the same error and reports it
        return None
    unchanged = record is not None and record.stamp == job.recording.stamp != ()
    return JobOutcome(state="kept", record=record) if unchanged else None


_ADAPTER = TypeAdapter(JobRecord)
