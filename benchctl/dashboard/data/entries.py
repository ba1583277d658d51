"""A campaign as the list of campaigns has it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchctl.dashboard.data.contents import Contents, contents_of
from benchctl.dashboard.data.documents import KINDS, files_of, is_there
from benchctl.dashboard.data.imports import import_of
from benchctl.dashboard.data.journal import lines_after
from benchctl.dashboard.data.kinds import is_open_recording, recording_in
from benchctl.dashboard.data.places import cache_folder
from benchctl.dashboard.data.state import DIED, died_says, status_of
from benchctl.limits import listed
from benchctl.recordings.campaign_manifest import MANIFEST, entries_of, integrity
from benchctl.recordings.descriptions import read_meta
from benchctl.recordings.hdf5_files import open_ours
from benchctl.recordings.hdf5_guard import attribute
from benchctl.recordings.import_open import read_description
from benchctl.recordings.journal import planned_steps
from benchctl.recordings.schema import RECORDING
from benchctl_instruments.errors import UsageError

_NOT_COUNTED = "its steps are not counted yet"


def entry_of(path: Path) -> dict[str, Any]:
    """What the list says of a campaign, without its id; one that cannot be read says why, with status `unreadable`."""
    try:
        if is_open_recording(path) and not import_of(path, cache_folder()).exists():
            return _by_its_description(path)
        contents = contents_of(path)
        planned = planned_steps(event for _, event in lines_after(path, 0) if event is not None)
        return _read(contents, planned)
    except (UsageError, OSError) as err:
        return _blank(path) | {"status": "unreadable", "says": " ".join(str(err).split())}


def brief_entry_of(path: Path) -> dict[str, Any]:
    """As `entry_of`, but of a recording only its root is read: quick, and without what its steps say."""
    file = recording_in(path)
    if file is None:  # a campaign that is not closed, or an open recording: neither is large to list
        return entry_of(path)
    try:
        with open_ours(file) as opened:
            contents = Contents(path, read_meta(opened), (), str(attribute(opened, "digest", "")))
    except (UsageError, OSError, ValueError) as err:
        return _blank(path) | {"status": "unreadable", "says": " ".join(str(err).split())}
    return _read(contents, None) | {"says": _NOT_COUNTED}


def _read(contents: Contents, planned: int | None) -> dict[str, Any]:
    path, told, unit = contents.path, contents.meta.provenance, contents.meta.unit
    infos = [piece.info for piece in contents.pieces]
    whole = [info for info in infos if info.whole and (planned is None or info.index <= planned)]
    status = status_of(contents)
    return _blank(path) | {
        "procedure": told.get("procedure", ""),
        "unit": unit.serial,
        "model": unit.model,
        "status": status,
        "started_utc": told.get("started_utc", ""),
        "steps_planned": planned,
        "steps_whole": len(whole),
        "samples": sum(info.samples for info in infos),
        "duration_s": contents.t_end_s,
        "operator": told.get("operator", ""),
        "bench": told.get("bench", ""),
        "has": {kind: is_there(path, kind, contents.digest) for kind in KINDS},
        "says": died_says(path) if status == DIED and not contents.finished else "",
        **_integrity(contents),
    }


def _integrity(contents: Contents) -> dict[str, Any]:
    """Whether recording, documents and reports agree with the campaign's manifest; the samples are not read."""
    folder = contents.path
    if not (folder / MANIFEST).exists():
        return {}
    try:
        entries = entries_of(folder)
        found = {RECORDING: integrity(entries.get(RECORDING), folder / RECORDING, contents.digest)}
        there = [file for file in files_of(folder) if file.exists()]
        found |= {file.name: integrity(entries.get(file.name), file) for file in there}
    except (UsageError, OSError) as err:
        return {"integrity": "altered", "altered": f"{MANIFEST}: {' '.join(str(err).split())}"}
    if changed := [name for name, said in found.items() if said == "altered"]:
        says = f"{listed(changed)}: altered since the manifest of this campaign was written; benchctl verify names more"
        return {"integrity": "altered", "altered": says}
    return {"integrity": "verified" if found[RECORDING] == "verified" else "not verified"}


def _by_its_description(folder: Path) -> dict[str, Any]:
    """An open recording whose samples, text, have not been read yet: as `recording.json` states it."""
    told = read_description(folder)
    lasts_s = sum((step.t_end or 0.0) - (step.t_start or 0.0) for step in told.steps)
    return _blank(folder) | {
        "unit": told.unit.serial,
        "model": told.unit.model,
        "status": "imported",
        "steps_whole": len(told.steps),
        "samples": round(lasts_s * told.bench.sample_rate_hz),
        "duration_s": max((step.t_end or 0.0 for step in told.steps), default=0.0),
        "has": {kind: is_there(folder, kind, "") for kind in KINDS},
    }


def _blank(path: Path) -> dict[str, Any]:
    return {
        "name": path.name if path.is_dir() else path.stem,
        "procedure": "",
        "unit": "",
        "model": "",
        "status": "",
        "started_utc": "",
        "steps_planned": None,
        "steps_whole": 0,
        "samples": 0,
        "duration_s": 0.0,
        "operator": "",
        "bench": "",
        "has": dict.fromkeys(KINDS, False),
        "says": "",
        "integrity": "not verified",
        "altered": "",
    }
