"""Opens a recording, wherever it came from, one step in memory at a time."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Protocol, Self

from benchctl.confined import entries_in
from benchctl.recordings.campaign_state import state_of
from benchctl.recordings.hdf5_files import RecordingFile
from benchctl.recordings.import_open import read_open_recording
from benchctl.recordings.model import Meta, Step, StepInfo
from benchctl.recordings.read_digests import ReadDigests
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, PART_SUFFIX, RECORDING, STEPS
from benchctl.recordings.stored import StoredStep, stored_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError, reason

OPEN_DESCRIPTION = "recording.json"

_OPEN_AT_ONCE = 128
"""Files of an unfinished campaign's steps: far fewer than a process may have open."""


class StepSource(Protocol):
    """Where the samples of steps come from."""

    def channels(self, index: int) -> tuple[str, ...]:
        """The names of a step's channels."""

    def load(self, info: StepInfo, names: Collection[str] | None = None) -> Step:
        """A step with its samples; of these channels where given."""

    def stored(self, info: StepInfo) -> StoredStep:
        """A step whose samples stay where they are until a stretch of them is asked for."""

    def close(self) -> None:
        """Let go of what is open; safe to call twice."""


class Recording:
    """A recording that is open for reading; `with` closes it. Made by `open_recording`.

    Attributes
    ----------
    path
        What was opened.
    meta
        Everything that is not a sample; of a campaign, its journal (JSON lines) is `meta.provenance["journal"]`.
    infos
        The steps, in order of their index.
    digest
        The digest of the whole; empty where there is none: a campaign that is not finished, an open recording.
    notes
        What was found amiss and left out, in words.
    starts_s
        On the time axis of this one, where each recording that it was joined from begins.
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
        """The steps in order, each loaded when its turn comes; of these kinds and roles where given."""
        for info in self.infos:
            if (kinds is None or info.kind in kinds) and (roles is None or info.role in roles):
                yield self._source.load(info)

    def stored_steps(self) -> Iterator[StoredStep]:
        """The steps in order, none of them loaded: for those that may be larger than memory."""
        return map(self._source.stored, self.infos)

    def stored_step(self, index: int) -> StoredStep:
        """One step by its `info.index`, not loaded; `UsageError` where there is none."""
        return self._source.stored(self._info(index))

    def step(self, index: int, channels: Collection[str] | None = None) -> Step:
        """One step by its `info.index`, with these of its channels where given; `UsageError` where there is none."""
        return self._source.load(self._info(index), channels)

    def channels(self, index: int) -> tuple[str, ...]:
        """The names of a step's channels, without loading them; raises `UsageError` where there is no such step."""
        return self._source.channels(self._info(index).index)

    def close(self) -> None:
        """Let go of the file; safe to call twice."""
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
    """Open a recording: a file of ours, a campaign's folder (running, dead or finished) or an open recording's folder.

    What is read of a finished recording of ours is digested on the way into `digests`, where given.

    Of a campaign that is not finished: its finished steps, and the one being written (`whole=False`) with what has
    reached its file. Its status is `running` only while its program runs; of one that died a note says so.

    Raises `UsageError`, in one line, where there is nothing, no HDF5, HDF5 that is not ours or newer than this
    program, or a file that was cut short.
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
    meta, said = state_of(folder)
    notes = [*said]
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
    """The files of an unfinished campaign's steps, in order; a `.part` only where its step is not finished.

    None where there is no folder of steps; raises `UsageError` where it cannot be read.
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
    """A step's file; a `.part` may be finished, and so renamed, between two looks at the folder."""
    finished = path.with_name(f"{path.name.removesuffix(PART_SUFFIX)}{FINISHED_SUFFIX}")
    if path.name.endswith(PART_SUFFIX) and (finished.exists() or not path.exists()):
        return RecordingFile(finished)
    return RecordingFile(path)


class _CampaignFiles:
    """The steps of a campaign that is not finished; files stay open, those that were used last.

    A file that is in use is closed once it no longer is: when nothing refers to it any more.
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
        """Nothing is open."""
