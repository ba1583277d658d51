"""Store the results on a recording atomically: in a folder, local or at a URL.

The folder may exist (a campaign's, or that of earlier results, which may contain users' notes). Its files are written
one by one: the job's record is removed first and written last, so that an incomplete set of results is never taken for
a complete one.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from benchctl.atomic import disk_errors, whole_file
from benchctl.fleet.located import Located, filesystem, is_url, remote_errors
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.reports.fleet_stated import FleetVerb
from benchctl_instruments.errors import UsageError

KINDS: Mapping[FleetVerb, str] = {"fit": "fit", "diagnose": "diagnosis", "accept": "acceptance"}
"""Suffixes of the folders of results, the same as those of the single verbs."""


@dataclass(frozen=True, slots=True)
class LocalPlace:
    """A folder of results on a disk that all workers share; it may not exist yet.

    All methods raise `UsageError` on errors of the disk or of the filesystem of a URL.
    """

    where: str

    def read(self, name: str) -> bytes | None:
        """Return a file's content; None if it does not exist."""
        path = Path(self.where) / name
        with disk_errors(path):
            return path.read_bytes() if path.is_file() else None

    def names(self) -> set[str]:
        """Return the names of the existing files."""
        folder = Path(self.where)
        with disk_errors(folder):
            return {path.name for path in folder.iterdir()} if folder.is_dir() else set()

    def put(self, name: str, content: bytes) -> None:
        """Write one file atomically into the existing folder."""
        with whole_file(Path(self.where) / name) as temporary:
            temporary.write_bytes(content)

    def land(self, folder: Path, record: str, stale: set[str]) -> None:
        """Store all files of a local folder here, `record` last; `stale` are earlier files to be removed.

        Those in a campaign's folder are added to its manifest.
        """
        place = Path(self.where)
        with disk_errors(place):
            place.mkdir(parents=True, exist_ok=True)
            (place / record).unlink(missing_ok=True)
            names = sorted((path.name for path in folder.iterdir()), key=lambda name: name == record)
            for name in names:
                with whole_file(place / name) as temporary:
                    shutil.copyfile(folder / name, temporary)
            for name in stale - set(names):
                (place / name).unlink(missing_ok=True)
        add_to_manifest(place, [place / name for name in names])


@dataclass(frozen=True, slots=True)
class RemotePlace:
    """A folder at a URL. Its files are written one by one, the record last."""

    where: str

    def read(self, name: str) -> bytes | None:
        """See `LocalPlace`."""
        with remote_errors(self.where):
            system, path = filesystem(f"{self.where}/{name}")
            content: bytes | None = system.cat_file(path) if system.exists(path) else None
            return content

    def names(self) -> set[str]:
        """See `LocalPlace`."""
        with remote_errors(self.where):
            system, path = filesystem(self.where)
            found = system.ls(path, detail=False) if system.exists(path) else []
            return {entry.rstrip("/").rpartition("/")[2] for entry in found}

    def put(self, name: str, content: bytes) -> None:
        """See `LocalPlace`."""
        with remote_errors(self.where):
            system, path = filesystem(self.where)
            system.makedirs(path, exist_ok=True)
            system.pipe_file(f"{path}/{name}", content)

    def land(self, folder: Path, record: str, stale: set[str]) -> None:
        """See `LocalPlace`."""
        names = sorted((path.name for path in folder.iterdir()), key=lambda name: name == record)
        self._remove({record})
        for name in names:
            self.put(name, (folder / name).read_bytes())
        self._remove(stale - set(names))

    def _remove(self, names: set[str]) -> None:
        with remote_errors(self.where):
            system, path = filesystem(self.where)
            for name in names:
                if system.exists(f"{path}/{name}"):
                    system.rm_file(f"{path}/{name}")


Place = LocalPlace | RemotePlace


def place_of(recording: Located, verb: FleetVerb, out: str | None) -> Place:
    """Return the place of the results of a verb on a recording.

    Results on a local campaign are in its folder, as with the single verb; those on any other recording, and on fetched
    ones, are in a folder next to it: NAME.fit, NAME.diagnosis or NAME.acceptance. An open recording has NAME.open.fit,
    because the file that it was imported into may be next to it. With `out`, a folder or a URL, they are there, each in
    a folder whose name contains a digest of the recording's path, so that two with the same name do not collide.
    """
    name = f"{recording.name}.open" if recording.kind == "open" else recording.name
    if out is not None:
        name = f"{name}-{hashlib.sha256(recording.where.encode()).hexdigest()[:8]}"
        return _own(f"{out.rstrip('/')}/{name}.{KINDS[verb]}")
    if recording.kind == "campaign" and not recording.remote:
        return LocalPlace(recording.where)
    if "::" in recording.where or recording.where.startswith(("http://", "https://")):
        raise UsageError(
            f"{recording.where}: nothing can be written next to it; give --out, a folder or URL for all results"
        )
    return _own(f"{recording.where.rpartition('/')[0]}/{name}.{KINDS[verb]}")


def _own(where: str) -> Place:
    return RemotePlace(where) if is_url(where) else LocalPlace(where)
