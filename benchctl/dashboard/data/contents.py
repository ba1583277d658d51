"""The contents of a campaign: its status, its files, their steps and channels; each file is opened once.

A finished file never changes under its name without a change in size or modification time. Therefore its description is
kept in memory: of a running campaign only the file that is being written is opened again.

Open recordings, whose samples are text, are imported once into the cache and read from there.
"""

from __future__ import annotations

import os
import sys
import threading
from collections import OrderedDict
from collections.abc import Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import h5py

from benchctl.dashboard.data.cached import throw_out
from benchctl.dashboard.data.stored import Stamp
from benchctl.locks import is_held
from benchctl.recordings.descriptions import read_info, read_meta
from benchctl.recordings.hdf5_files import RecordingFile, open_ours
from benchctl.recordings.hdf5_guard import attribute, child, child_group, is_channel, names_in
from benchctl.recordings.import_open import OPEN_DESCRIPTION, read_open_recording, samples_of
from benchctl.recordings.model import Meta, StepInfo
from benchctl.recordings.reader import Recording, StepsInMemory, campaign_files, is_open_recording
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, LOCK, PART_SUFFIX, RECORDING, STEPS, group_name
from benchctl.recordings.writer import write_recording
from benchctl.reports.results import source_digest
from benchctl_instruments.errors import UsageError

MOST_BYTES = 1 << 30
"""Maximum size of the cached imports of open recordings."""

_ENDING = ".h5"


_lock = threading.Lock()


def imported(folder: Path, cache: Path) -> Path:
    """Return the import of an open recording; it is created if it does not exist.

    Raises
    ------
    UsageError
        If the open recording cannot be read, or its import cannot be written.
    """
    with _lock:  # the second thread finds it there
        place = import_of(folder, cache)
        if not place.exists():
            meta, steps = read_open_recording(folder)
            try:
                place.parent.mkdir(parents=True, exist_ok=True)
            except OSError as err:
                raise UsageError(f"{place.parent}: cannot be made: {err.strerror or err}") from err
            write_recording(place, meta, steps)
            throw_out(place.parent, _ENDING, MOST_BYTES, place)
        return place


def import_of(folder: Path, cache: Path) -> Path:
    """Return the path of an open recording's import, which may not exist yet; `UsageError` if there are no samples."""
    stamps = []
    for file in (folder / OPEN_DESCRIPTION, samples_of(folder)):
        with suppress(OSError):
            stamps.append(f"{file.resolve()} {Stamp.of(file)}")
    name = sha256(repr(stamps).encode("utf-8", "surrogateescape")).hexdigest()[:40]
    return cache / "imports" / f"{name}{_ENDING}"


def cache_folder() -> Path:
    """Return the folder of benchctl's caches, which may not exist yet; `BENCHCTL_CACHE` sets another."""
    if folder := os.environ.get("BENCHCTL_CACHE"):
        return Path(folder)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "benchctl" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "benchctl"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "benchctl"


def recording_in(path: Path) -> Path | None:
    """Return the file that holds the complete recording: the path itself or a file in it; None if there is none."""
    if not path.is_dir():
        return path
    return path / RECORDING if (path / RECORDING).exists() else None


_MOST_FILES = 4096
_ATTEMPTS = 5
"""Number of attempts to read a folder whose files are renamed meanwhile: one step at least is finished each time."""


@dataclass(frozen=True, slots=True)
class KnownFile:
    """A benchctl file at the time of `stamp`; `growing` if it is being written, or its writing was interrupted.

    `channels` has the names of the channels of each step, by its index. `meta` is None for the file of a single step;
    otherwise it does not contain the journal.
    """

    path: Path
    stamp: Stamp
    growing: bool
    meta: Meta | None
    infos: tuple[StepInfo, ...]
    channels: Mapping[int, tuple[str, ...]]
    digest: str


@dataclass(frozen=True, slots=True)
class StepInFile:
    """A step, and the file that contains it."""

    info: StepInfo
    file: KnownFile

    @property
    def channels(self) -> tuple[str, ...]:
        """The names of its channels."""
        return self.file.channels[self.info.index]


@dataclass(frozen=True, slots=True)
class Contents:
    """A campaign: its pieces in the order of time, `finished` if they are all in one recording.

    `notes` lists what was left out, `digest` identifies a finished recording.
    """

    path: Path
    meta: Meta
    pieces: tuple[StepInFile, ...]
    digest: str = ""
    finished: bool = True
    notes: tuple[str, ...] = ()

    @property
    def t_end_s(self) -> float:
        """The end of the last step, in seconds since the start of the recording."""
        return max((piece.info.t_end for piece in self.pieces), default=0.0)


class _Known:
    """A cache of descriptions of the most recently used files; thread-safe."""

    def __init__(self) -> None:
        self._files: OrderedDict[Path, KnownFile] = OrderedDict()
        self._lock = threading.Lock()

    def file(self, path: Path) -> KnownFile:
        """Return the description of a file; `UsageError` if it cannot be read."""
        stamp = _stamp_of(path)
        with self._lock:
            found = self._files.get(path)
            if found is not None and found.stamp == stamp and not found.growing:
                self._files.move_to_end(path)
                return found
        found = _read(path, stamp)
        with self._lock:
            self._files[path] = found
            self._files.move_to_end(path)
            while len(self._files) > _MOST_FILES:
                self._files.popitem(last=False)
        return found


