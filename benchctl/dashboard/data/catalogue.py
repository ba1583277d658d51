"""The campaigns below a folder, with ids that do not reveal their paths, and their entries in the list."""

from __future__ import annotations

import builtins
import hashlib
import json
import os
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import benchctl
from benchctl.atomic import whole_file
from benchctl.confined import stat_of, walk
from benchctl.dashboard.data.contents import (
    DIED,
    Contents,
    cache_folder,
    contents_of,
    died_says,
    import_of,
    recording_in,
    status_of,
)
from benchctl.dashboard.data.documents import KINDS, files_of, is_there
from benchctl.dashboard.data.events import lines_after
from benchctl.documents import read_json
from benchctl.limits import MOST_DESCRIPTION_BYTES, listed
from benchctl.recordings.campaign_manifest import MANIFEST, entries_of, integrity
from benchctl.recordings.descriptions import read_meta
from benchctl.recordings.hdf5_files import open_ours
from benchctl.recordings.hdf5_guard import attribute
from benchctl.recordings.import_open import OPEN_DESCRIPTION, read_description
from benchctl.recordings.journal import planned_steps
from benchctl.recordings.reader import is_open_recording
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, JOURNAL, RECORDING, STEPS, UNREADABLE
from benchctl_instruments.errors import UsageError

_NOT_COUNTED = "its steps are not counted yet"


def entry_of(path: Path) -> dict[str, Any]:
    """Return the list entry of a campaign without its id; an unreadable one has status `unreadable` and the reason."""
    try:
        if is_open_recording(path) and not import_of(path, cache_folder()).exists():
            return _by_its_description(path)
        contents = contents_of(path)
        planned = planned_steps(event for _, event in lines_after(path, 0) if event is not None)
        return _read(contents, planned)
    except (UsageError, OSError) as err:
        return _blank(path) | {"status": "unreadable", "says": " ".join(str(err).split())}


def brief_entry_of(path: Path) -> dict[str, Any]:
    """Return an entry as `entry_of` does, but read only a recording's root: fast, without the data of its steps."""
    file = recording_in(path)
    if file is None:  # an unfinished campaign or an open recording: both are fast to list
        return entry_of(path)
    try:
        with open_ours(file) as opened:
            contents = Contents(path, read_meta(opened), (), str(attribute(opened, "digest", "")))
    except (UsageError, OSError, ValueError) as err:
        return _blank(path) | {"status": "unreadable", "says": " ".join(str(err).split())}
    return _read(contents, None) | {"says": _NOT_COUNTED}


def _read(contents: Contents, planned: int | None) -> dict[str, Any]:
    path, provenance, unit = contents.path, contents.meta.provenance, contents.meta.unit
    infos = [piece.info for piece in contents.pieces]
    complete = [info for info in infos if info.whole and (planned is None or info.index <= planned)]
    status = status_of(contents)
    return _blank(path) | {
        "procedure": provenance.get("procedure", ""),
        "unit": unit.serial,
        "model": unit.model,
        "status": status,
        "started_utc": provenance.get("started_utc", ""),
        "steps_planned": planned,
        "steps_whole": len(complete),
        "samples": sum(info.samples for info in infos),
        "duration_s": contents.t_end_s,
        "operator": provenance.get("operator", ""),
        "bench": provenance.get("bench", ""),
        "has": {kind: is_there(path, kind, contents.digest) for kind in KINDS},
        "says": died_says(path) if status == DIED and not contents.finished else "",
        **_integrity(contents),
    }


def _integrity(contents: Contents) -> dict[str, Any]:
    """Check recording, documents and reports against the campaign's manifest; the samples are not read."""
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
    if changed := [name for name, state in found.items() if state == "altered"]:
        message = (
            f"{listed(changed)}: altered since the manifest of this campaign was written; benchctl verify names more"
        )
        return {"integrity": "altered", "altered": message}
    return {"integrity": "verified" if found[RECORDING] == "verified" else "not verified"}


