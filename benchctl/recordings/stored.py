"""A step whose samples remain in the file and are read one stretch at a time, so that it need not fit into memory."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from benchctl.recordings.model import AXES, Step, StepInfo, axis_of
from benchctl.side_by_side import cores
from benchctl_instruments.arrays import FloatArray

SCANS_AT_ONCE = 1 << 18
"""Scans that are processed at once: 2 MiB per channel, complete chunks of a benchctl file."""
_SCANS = "time_s"


@dataclass(frozen=True, slots=True)
class StoredStep:
    """A step that is not in memory.

    `names` are all its channels; those on the axis `time_s` have `scans` samples, those on `poll_time_s` `polls`,
    those on `frame_time_s` `frames`. `fill` fills an array with samples of a channel, from a given scan on. Read in
    order, so that a recording can be digested while it is read.
    """

    info: StepInfo
    names: tuple[str, ...]
    scans: int
    fill: Callable[[str, int, FloatArray], None]
    polls: int = 0
    frames: int = 0

    def read(self, name: str, start: int, stop: int) -> FloatArray:
        """Return the samples `start:stop` of a channel."""
        samples = np.empty(stop - start)
        self.fill(name, start, samples)
        return samples

    def part(self, start: int, stop: int, names: Collection[str] | None = None) -> Step:
        """Return the scans `start:stop`, of these channels if given, as a step in memory."""
        part = self._empty(start, stop, names)
        for name, samples in part.channels.items():
            self.fill(name, start, samples)
        return part

    def parts(self, names: Collection[str] | None = None) -> Iterator[Step]:
        """Yield the step in parts of about `SCANS_AT_ONCE` scans; the next part is read while one is processed."""
        edges = [*range(0, max(self.scans - SCANS_AT_ONCE // 4, 1), SCANS_AT_ONCE), self.scans]
        if len(edges) == 2:
            yield self.part(0, self.scans, names)
            return
        with ThreadPoolExecutor(cores(), thread_name_prefix="reading") as pool:

            def begun(start: int, stop: int) -> Callable[[], Step]:
                part = self._empty(start, stop, names)
                filling = [pool.submit(self.fill, name, start, samples) for name, samples in part.channels.items()]

                def read() -> Step:
                    for filled in wait(filling).done:
                        filled.result()
                    return part

                return read

            stretches = pairwise(edges)
            coming = begun(*next(stretches))
            for stretch in stretches:
                here = coming()
                coming = begun(*stretch)
                yield here
                del here
            yield coming()

    def cut(self, info: StepInfo, start: int, stop: int) -> StoredStep:
        """Return the scans `start:stop` as a separate step with its own description."""
        return replace(
            self,
            info=info,
            scans=stop - start,
            fill=lambda name, first, samples: self.fill(name, start + first, samples),
        )

    def of(self, info: StepInfo, shift_s: float = 0.0) -> StoredStep:
        """Return the same samples with another description and shifted stamps."""

        def fill(name: str, start: int, samples: FloatArray) -> None:
            self.fill(name, start, samples)
            if name in AXES:
                samples += shift_s

        return replace(self, info=info, fill=fill)

    def _empty(self, start: int, stop: int, names: Collection[str] | None) -> Step:
        """Return a part not filled yet; one block holds all channels, large enough for the system's large pages."""
        wanted = [name for name in self.names if axis_of(name) == _SCANS and (names is None or name in names)]
        return Step(self.info, dict(zip(wanted, np.empty((len(wanted), stop - start)), strict=True)))


def stored_of(step: Step) -> StoredStep:
    """Return a step that is in memory as a `StoredStep`."""
    scans, polls, frames = (len(step.channels.get(axis, ())) for axis in AXES)

    def fill(name: str, start: int, samples: FloatArray) -> None:
        samples[:] = step.channels[name][start : start + samples.size]

    return StoredStep(step.info, tuple(step.channels), scans, fill, polls, frames)
