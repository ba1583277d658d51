"""Open a recording from any source, with one step in memory at a time; recordings of one unit can be joined.

The folder of an unfinished campaign shows whether its program runs, has ended or has died.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Protocol, Self

from benchctl.confined import entries_in
from benchctl.locks import is_held
from benchctl.recordings.digests import ReadDigests
from benchctl.recordings.hdf5_files import RecordingFile
from benchctl.recordings.import_open import OPEN_DESCRIPTION, read_open_recording
from benchctl.recordings.journal import events_in, journal_text, last_word
from benchctl.recordings.model import AXES, Meta, Step, StepInfo
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, JOURNAL, LOCK, PART_SUFFIX, RECORDING, STEPS
from benchctl.recordings.stored import StoredStep, stored_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError, reason


def described(folder: Path) -> Meta:
    """Return the description of a campaign at its start: without an end, a reason and a journal.

    It is taken from the first file that can be read; each step's file has it, too. Raises `UsageError` if none can.
    """
    unreadable: UsageError | None = None
    candidates = (folder / RECORDING, folder / CAMPAIGN, *sorted((folder / STEPS).glob("[0-9]*")))
    for file in filter(Path.exists, candidates):
        try:
            with closing(RecordingFile(file)) as opened:
                meta = opened.meta
        except UsageError as err:
            unreadable = unreadable or err
        else:
            begun = {name: text for name, text in meta.provenance.items() if name not in ("journal", "reason")}
            return replace(meta, status="running", provenance=begun)
    raise unreadable or UsageError(f"{folder}: is no campaign: expected {RECORDING} or {CAMPAIGN} in this folder")


def state_of(folder: Path) -> tuple[Meta, tuple[str, ...]]:
    """Return the description and the notes of an unfinished campaign; `running` only while its program runs.

    `Meta.provenance` holds the journal and, if the program has died, the `reason`.
    """
    meta = described(folder)
    journal = journal_text(folder / JOURNAL)
    provenance = {**meta.provenance, "journal": journal}
    if is_held(folder / LOCK):
        return replace(meta, provenance=provenance), ()
    status, reason = last_word(events_in(journal))
    note = (
        f"its recording is not closed ({reason or 'all steps are there'}): benchctl recover {folder} closes it, "
        f"benchctl run PROCEDURE --bench BENCH --resume {folder} goes on with it"
    )
    return replace(meta, status=status, provenance={**provenance, "reason": reason}), (note,)


def require_campaign(folder: Path) -> None:
    """Raise `UsageError` if a folder contains no campaign, or one that died before anything was described."""
    if (folder / RECORDING).exists() or (folder / CAMPAIGN).exists() or any((folder / STEPS).glob("[0-9]*")):
        return
    if (folder / STEPS).is_dir():
        raise UsageError(f"{folder}: its program died before anything was recorded; remove the folder and run anew")
    raise UsageError(f"{folder}: is no campaign: expected {RECORDING} or {CAMPAIGN} in this folder")


_OPEN_AT_ONCE = 128
"""Maximum number of open step files of an unfinished campaign: far fewer than a process may have open."""


def is_open_recording(path: Path) -> bool:
    """Return whether a folder contains an open recording and no benchctl files."""
    return (path / OPEN_DESCRIPTION).exists() and not any((path / name).exists() for name in (RECORDING, CAMPAIGN))


class StepSource(Protocol):
    """The source of the samples of steps."""

    def channels(self, index: int) -> tuple[str, ...]:
        """Return the names of a step's channels."""

    def load(self, info: StepInfo, names: Collection[str] | None = None) -> Step:
        """Return a step with its samples; of these channels if given."""

    def stored(self, info: StepInfo) -> StoredStep:
        """Return a step whose samples are read one stretch at a time."""

    def close(self) -> None:
        """Close what is open; safe to call twice."""


