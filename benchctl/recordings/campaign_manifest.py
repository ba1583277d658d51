"""The hash tree over a campaign's folder: a manifest of its files, so that any later change is found and named.

```
{"schema": "benchctl-campaign-manifest/1",
 "files": {"journal.jsonl": {"sha256": "…", "bytes": 2114},
           "recording.h5": {"sha256": "…", "bytes": 81920, "digest": "…"}, …},
 "digest": "…"}
```

`files` lists every file of the folder by its relative path with `/`; the `digest` of a recording is that of its root,
which covers its samples. The manifest's own `digest` is SHA-256 over `files` as JSON with sorted keys, without spaces,
in ASCII: it covers the entire campaign. Excluded are the manifest itself, locks, stop requests, and hidden files, which
belong to the system or are incomplete. Like the digests of a recording, the manifest reveals accidents and careless
edits. It is not a signature, unless its digest is kept elsewhere.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, Literal

from benchctl.atomic import disk_errors, whole_file
from benchctl.confined import open_file, stat_of
from benchctl.documents import read_json
from benchctl.limits import printable, require_file, shown
from benchctl.locks import Lock
from benchctl.recordings.digests import Mismatch
from benchctl.recordings.hdf5_files import RecordingFile
from benchctl.recordings.schema import ANSWER, LOCK, QUESTION, RECORDING, STOP
from benchctl_instruments.errors import UsageError, reason

MANIFEST = "manifest.json"
SCHEMA = "benchctl-campaign-manifest/1"

_TURN = ".manifest.lock"
"""Lock for adding to the manifest."""
_PATIENCE_S = 60.0
"""Time to wait for the lock: on a busy machine the turns of several programs take seconds."""
_LEFT_OUT = {MANIFEST, LOCK, str(Path(LOCK).with_suffix(".json")), STOP, QUESTION, ANSWER}

Entry = Mapping[str, Any]
Integrity = Literal["verified", "not verified", "altered"]
"""How a file agrees with its campaign's manifest; `not verified`: no manifest, or one that does not list the file."""


def write_manifest(folder: Path) -> None:
    """Write the manifest of a campaign's folder, in place of any earlier one.

    Raises `UsageError` if a file cannot be read or the disk refuses.
    """
    with disk_errors(folder / MANIFEST):
        files = {name: _entry(name, path) for name, path in _files(folder)}
    _write(folder, files)


def add_to_manifest(folder: Path, paths: Iterable[Path]) -> None:
    """Add new or replaced files of a campaign's folder to its manifest; the other entries stay.

    Programs that do this at the same time take turns, so that no entry is lost. Nothing is done if there is no manifest
    or it was changed, because this must not make a changed manifest valid. Raises what `write_manifest` raises, and
    `UsageError` if another program does not end its turn.
    """
    if not (folder / MANIFEST).exists():
        return
    added = {path.resolve() for path in paths}
    with disk_errors(folder / MANIFEST):
        entries = {name: _entry(name, path) for name, path in _files(folder) if path.resolve() in added}
    lock = Lock(folder / _TURN, f"{folder / MANIFEST}")
    lock.acquire("to add a result", _PATIENCE_S)
    try:
        if (sealed := _sound(folder)) is not None:
            _write(folder, sealed | entries)
    finally:
        lock.release()


def manifest_digest(folder: Path) -> str | None:
    """Return the digest of an entire campaign; None if it has no manifest, or one that was changed."""
    sealed = _sound(folder)
    return None if sealed is None else _digest(sealed)


def entries_of(folder: Path) -> Mapping[str, Entry]:
    """Return the entries of a campaign's manifest by the paths of the files; empty if there is no manifest.

    Raises `UsageError` if it cannot be used: it was changed, or has a later version.
    """
    return _read(folder) if (folder / MANIFEST).exists() else {}


