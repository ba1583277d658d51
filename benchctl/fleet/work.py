"""Run one job in a worker: apply the verb to its recording and store the results; report errors in one line."""

from __future__ import annotations

import hashlib
import os
import socket
import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import benchctl
from benchctl.fleet.job import SCHEMA, Job, JobOutcome, JobRecord, Options, earlier, record_at, record_name
from benchctl.fleet.located import Located, fetch, files_of
from benchctl.recordings.model import Unit
from benchctl.recordings.reader import open_recording
from benchctl.reports.fleet_stated import DOCUMENTS, FleetVerb, stated_in
from benchctl_instruments.errors import BenchError, in_line, reason

_one_at_a_time = threading.Lock()
"""HDF5 and the drawing of figures are not thread-safe; workers are processes."""


def work(job: Job, version: str) -> JobOutcome:
    """Run a job of a fleet that uses benchctl `version`, unless it is already done."""
    with _one_at_a_time:
        try:
            if version != benchctl.__version__:
                return _failed(f"worker on {socket.gethostname()} has benchctl {benchctl.__version__}, not {version}")
            if not job.recording.remote and not os.path.exists(job.recording.where):
                return _failed(
                    f"{job.recording.where}: is not there, as {socket.gethostname()} sees it; recordings must lie "
                    "where all workers have them under the same path, or at a URL"
                )
            return _unless_done(job)
        except BenchError as err:
            return _failed(str(err))
        except OSError as err:
            return _failed(f"{err.filename or job.recording.where}: {reason(err)}")
        except Exception as err:  # one recording must not end a fleet
            return _failed(f"{job.recording.where}: {type(err).__name__}: {in_line(str(err))}")


def _failed(reason: str) -> JobOutcome:
    return JobOutcome(state="failed", reason=" ".join(reason.split()))


def _unless_done(job: Job) -> JobOutcome:
    there = record_at(job.place, job.verb)
    if there is not None and there.run == job.run:  # its worker died before it reported the result
        return JobOutcome(state="done", record=there)
    with tempfile.TemporaryDirectory(dir=_scratch()) as scratch:
        path = fetch(job.recording, Path(scratch)) if job.recording.remote else Path(job.recording.where)
        digest = _digest(path, job)
        record = earlier(job)
        if record is not None and record.sha256 == digest:  # only touched or copied: record this for the next time
            record = replace(record, stamp=job.recording.stamp)
            job.place.put(record_name(job.verb), record.as_bytes())
            return JobOutcome(state="kept", record=record)
        return _done(job, path, digest, Path(scratch) / "results", set(there.files) if there else set())


def _done(job: Job, path: Path, digest: str, folder: Path, stale: set[str]) -> JobOutcome:
    """Create the results in a folder and store them; `stale` are files of earlier ones."""
    folder.mkdir()
    unit = do_verb(job.verb, job.recording, path, job.options, folder)
    record = JobRecord(
        schema=SCHEMA,
        verb=job.verb,
        options=job.options.relevant(job.verb),
        version=benchctl.__version__,
        run=job.run,
        recording=job.recording.where,
        stamp=job.recording.stamp,
        sha256=digest,
        serial=unit.serial,
        model=unit.model,
        files=tuple(sorted(file.name for file in folder.iterdir())),
        document_sha256=hashlib.sha256((folder / DOCUMENTS[job.verb]).read_bytes()).hexdigest(),
        stated=stated_in(job.verb, folder),
    )
    (folder / record_name(job.verb)).write_bytes(record.as_bytes())
    job.place.land(folder, record_name(job.verb), stale)
    return JobOutcome(state="done", record=record)


def _digest(path: Path, job: Job) -> str:
    """Return the SHA-256 over the files of a recording: names and contents."""
    digest = hashlib.sha256()
    for file in files_of(path, job.recording.kind):
        with file.open("rb") as content:
            digest.update(f"{file.name} {hashlib.file_digest(content, 'sha256').hexdigest()}\n".encode())
    return digest.hexdigest()


def _scratch() -> str | None:
    """Return the worker's own folder, which its cluster removes even after a kill; None for the system's."""
    from distributed import get_worker

    try:
        folder: str = get_worker().local_directory
    except ValueError:
        return None
    return folder


def do_verb(verb: FleetVerb, recording: Located, path: Path, options: Options, folder: Path) -> Unit:
    """Apply a verb to a recording, whose local copy is at `path`, and return its unit.

    Raises `UsageError` if the single verb does.
    """
    _DOES[verb](recording, path, options, folder)
    with open_recording(path) as opened:
        return opened.meta.unit


def _fit(recording: Located, path: Path, _: Options, folder: Path) -> None:
    from benchctl.app.fit import fit

    found = fit([path])
    if recording.remote:  # the scratch folder must not appear as its source
        (source,) = found.coefficients["source"]
        stated = {**found.coefficients, "source": [{**source, "recording": recording.where}]}
        found = replace(found, coefficients=stated)
    found.write(folder)


def _diagnose(_: Located, path: Path, options: Options, folder: Path) -> None:
    from benchctl.app.diagnose import diagnose

    model = None
    if options.model is not None:
        name, text = options.model
        model = folder.with_name(name)
        model.write_text(text, encoding="utf-8")
    diagnose([path], model=model, part=options.part, seed=options.seed).write(folder)


def _accept(recording: Located, path: Path, options: Options, folder: Path) -> None:
    from benchctl.app.accept import accept

    assert options.limits is not None  # noqa: S101 - `benchctl.cli.fleet` requires them
    found = accept(path, options.limits, language=options.language)
    if recording.remote:
        found = replace(found, facts=replace(found.facts, path=Path(recording.where)))
    found.write(folder)


_DOES: Mapping[FleetVerb, Callable[[Located, Path, Options, Path], None]] = {
    "fit": _fit,
    "diagnose": _diagnose,
    "accept": _accept,
}