class Recording:
    """A recording that is open for reading; `with` closes it. Created by `open_recording`.

    Attributes
    ----------
    path
        The path that was opened.
    meta
        Everything that is not a sample; of a campaign, its journal (JSON lines) is `meta.provenance["journal"]`.
    infos
        The steps, in order of their index.
    digest
        The digest of the recording; empty if there is none: an unfinished campaign, an open recording.
    notes
        What was found damaged and left out, in words.
    starts_s
        The start of each joined recording on the time axis of this one.
    """

    def __init__(
        self,
        path: Path,
        meta: Meta,
        infos: Collection[StepInfo],
        source: StepSource,
        *,
        digest: str = "",
        notes: tuple[str, ...] = (),
        starts_s: tuple[float, ...] = (0.0,),
    ) -> None:
        self.path = path
        self.meta = meta
        self.infos = tuple(sorted(infos, key=lambda info: info.index))
        self.digest = digest
        self.notes = notes
        self.starts_s = starts_s
        self._source = source
        self._by_index = {info.index: info for info in self.infos}

    def steps(self, kinds: Collection[str] | None = None, roles: Collection[str] | None = None) -> Iterator[Step]:
        """Yield the steps in order, each loaded when it is needed; of these kinds and roles if given."""
        for info in self.infos:
            if (kinds is None or info.kind in kinds) and (roles is None or info.role in roles):
                yield self._source.load(info)

    def stored_steps(self) -> Iterator[StoredStep]:
        """Return the steps in order, none of them loaded: for steps that may be larger than memory."""
        return map(self._source.stored, self.infos)

    def stored_step(self, index: int) -> StoredStep:
        """Return one step by its `info.index`, not loaded; `UsageError` if there is none."""
        return self._source.stored(self._info(index))

    def step(self, index: int, channels: Collection[str] | None = None) -> Step:
        """Return one step by its `info.index`, with these of its channels if given; `UsageError` if there is none."""
        return self._source.load(self._info(index), channels)

    def channels(self, index: int) -> tuple[str, ...]:
        """Return the names of a step's channels without loading them; raises `UsageError` if there is no such step."""
        return self._source.channels(self._info(index).index)

    def close(self) -> None:
        """Close the file; safe to call twice."""
        self._source.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _info(self, index: int) -> StepInfo:
        if index not in self._by_index:
            raise UsageError(
                f"{self.path}: there is no step {index}; it has the steps {[info.index for info in self.infos]}"
            )
        return self._by_index[index]


def open_recording(path: Path, digests: ReadDigests | None = None) -> Recording:
    """Open a benchctl file, a campaign's folder (running, dead or finished) or an open recording's folder.

    The samples of a finished benchctl recording are digested into `digests`, if given, while they are read.

    An unfinished campaign has its finished steps, and the step being written (`whole=False`) with the samples that have
    reached its file. Its status is `running` only while its program runs; a note states that it died.

    Raises `UsageError`, in one line, if there is nothing, no HDF5, HDF5 that benchctl did not write or that is newer
    than this program, or a truncated file.
    """
    if not path.is_dir():
        return _open_file(path, digests)
    if (path / RECORDING).exists():
        return _open_file(path / RECORDING, digests)
    if (path / CAMPAIGN).exists():
        return _open_campaign(path)
    if (path / OPEN_DESCRIPTION).exists():
        meta, steps = read_open_recording(path)
        return Recording(path, meta, [step.info for step in steps], StepsInMemory(steps))
    raise UsageError(f"{path}: is no recording: expected {RECORDING}, {CAMPAIGN} or {OPEN_DESCRIPTION} in this folder")


def _open_file(path: Path, digests: ReadDigests | None) -> Recording:
    file = RecordingFile(path, digests)
    return Recording(path, file.meta, file.infos, file, digest=file.digest)


def _open_campaign(folder: Path) -> Recording:
    files: dict[int, Path] = {}
    infos: list[StepInfo] = []
    meta, state_notes = state_of(folder)
    notes = [*state_notes]
    opened = lru_cache(_OPEN_AT_ONCE)(_open_step)
    for path in campaign_files(folder):
        try:
            infos += (found := opened(path).infos)
            files |= {info.index: path for info in found}
        except UsageError as err:
            if not path.name.endswith(PART_SUFFIX):
                raise UsageError(f"{err}; benchctl recover {folder} puts it aside and keeps the others") from err
            notes.append(f"left out: its writing had only begun ({err})")
    return Recording(folder, meta, infos, _CampaignFiles(files, opened, opened.cache_clear), notes=tuple(notes))


def campaign_files(folder: Path) -> list[Path]:
    """Return the files of an unfinished campaign's steps, in order; a `.part` only if its step is not finished.

    Empty if there is no folder of steps; raises `UsageError` if it cannot be read.
    """
    try:
        names = [name for name in entries_in(folder / STEPS) if name[:1].isdecimal()]
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as err:
        raise UsageError(f"{folder / STEPS}: cannot be read: {reason(err)}") from err
    finished = {name.removesuffix(FINISHED_SUFFIX): name for name in names if name.endswith(FINISHED_SUFFIX)}
    begun = {name.removesuffix(PART_SUFFIX): name for name in names if name.endswith(PART_SUFFIX)}
    return [folder / STEPS / name for _, name in sorted({**begun, **finished}.items())]