def integrity(entry: Entry | None, path: Path, digest: str | None = None) -> Integrity:
    """Check a file against its entry in the manifest.

    If the `digest` of a recording's root is given, only it and the size are compared, without reading the samples.
    Raises OSError if the file cannot be read.
    """
    if entry is None:
        return "not verified"
    found = content_of(path) if digest is None else {"bytes": stat_of(path).st_size, "digest": digest}
    return "verified" if all(entry.get(key) == found[key] for key in found) else "altered"


def problems_of_folder(folder: Path) -> Iterator[Mismatch]:
    """Yield every file that differs from the manifest of a campaign's folder, which must exist; reads all files."""
    try:
        sealed = _read(folder)
    except UsageError as err:
        yield Mismatch(MANIFEST, str(err))
        return
    found = dict(_files(folder))
    for name in sorted(sealed.keys() | found.keys()):
        where = printable(name)
        if name not in found:
            yield Mismatch(where, "was deleted")
        elif name not in sealed:
            yield Mismatch(where, "was added since the manifest was written")
        elif difference := _difference(sealed[name], found[name]):
            yield Mismatch(where, difference)


def _difference(sealed: Entry, path: Path) -> str:
    """Return how a file differs from its entry, in words; empty if it does not."""
    try:
        found = content_of(path)
    except OSError as err:
        return f"cannot be read: {reason(err)}"
    if all(found[key] == sealed.get(key) for key in found):
        return ""
    if "digest" in sealed and sealed["digest"] != _root_digest(path):
        return "changed since it was written, and its own digest with it"
    if found["bytes"] != sealed.get("bytes"):
        return f"changed since it was written: it has {found['bytes']} bytes, had {shown(sealed.get('bytes'))}"
    return "changed since it was written"


def _files(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield the files that a manifest lists, with their path relative to the folder."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        name = "/".join(parts)
        if name not in _LEFT_OUT and not any(part.startswith(".") for part in parts) and path.is_file():
            yield name, path


def _entry(name: str, path: Path) -> Entry:
    return content_of(path) if name != RECORDING else {**content_of(path), "digest": _root_digest(path)}


def _root_digest(path: Path) -> str:
    """Return the digest of a recording's root; empty if it cannot be read."""
    try:
        with closing(RecordingFile(path)) as recording:
            return recording.digest
    except UsageError:
        return ""


def content_of(path: Path) -> Entry:
    """Return SHA-256 and size of a file; raises OSError if it cannot be read."""
    with open_file(path) as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        return {"sha256": sha256, "bytes": file.tell()}


def _write(folder: Path, files: Mapping[str, Entry]) -> None:
    content = {"schema": SCHEMA, "files": dict(sorted(files.items())), "digest": _digest(files)}
    with whole_file(folder / MANIFEST) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _sound(folder: Path) -> dict[str, Entry] | None:
    """Return the entries of a manifest; None if there is none, or it was changed."""
    try:
        return _read(folder) if (folder / MANIFEST).exists() else None
    except UsageError:
        return None


def _read(folder: Path) -> dict[str, Entry]:
    """Return the entries of a manifest; raises `UsageError`, worded to follow its name, if it is invalid or changed."""
    try:
        require_file(folder / MANIFEST, "manifest ")
        content = read_json(folder / MANIFEST, "manifest")
    except UsageError as err:
        raise UsageError(f"cannot be used: {err}") from err
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        found = content.get("schema") if isinstance(content, dict) else content
        raise UsageError(
            f"expected schema {SCHEMA!r}, got {shown(found)}: it was changed, or this benchctl is "
            "older; update benchctl"
        )
    files = content.get("files")
    if not isinstance(files, dict) or not all(isinstance(entry, dict) for entry in files.values()):
        raise UsageError("its files are no table of tables: it was changed; take the campaign from where it was copied")
    if content.keys() != {"schema", "files", "digest"} or content["digest"] != _digest(files):
        raise UsageError(
            "its entries or its digest were changed; nothing can be held against it; "
            "take the campaign from where it was copied"
        )
    return files


def _digest(files: Mapping[str, Entry]) -> str:
    return hashlib.sha256(json.dumps(files, sort_keys=True, separators=(",", ":")).encode("ascii")).hexdigest()
