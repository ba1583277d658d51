"""The verbs of a fleet: each does what the single verb does on one recording, and writes into an empty folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from benchctl.fleet.job import Options
from benchctl.fleet.located import Located
from benchctl.recordings.model import Unit
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import refuse_changed
from benchctl.reports.fleet_stated import FleetVerb


def do_verb(verb: FleetVerb, recording: Located, path: Path, options: Options, folder: Path) -> Unit:
    """Do a verb on a recording, at `path`, which is not where it is if it was fetched; its unit.

    Raises `UsageError` where the single verb does.
    """
    _DOES[verb](recording, path, options, folder)
    with open_recording(path) as opened:
        return opened.meta.unit


def _fit(recording: Located, path: Path, _: Options, folder: Path) -> None:
    from benchctl.reports.fitting import calibrated

    found = calibrated([path])
    if recording.remote:  # it is not to be looked for in a scratch folder
        (source,) = found.content["source"]
        found = replace(found, content={**found.content, "source": [{**source, "recording": recording.where}]})
    found.write(folder)


def _diagnose(_: Located, path: Path, options: Options, folder: Path) -> None:
    from benchctl.reports.diagnosing import diagnose_recordings, write_diagnosed

    refuse_changed(path, "diagnosed")
    model = None
    if options.model is not None:
        name, text = options.model
        model = folder.with_name(name)
        model.write_text(text, encoding="utf-8")
    found = diagnose_recordings([path], model=model, part=options.part, seed=options.seed)
    write_diagnosed(found, folder)


def _accept(recording: Located, path: Path, options: Options, folder: Path) -> None:
    from benchctl.reports.accepting import accept_recording

    assert options.limits is not None  # noqa: S101 - `benchctl.cli.fleet` requires them
    found = accept_recording(path, options.limits)
    if recording.remote:
        found = replace(found, facts=replace(found.facts, path=Path(recording.where)))
    found.write(folder, options.language)


_DOES: Mapping[FleetVerb, Callable[[Located, Path, Options, Path], None]] = {
    "fit": _fit,
    "diagnose": _diagnose,
    "accept": _accept,
}
