"""The layout of a recording in HDF5, and the conversion of descriptions to attributes.

```
/                       format, status, unit_*, bench_*, provenance_*, simulation (JSON), extra (JSON), manifest, digest
/steps/0001             name, kind, role, whole, t_start, t_end, rate_dps, …, manifest, digest; mounting if not along
/steps/0001/time_s      float64 (n,), s       dimension scale: the digitizer's scans
/steps/0001/gyro_v      float64 (n,), V       on time_s
/steps/0001/poll_time_s float64 (m,), s       dimension scale: the polls
/steps/0001/poll_gyro_v float64 (m,), V       on poll_time_s
/steps/0001/frame_time_s float64 (k,), s      dimension scale: a digital gyro's frames, if the bench has one
```

There is one group per step, named by the step's index, and one dataset per channel, with the attributes `units` (CF),
`long_name`, `digest` and, if needed, `comment`. Attributes are scalars: UTF-8 text, float64, int64 (`whole` is 0 or 1);
values that are not known are absent. No attribute, dataset or link needs this package or Python: the file is a valid
netCDF-4 file, `xarray.open_dataset(file, engine="h5netcdf", group="steps/0001")` opens a step, and so does MATLAB's
`h5read(file, "/steps/0001/gyro_v")`. HDF5 1.10 or newer reads it.

A running campaign is a folder with one file per step in this same layout, each with all root attributes and one group:
`steps/0001_name.h5` once it is finished, `steps/0002_name.h5.part` while it is written. A `.part` is uncompressed, has
no digests, has `whole = 0`, and opens with `swmr=True` (h5py) or `driver_kwds={"swmr": True}` (xarray), while it is
written and after a crash.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5s, h5t

from benchctl.limits import shown
from benchctl.recordings.model import DESCRIPTIONS, UNITS, Axis, Meta, StepInfo, axis_of
from benchctl.recordings.opening import reserve
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

FORMAT = "benchctl-recording/1"
STEPS = "steps"
"""The group of the steps in a file, and the folder of their files in a campaign."""
RECORDING = "recording.h5"
CAMPAIGN = "campaign.h5"
JOURNAL = "journal.jsonl"
LOCK = "running.lock"
"""Held by the process that writes a campaign's folder; `running.json` in the same folder states which one."""
STOP = "stop.json"
"""A request to stop the run that writes a campaign's folder, until it is obeyed; `benchctl.campaign.stop`."""
QUESTION, ANSWER = "question.json", "answer.json"
"""An open question of a run to an operator at the live page, and its answer; `benchctl.campaign.page_operator`."""
UNREADABLE = "unreadable"
"""Folder of a campaign for files of steps that a crash left unreadable."""
FINISHED_SUFFIX = ".h5"
PART_SUFFIX = ".h5.part"
CHUNK = 16384
"""Samples in a chunk of a finished dataset: 128 KiB, compressed separately, so that reading a part is cheap."""
GROWING_CHUNK = 4096
DEFLATE_LEVEL = 1

_CHANNEL_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def group_name(index: int) -> str:
    """Return the path of a step's group."""
    return f"{STEPS}/{index:04d}"


def unit_of(channel: str, meta: Meta) -> str | None:
    """Return the unit of a channel, from `Meta.extra["channel_units"]`, else from the model; None if not known."""
    unit: str | None = meta.extra.get("channel_units", {}).get(channel, UNITS.get(channel))
    return unit


def create_channels(group: h5py.Group, lengths: Mapping[str, int], meta: Meta) -> dict[str, h5py.Dataset]:
    """Create the datasets of a finished step, channel -> number of samples: compressed, labelled, with their axes."""
    packed = {"shuffle": True, "compression": "gzip", "compression_opts": DEFLATE_LEVEL}
    datasets = {}
    for name, length in lengths.items():
        storage = {"chunks": (min(length, CHUNK),), **packed} if length else {}
        datasets[name] = group.create_dataset(name, (length,), dtype="<f8", **storage)
    describe_channels(datasets, meta)
    return datasets


def create_growing_channels(group: h5py.Group, names: Iterable[str], meta: Meta) -> dict[str, h5py.Dataset]:
    """Create the datasets of a step being written: empty, uncompressed so that a chunk can grow in place."""
    storage = {"maxshape": (None,), "chunks": (GROWING_CHUNK,), "dtype": "<f8"}
    datasets = {name: group.create_dataset(name, (0,), **storage) for name in names}
    describe_channels(datasets, meta)
    return datasets


def channel_attributes(name: str, meta: Meta) -> dict[str, Plain]:
    """Return a channel's attributes without the digest: its unit if known, its long name, comments."""
    unit, comment = unit_of(name, meta), meta.extra.get("channel_comments", {}).get(name)
    return _known({"units": unit, "long_name": DESCRIPTIONS.get(name, name), "comment": comment})