def _open_step(path: Path) -> RecordingFile:
    """Open a step's file; a `.part` may be finished, and so renamed, between two looks at the folder."""
    finished = path.with_name(f"{path.name.removesuffix(PART_SUFFIX)}{FINISHED_SUFFIX}")
    if path.name.endswith(PART_SUFFIX) and (finished.exists() or not path.exists()):
        return RecordingFile(finished)
    return RecordingFile(path)


class _CampaignFiles:
    """The steps of an unfinished campaign; the files that were used last stay open.

    A file is closed only when nothing refers to it any more.
    """

    def __init__(
        self, files: Mapping[int, Path], opened: Callable[[Path], RecordingFile], close: Callable[[], None]
    ) -> None:
        self._files, self._opened, self._close = files, opened, close

    def channels(self, index: int) -> tuple[str, ...]:
        return self._opened(self._files[index]).channels(index)

    def load(self, info: StepInfo, names: Collection[str] | None = None) -> Step:
        return self._opened(self._files[info.index]).load(info, names)

    def stored(self, info: StepInfo) -> StoredStep:
        def fill(name: str, start: int, samples: FloatArray) -> None:
            self._opened(self._files[info.index]).stored(info).fill(name, start, samples)

        return replace(self._opened(self._files[info.index]).stored(info), fill=fill)

    def close(self) -> None:
        """See `StepSource`."""
        self._close()


class StepsInMemory:
    """A `StepSource` of steps that are in memory."""

    def __init__(self, steps: Collection[Step]) -> None:
        self._steps = {step.info.index: step for step in steps}

    def channels(self, index: int) -> tuple[str, ...]:
        """See `StepSource`."""
        return tuple(self._steps[index].channels)

    def load(self, info: StepInfo, names: Collection[str] | None = None) -> Step:
        """See `StepSource`."""
        step = self._steps[info.index]
        return Step(info, {name: samples for name, samples in step.channels.items() if names is None or name in names})

    def stored(self, info: StepInfo) -> StoredStep:
        """See `StepSource`."""
        return stored_of(self._steps[info.index])

    def close(self) -> None:
        """Do nothing: no file is open."""


APART_S = 86400.0
"""Joined recordings are placed one day apart, because the bias has walked freely in between."""


def join(recordings: Sequence[Recording]) -> Recording:
    """Return one recording of the steps of all, renumbered, on one time axis, with the description of the first.

    The recordings stay open. Raises `UsageError` if they are of different units.
    """
    serials = sorted({recording.meta.unit.serial for recording in recordings})
    if len(serials) > 1:
        raise UsageError(f"these recordings are of different units: {', '.join(serials)}; take each by itself")
    first, *others = recordings
    if not others:
        return first
    infos: list[StepInfo] = []
    origins: dict[int, tuple[Recording, StepInfo]] = {}
    shift_s, starts_s = 0.0, list[float]()
    for recording in recordings:
        starts_s += [shift_s + start_s for start_s in recording.starts_s]
        before = max((info.index for info in infos), default=0)
        for info in recording.infos:
            moved = _moved(info, before, shift_s) if before else info
            infos.append(moved)
            origins[moved.index] = (recording, info)
        shift_s = max((info.t_end for info in infos), default=0.0) + APART_S
    notes = tuple(note for recording in recordings for note in recording.notes)
    return Recording(first.path, first.meta, infos, _Joined(origins), notes=notes, starts_s=tuple(starts_s))


def _moved(info: StepInfo, before: int, shift_s: float) -> StepInfo:
    return replace(info, index=before + info.index, t_start=info.t_start + shift_s, t_end=info.t_end + shift_s)


class _Joined:
    """Steps that are read from their own recordings and shifted in time."""

    def __init__(self, origins: dict[int, tuple[Recording, StepInfo]]) -> None:
        self._origins = origins

    def channels(self, index: int) -> tuple[str, ...]:
        recording, origin = self._origins[index]
        return recording.channels(origin.index)

    def load(self, info: StepInfo, names: Collection[str] | None = None) -> Step:
        recording, origin = self._origins[info.index]
        step = recording.step(origin.index, names)
        shift_s = info.t_start - origin.t_start
        if not shift_s:
            return Step(info, step.channels)
        return Step(info, {n: samples + shift_s if n in AXES else samples for n, samples in step.channels.items()})

    def stored(self, info: StepInfo) -> StoredStep:
        recording, origin = self._origins[info.index]
        return recording.stored_step(origin.index).of(info, info.t_start - origin.t_start)

    def close(self) -> None:
        """Do nothing: the caller closes the recordings."""