_known = _Known()
known_file = _known.file


def contents_of(path: Path) -> Contents:
    """Return the current contents of a campaign, running or finished; of an open recording those of its import.

    Raises
    ------
    UsageError
        If there is none, or one of its files cannot be read.
    """
    for attempt in range(1, _ATTEMPTS + 1):
        try:
            if (file := recording_in(path)) is not None:
                return _of_recording(path, file)
            if is_open_recording(path):
                found = _of_recording(path, imported(path, cache_folder()))
                sources = Recording(path, found.meta, (), StepsInMemory(()))
                return replace(found, digest=source_digest(sources))
            return _of_campaign(path)
        except UsageError:
            # between two readings of the folder a step was finished, or the recording was assembled
            if attempt == _ATTEMPTS or not path.is_dir():
                raise
    raise AssertionError("the last attempt returns or raises")


def _of_recording(path: Path, file: Path) -> Contents:
    known = known_file(file)
    pieces = _in_order([StepInFile(info, known) for info in known.infos])
    return Contents(path, _described(known), pieces, known.digest)


def _of_campaign(folder: Path) -> Contents:
    meta = _described(known_file(folder / CAMPAIGN))
    pieces, notes = [], []
    for file in campaign_files(folder):
        try:
            known = known_file(file)
        except UsageError as err:
            finished = file.with_name(f"{file.name.removesuffix(PART_SUFFIX)}{FINISHED_SUFFIX}")
            if not file.name.endswith(PART_SUFFIX) or finished.exists() or not file.exists():
                raise
            notes.append(f"left out: its writing had only begun ({err})")
            continue
        pieces += [StepInFile(info, known) for info in known.infos]
    return Contents(folder, meta, _in_order(pieces), finished=False, notes=tuple(notes))


def _described(known: KnownFile) -> Meta:
    if known.meta is None:
        raise UsageError(f"{known.path}: is one step of a campaign; open the campaign's folder instead")
    return known.meta


def _in_order(pieces: list[StepInFile]) -> tuple[StepInFile, ...]:
    return tuple(sorted(pieces, key=lambda piece: (piece.info.t_start, piece.info.index)))


def _read(path: Path, stamp: Stamp) -> KnownFile:
    if path.name.endswith(PART_SUFFIX):
        with closing(RecordingFile(path)) as growing:
            channels = {info.index: growing.channels(info.index) for info in growing.infos}
            return KnownFile(path, stamp, True, None, growing.infos, channels, "")
    with open_ours(path) as file:
        try:
            meta = None if path.parent.name == STEPS else _without_journal(read_meta(file))
            infos, channels = _steps(child_group(file, STEPS))
            return KnownFile(path, stamp, False, meta, infos, channels, str(attribute(file, "digest", "")))
        except ValueError as err:
            raise UsageError(f"{path}: its description is damaged ({err}); benchctl verify names what changed") from err


def _steps(steps: h5py.Group) -> tuple[tuple[StepInfo, ...], dict[int, tuple[str, ...]]]:
    """Return the steps in a file and their channels; of steps with the same names only the first is checked."""
    infos, channels = [], {}
    looked_at: dict[tuple[str, ...], tuple[str, ...]] = {}
    for name in names_in(steps):
        group = child_group(steps, name)
        info = read_info(group)
        if f"{STEPS}/{name}" != group_name(info.index):
            raise ValueError(f"the group /{STEPS}/{name} states that its index is {info.index}")
        names = tuple(names_in(group))
        if names not in looked_at:
            looked_at[names] = tuple(one for one in names if is_channel(child(group, one)))
        infos.append(info)
        channels[info.index] = looked_at[names]
    return tuple(infos), channels


def _without_journal(meta: Meta) -> Meta:
    """Return the metadata without the journal, which may be large and is read from its file."""
    return replace(meta, provenance={name: text for name, text in meta.provenance.items() if name != "journal"})


def _stamp_of(path: Path) -> Stamp:
    try:
        return Stamp.of(path)
    except OSError as err:
        raise UsageError(f"{path}: cannot be read: {err.strerror or err}") from err


RUNNING, DIED = "running", "died"
_ENDS = ("complete", "interrupted", "aborted", "imported", "simulated")


def status_of(contents: Contents) -> str:
    """Return `running`, `died` (not closed, and its lock is not held), or the status stated in its recording."""
    if not contents.finished:
        return RUNNING if is_held(contents.path / LOCK) else DIED
    # a closed file with another status, such as running, was separated from its campaign, or changed
    return contents.meta.status if contents.meta.status in _ENDS else DIED


def died_says(path: Path) -> str:
    """Return the advice for a campaign that died."""
    resume = f"benchctl run PROCEDURE --bench BENCH --resume {path}"
    return f"its program died: benchctl recover {path} closes it, {resume} goes on with it"
