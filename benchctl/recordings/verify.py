"""Check a recording against its digests, and a campaign against its manifest; report what changed, by name.

`summarise` lists the content of a recording, as `benchctl show` prints it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from benchctl.recordings.campaign_manifest import MANIFEST, problems_of_folder
from benchctl.recordings.digests import Known, Mismatch, ReadDigests, problems_of_recording
from benchctl.recordings.hdf5_files import open_ours
from benchctl.recordings.model import StepInfo, axis_of
from benchctl.recordings.reader import Recording, campaign_files, open_recording
from benchctl.recordings.schema import CAMPAIGN, PART_SUFFIX, RECORDING, unit_of
from benchctl_instruments.errors import UsageError


def verify(path: Path) -> list[Mismatch]:
    """Check every digest of a benchctl file or a campaign's folder; an empty list means that nothing changed.

    A changed, added or deleted sample, attribute, channel, group or step is named, and in a finished campaign every
    such file, including its manifest. In an unfinished campaign, which has no manifest yet, every step's file is
    checked separately, and the step being written, which has no digests yet, is a problem.

    Raises `UsageError` if the recording cannot be opened at all and there is no manifest to explain the reason, or if
    it is an open recording, which has no digests.
    """
    if not (path / MANIFEST).exists():
        problems = _problems_of_recording(path)
        if path.is_dir() and (path / RECORDING).exists():
            text = f"is not there, the campaign's other files cannot be checked; verify {RECORDING} by itself"
            problems.append(Mismatch(MANIFEST, text))
        return problems
    problems = list(problems_of_folder(path))
    if not (path / RECORDING).exists() and not (path / CAMPAIGN).exists():
        return problems
    try:
        return [*_problems_of_recording(path), *problems]
    except UsageError as err:
        return [Mismatch("recording", str(err)), *problems]


@contextmanager
def opened_unchanged(paths: Sequence[Path], therefore: str) -> Iterator[list[Recording]]:
    """Yield recordings open for reading, and raise at the end what `refuse_changed` raises about them.

    Samples that were read meanwhile are not read again for their digest. Therefore no final result may be written
    inside the `with`. A changed manifest is reported before any other problem.
    """
    digests = [ReadDigests() for _ in paths]
    try:
        with ExitStack() as stack:
            yield [stack.enter_context(open_recording(*each)) for each in zip(paths, digests, strict=True)]
    except UsageError:
        for path in paths:
            refuse_changed(path, therefore)
        raise
    for path, read in zip(paths, digests, strict=True):
        refuse_changed(path, therefore, read)


def refuse_changed(path: Path, therefore: str, read: ReadDigests | None = None) -> None:
    """Raise `UsageError` if a recording no longer has its digest; `therefore` is the action that is then refused.

    A foreign recording, and an unfinished campaign, has no digest and passes. Samples that `read` contains are not read
    again.
    """
    if path.is_dir() and not (path / RECORDING).exists():
        return
    with open_ours(path / RECORDING if path.is_dir() else path) as file:
        problems = list(problems_of_recording(file, _known_by(read)))
    if problems:
        more = f" (and {len(problems) - 1} more: benchctl verify names them)" if len(problems) > 1 else ""
        raise UsageError(
            f"{path}: changed since it was written, and so not {therefore}: {problems[0]}{more}; "
            "take it from where it was copied"
        )


def _known_by(read: ReadDigests | None) -> Known:
    """Return the digests of `read` by the names of groups; the name of a step's group is its index."""
    if read is None:
        return lambda step, channel: None
    return lambda step, channel: read.of(int(step), channel) if step.isdecimal() and step.isascii() else None


def _problems_of_recording(path: Path) -> list[Mismatch]:
    if not path.is_dir():
        return _problems_of_file(path)
    if (path / RECORDING).exists():
        return _problems_of_file(path / RECORDING)
    if not (path / CAMPAIGN).exists():
        raise UsageError(
            f"{path}: has no digests to check; only recordings of benchctl have them (benchctl import makes one)"
        )
    problems = _problems_of_file(path / CAMPAIGN)
    for file in campaign_files(path):
        if file.name.endswith(PART_SUFFIX):
            problems.append(Mismatch(file.name, "was not finished: it is being written, or its program died"))
        else:
            problems += [Mismatch(f"{file.name}, {one.where}", one.message) for one in _problems_of_file(file)]
    return problems


def _problems_of_file(path: Path) -> list[Mismatch]:
    with open_ours(path) as file:
        return list(problems_of_recording(file))


def summarise(recording: Recording) -> dict[str, Any]:
    """Return the keys of `benchctl show --json`; reads all samples to check the digests.

    `status`; `steps` with `name`, `kind`, `role`, `whole`, `samples`, `t_start`, `t_end`, of a digital gyro also
    `frames_lost` and `frames_bad`, of a unit not mounted along also `mounting`; `channels` with `name`, `unit` and
    `rate_hz` (None for polled channels); `provenance`; `digest_ok` (None if a recording has no digests yet);
    `problems`, in words.
    """
    problems = [str(problem) for problem in verify(recording.path)] if recording.digest else []
    return {
        "status": recording.meta.status,
        "steps": [_step(info) for info in recording.infos],
        "channels": _channels(recording),
        "provenance": dict(recording.meta.provenance),
        "digest_ok": not problems if recording.digest else None,
        "problems": [*recording.notes, *problems],
    }


def _step(info: StepInfo) -> dict[str, Any]:
    keys = ("index", "name", "kind", "role", "whole", "samples", "gaps", "t_start", "t_end", "chamber_setpoint_c")
    frames = {key: value for key in ("frames_lost", "frames_bad") if (value := getattr(info, key)) is not None}
    mounting = {"mounting": info.mounting} if info.mounting else {}
    return {key: getattr(info, key) for key in keys} | frames | mounting


def _channels(recording: Recording) -> list[dict[str, Any]]:
    """Return every channel of any step, in the order of first appearance."""
    names = dict.fromkeys(name for info in recording.infos for name in recording.channels(info.index))
    rates_hz = {
        "time_s": _common(info.sample_rate_hz for info in recording.infos if info.samples),
        "frame_time_s": _common(info.frame_rate_hz for info in recording.infos if info.frame_rate_hz),
    }
    return [
        {
            "name": name,
            "unit": unit_of(name, recording.meta),
            "rate_hz": rates_hz.get(axis_of(name)),
        }
        for name in names
    ]


def _common(rates: Iterable[float | None]) -> float | None:
    """Return the rate of all steps, or None if they differ or do not state it."""
    found = set(rates)
    return found.pop() if len(found) == 1 else None
