"""Digests of the samples that are read anyway: a recording is held against its seal without being read twice."""

from __future__ import annotations

from benchctl.recordings.digests import SampleDigest
from benchctl_instruments.arrays import FloatArray


class ReadDigests:
    """Of each channel that was read from its first sample to its last, in order; of others nothing is said.

    Channels may be read in several threads, each channel in one at a time.
    """

    def __init__(self) -> None:
        self._digests: dict[tuple[int, str], SampleDigest] = {}
        self._taken: dict[tuple[int, str], int] = {}
        self._lengths: dict[tuple[int, str], int] = {}

    def take(self, step: int, channel: str, length: int, start: int, samples: FloatArray) -> None:
        """Samples from `start` on were read of a channel of `length` samples in the step of this index."""
        key = step, channel
        taken = self._taken.get(key, 0)
        if not start <= taken < start + samples.size:
            return
        self._digests.setdefault(key, SampleDigest(length)).update(samples[taken - start :])
        self._taken[key], self._lengths[key] = start + samples.size, length

    def of(self, step: int, channel: str) -> str | None:
        """The digest of a channel that was read whole; None where it was not."""
        key = step, channel
        whole = key in self._taken and self._taken[key] == self._lengths[key]
        return self._digests[key].hexdigest() if whole else None