def _by_its_description(folder: Path) -> dict[str, Any]:
    """Return the entry of an open recording whose text samples are not imported yet, from `recording.json`."""
    description = read_description(folder)
    lasts_s = sum((step.t_end or 0.0) - (step.t_start or 0.0) for step in description.steps)
    return _blank(folder) | {
        "unit": description.unit.serial,
        "model": description.unit.model,
        "status": "imported",
        "steps_whole": len(description.steps),
        "samples": round(lasts_s * description.bench.sample_rate_hz),
        "duration_s": max((step.t_end or 0.0 for step in description.steps), default=0.0),
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


_ID_DIGITS = 16
_FRESH_S = 1.0
"""Time for which an answer is reused: a page requests it every few seconds, and there may be many pages."""
_PATIENCE_S = 3.0
"""Maximum time for reading campaigns for one list."""
_FORMAT = f"benchctl-catalogue/1 {benchctl.__version__}"

Known = tuple[str, dict[str, Any]]
"""The stamp of a campaign's files when it was read, and its entry."""


class Catalogue:
    """The campaigns anywhere below `root`; the entries of finished ones are stored in `cache`.

    For a folder with hundreds of unknown campaigns, the first lists contain some of which only the root was read: their
    steps are counted in later calls. The class is thread-safe. Nothing is written below `root`.
    """

    def __init__(self, root: Path, cache: Path) -> None:
        self._root = root
        name = hashlib.sha256(os.fsencode(root.resolve())).hexdigest()[:32]
        self._kept = cache / f"catalogue-{name}.json"
        self._known: dict[str, Known] | None = None
        self._places: dict[str, Path] = {}
        self._listed: builtins.list[dict[str, Any]] = []
        self._listed_s = -_FRESH_S
        self._lock = threading.Lock()

    def list(self) -> builtins.list[dict[str, Any]]:
        """Return an entry for each campaign, newest first; an unreadable one contains the reason."""
        with self._lock:
            if time.monotonic() - self._listed_s >= _FRESH_S:
                self._look()
            return [dict(entry) for entry in self._listed]

    def find(self, key: str) -> Path | None:
        """Return the path of the campaign with that id; None if there is none below the folder now."""
        with self._lock:
            path = self._places.get(key)
            if path is None and time.monotonic() - self._listed_s >= _FRESH_S:
                self._look()
                path = self._places.get(key)
        return path if path is not None and self._is_inside(path) else None

    def id_of(self, path: Path) -> str:
        """Return the id of a path below the folder, whether there is a campaign or not."""
        return _id_of(path, self._root)

    def id_of_new(self, path: Path) -> str:
        """Return the id of a campaign that has begun just now; the list, which is reused for a while, is made anew."""
        with self._lock:
            self._look()
        return self.id_of(path)

    def entry(self, key: str) -> dict[str, Any]:
        """Return the entry of one campaign; `UsageError` for an unknown id."""
        path = self.find(key)
        if path is None:
            raise UsageError("there is no such campaign; it may have been moved or removed")
        with self._lock:
            return {"id": key, **self._entry(path)}

    def _is_inside(self, path: Path) -> bool:
        """Return whether a path still exists and is not a link to a place outside the root."""
        root = self._root.resolve()
        return path.exists() and path.resolve().is_relative_to(root)

    def _look(self) -> None:
        before = dict(self._kept_entries())
        places = {_id_of(path, self._root): path for path in campaigns_below(self._root)}
        give_up_s = time.monotonic() + _PATIENCE_S
        listed, all_read = [], True
        for key, path in sorted(places.items(), key=lambda place: _changed_ns(place[1]), reverse=True):
            entry = self._known_entry(path)
            if entry is None and time.monotonic() < give_up_s:
                entry = self._entry(path)
            all_read &= entry is not None
            listed.append({"id": key, **(entry or brief_entry_of(path))})
        # two sorts: names ascend for campaigns with the same start, or without one
        listed.sort(key=lambda entry: str(entry["name"]))
        listed.sort(key=lambda entry: str(entry["started_utc"]), reverse=True)
        known = self._kept_entries()
        for gone in known.keys() - {str(path) for path in places.values()}:
            del known[gone]
        self._places, self._listed = places, listed
        if known != before:
            self._keep(known)
        self._listed_s = time.monotonic() if all_read else -_FRESH_S

    def _known_entry(self, path: Path) -> dict[str, Any] | None:
        """Return the entry of a campaign without its id, if it is known and its files have not changed."""
        found = self._kept_entries().get(str(path))
        return dict(found[1]) if found is not None and found[0] == _stamp_of(path) else None

    def _entry(self, path: Path) -> dict[str, Any]:
        """Return the entry of a campaign without its id."""
        if (entry := self._known_entry(path)) is not None:
            return entry
        known, stamp = self._kept_entries(), _stamp_of(path)
        entry = entry_of(path)
        if stamp and entry["status"] != "unreadable":  # permissions change without a change in size and time
            known[str(path)] = stamp, entry
        return dict(entry)

    def _kept_entries(self) -> dict[str, Known]:
        """Return the entries of finished campaigns by path, initially those from the cache."""
        if self._known is None:
            self._known = {}
            with suppress(UsageError, TypeError, ValueError):  # damaged: replaced
                kept = read_json(self._kept, "catalogue") if self._kept.exists() else {}
                if isinstance(kept, dict) and kept.get("format") == _FORMAT:
                    self._known = {path: (str(stamp), dict(entry)) for path, (stamp, entry) in kept["entries"].items()}
        return self._known

    def _keep(self, known: Mapping[str, Known]) -> None:
        text = json.dumps({"format": _FORMAT, "entries": known}, ensure_ascii=True)
        if len(text) > MOST_DESCRIPTION_BYTES:
            return  # it would not be read again
        with suppress(UsageError, OSError):  # the list does not depend on it
            self._kept.parent.mkdir(parents=True, exist_ok=True)
            with whole_file(self._kept) as temporary:
                temporary.write_text(text, encoding="ascii")


def _id_of(path: Path, root: Path) -> str:
    return hashlib.sha256(os.fsencode(path.relative_to(root).as_posix())).hexdigest()[:_ID_DIGITS]


def _changed_ns(path: Path) -> int:
    """Return the approximate time of a campaign's last change: new ones are read first."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def _stamp_of(path: Path) -> str:
    """Return the stamp of a finished campaign's files and documents; empty for one that may continue."""
    if is_open_recording(path):
        try:
            files = [path / OPEN_DESCRIPTION, import_of(path, cache_folder())]
        except UsageError:
            return ""
    elif (file := recording_in(path)) is not None:
        files = [file]
    else:
        return ""
    entries = []
    for one in [*files, *files_of(path), path / MANIFEST]:
        with suppress(OSError):
            stat = stat_of(one)
            entries.append(f"{one.name} {stat.st_size} {stat.st_mtime_ns}")
    return ", ".join(entries)


_MOST_FOLDERS = 1 << 16


def campaigns_below(root: Path) -> Iterator[Path]:
    """Yield the folders and files of campaigns and recordings anywhere below a folder, including itself.

    A campaign is represented by its folder; other recordings in it are yielded as well. Hidden folders and links are
    left out: targets of links inside the folder are found without them, and other targets are outside.
    """
    for count, (here, folders, names) in enumerate(walk(root)):
        if count == _MOST_FOLDERS:
            return
        begun = STEPS in folders and JOURNAL in names
        is_campaign = begun or CAMPAIGN in names or RECORDING in names
        inner = {STEPS, UNREADABLE} if is_campaign else set()
        folders[:] = sorted(name for name in folders if not name.startswith(".") and name not in inner)
        if (is_campaign and not (here / RECORDING).is_symlink()) or is_open_recording(here):
            yield here
        for name in sorted(names):
            path = here / name
            ours = name.endswith(FINISHED_SUFFIX) and name not in (CAMPAIGN, RECORDING) and not name.startswith(".")
            if ours and path.is_file() and not path.is_symlink():
                yield path