def describe_channels(datasets: Mapping[str, h5py.Dataset], meta: Meta) -> None:
    """Write attributes of a step's channels and their axes for any reader, as netCDF-4 does."""
    for name, dataset in datasets.items():
        for key, value in channel_attributes(name, meta).items():
            write_attribute(dataset, key, value)
        if name == axis_of(name):
            dataset.make_scale(name)
    attach_axes(datasets)


def attach_axes(datasets: Mapping[str, h5py.Dataset]) -> None:
    """Attach each channel of a step to the dataset that is its time axis."""
    for name, dataset in datasets.items():
        if name != axis_of(name):
            dataset.dims[0].attach_scale(datasets[axis_of(name)])


def check_channels(where: str, channels: Mapping[str, FloatArray]) -> None:
    """Raise `UsageError` if channels do not form one step: names, shapes, a missing time axis, unequal lengths."""
    check_names(where, channels)
    for name, samples in channels.items():
        axis: Axis = axis_of(name)
        if samples.ndim != 1 or samples.dtype != np.float64:
            raise UsageError(
                f"{where}: channel {name} must be float64 of shape (n,), it is {samples.dtype} of shape {samples.shape}"
            )
        if samples.size != channels[axis].size:
            raise UsageError(
                f"{where}: channel {name} has {samples.size} samples, expected as many as its axis {axis}, "
                f"{channels[axis].size}"
            )


def check_names(where: str, channels: Mapping[str, object] | tuple[str, ...]) -> None:
    """Raise `UsageError` if a name is not valid for a channel, or the time axis of a channel is missing."""
    for name in channels:
        if not _CHANNEL_NAME.fullmatch(name):
            raise UsageError(
                f"{where}: channel {name!r} must be named with letters, digits and _, beginning with a letter"
            )
        if axis_of(name) not in channels:
            raise UsageError(
                f"{where}: channel {name} lies on {axis_of(name)}, which is not among the channels; give that, too"
            )


def info_attributes(info: StepInfo) -> dict[str, Plain]:
    """Return a step's attributes without the digest; values that are None are absent.

    `mounting` is also absent if the unit is mounted along the table's axis, the usual case.
    """
    values = {item.name: getattr(info, item.name) for item in fields(info) if item.name != "digest"}
    return _known({**values, "mounting": info.mounting or None})


def meta_attributes(meta: Meta) -> dict[str, Plain]:
    """Return the root's attributes: everything about a recording that is not a sample."""
    return _known(
        {
            "format": FORMAT,
            "Conventions": "CF-1.11",
            "status": meta.status,
            **{f"unit_{item.name}": getattr(meta.unit, item.name) for item in fields(meta.unit)},
            **{f"bench_{item.name}": getattr(meta.bench, item.name) for item in fields(meta.bench)},
            **{f"provenance_{name}": text for name, text in meta.provenance.items()},
            "simulation": None if meta.simulation is None else json.dumps(meta.simulation, ensure_ascii=False),
            "extra": json.dumps(meta.extra, ensure_ascii=False) if meta.extra else None,
        }
    )


def write_attributes(thing: h5py.Group, values: Mapping[str, Plain]) -> None:
    """Write attributes from `info_attributes` or `meta_attributes`; `UsageError` if HDF5 cannot store one of them."""
    for name, value in values.items():
        try:
            write_attribute(thing, name, value)
        except (ValueError, OverflowError) as err:
            raise UsageError(f"{name} = {shown(value)}: HDF5 cannot keep this: {err}; correct it") from err


def _known(values: Mapping[str, Any]) -> dict[str, Plain]:
    return {name: plain(value) for name, value in values.items() if value is not None}


Plain = str | int | float
"""The value of an attribute, as it is written and read."""

_TEXT = h5py.string_dtype()
_TEXT_TYPE = h5t.py_create(_TEXT, logical=True)
_LONG = 4096
"""Bytes of a text above which room is reserved; shorter texts are covered by HDF5's own records."""
_SCALAR = h5s.create(h5s.SCALAR)


def plain(value: str | float) -> Plain:
    """Return the value as it will be read once it is written: a boolean becomes the integer 0 or 1."""
    if isinstance(value, str):
        return value
    return int(value) if isinstance(value, bool | int | np.integer) else float(value)


def write_attribute(thing: h5py.Group | h5py.Dataset, name: str, value: str | float) -> None:
    """Write a new attribute, as `plain` converts it: UTF-8 text, int64 or float64.

    Raises `ValueError` or `OverflowError` if HDF5 cannot store the value, and what `reserve` raises.
    """
    kept = plain(value)
    if isinstance(kept, str):
        size = len(kept.encode("utf-8"))  # h5py would write lone surrogates as unreadable bytes
        if size > _LONG:
            reserve(thing.file, 2 * size)
        kind, stored = _TEXT_TYPE, np.array(kept, dtype=_TEXT)
    elif isinstance(kept, int):
        kind, stored = h5t.STD_I64LE, np.array(np.int64(kept))
    else:
        kind, stored = h5t.IEEE_F64LE, np.array(np.float64(kept))
    h5a.create(thing.id, name.encode("utf-8"), kind, _SCALAR).write(stored)
