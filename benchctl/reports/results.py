"""The folder of results, and the digest and name of the recording that they belong to."""

from __future__ import annotations

import os
from pathlib import Path

from benchctl.documents import json_document
from benchctl.limits import shown
from benchctl.recordings.reader import Recording, is_open_recording
from benchctl.recordings.schema import RECORDING
from benchctl_instruments.errors import UsageError, reason


def make_folder(folder: Path) -> None:
    """Create a folder for results; raises `UsageError` if it cannot be created or written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        raise UsageError(f"--out {folder}: cannot be made: {reason(err)}; name another place") from err
    if not os.access(folder, os.W_OK):
        raise UsageError(f"{folder}: may not be written to; name another place for the results with --out DIR")


def source_digest(recording: Recording) -> str:
    """Return the recording's own digest, or those of the source files of an imported recording.

    Raises `UsageError` if the list of those files does not have the format of an import.
    """
    if recording.digest:
        return recording.digest
    name = f"the sources that {recording.path} names"
    sources = json_document(recording.meta.provenance.get("sources", "{}"), name)
    try:
        return " ".join(str(source["sha256"]) for source in sources.values())
    except (AttributeError, KeyError, TypeError) as err:
        raise UsageError(f"{name}: expected a SHA-256 by each name, got {shown(sources)}; import them again") from err


def may_be_made(folder: Path) -> bool:
    """Return whether results could be written to a folder, judged by permissions; nothing is created."""
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    return there.is_dir() and os.access(there, os.W_OK | os.X_OK)


def results_folder(path: Path, kind: str = "diagnosis") -> Path:
    """Return the folder of the results on a recording: the campaign's folder, or one with its name and their `kind`.

    The latter is next to a file; for an open recording, which is not ours, it is in the current folder.
    """
    if path.is_dir():
        return Path(f"{name_of(path)}.{kind}") if is_open_recording(path) else path
    return path.parent if path.name == RECORDING else path.with_name(f"{path.stem}.{kind}")


def name_of(path: Path) -> str:
    """Return the name of a recording without its path; of a campaign the name of its folder."""
    path = path.resolve()
    return path.parent.name if path.name == RECORDING else path.name
