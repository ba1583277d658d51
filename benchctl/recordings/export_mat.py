"""Writes a recording as a MATLAB file (version 5, which every MATLAB and Octave loads)."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from scipy.io import savemat

from benchctl.atomic import whole_file
from benchctl.recordings.model import Step
from benchctl.recordings.reader import Recording
from benchctl.recordings.schema import unit_of
from benchctl_instruments.errors import UsageError

_LARGEST = 2**31 - 1
"""Bytes that one variable of this file format may have."""


def export_mat(recording: Recording, path: Path) -> None:
    """Write a struct `recording` with everything that is not a sample, and a struct `step_0001` a step.

    A step's fields are its description and its channels, columns of shape (n, 1); `recording.units` names their
    units. What is not known is left out. Raises `UsageError` where a step is larger than the format admits, or the
    disk refuses.
    """
    with whole_file(path) as temporary:
        savemat(
            temporary,
            _Variables(recording),
            appendmat=False,
            long_field_names=True,
            do_compression=True,
            oned_as="column",
        )


class _Variables(Mapping[str, Any]):
    """The variables of the file, each step loaded when its turn to be written comes."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording

    def __getitem__(self, name: str) -> Any:
        if name == "recording":
            return _describe(self._recording)
        return _struct(self._recording.step(int(name.removeprefix("step_"))))

    def __iter__(self) -> Iterator[str]:
        yield "recording"
        yield from (f"step_{info.index:04d}" for info in self._recording.infos)

    def __len__(self) -> int:
        return 1 + len(self._recording.infos)


def _describe(recording: Recording) -> dict[str, Any]:
    meta = recording.meta
    names = dict.fromkeys(name for info in recording.infos for name in recording.channels(info.index))
    return {
        "digest": recording.digest,
        "status": meta.status,
        "unit": _known(asdict(meta.unit)),
        "bench": _known(asdict(meta.bench)),
        "provenance": {_field(name): text for name, text in meta.provenance.items()},
        "simulation": json.dumps(meta.simulation),
        "extra": json.dumps(dict(meta.extra)),
        "units": _known({name: unit_of(name, meta) for name in names}),
    }


def _struct(step: Step) -> dict[str, Any]:
    if sum(samples.nbytes for samples in step.channels.values()) > _LARGEST:
        raise UsageError(
            f"step {step.info.index} {step.info.name!r} is larger than 2 GiB, which a MAT file cannot hold; use netcdf"
        )
    return {**_known({**asdict(step.info), "mounting": step.info.mounting or None}), **step.channels}


def _known(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _field(name: str) -> str:
    """A name that MATLAB accepts for a field."""
    return re.sub(r"[^A-Za-z0-9_]", "_", name)[:63]
