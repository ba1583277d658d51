"""Seal a recording, so that any later change is found and named.

The digest covers the content, not the file: SHA-256 over a canonical form that does not depend on chunks and
compression. Each channel has the attribute `digest`; each step, and the root, has a `manifest` (canonical JSON: its
attributes, and the digests of its contents) and a `digest` of that manifest. The digest of the root therefore covers
the entire recording. A seal reveals accidents and careless edits. It is not a signature: a person who edits a recording
deliberately can seal it again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import h5py
import numpy as np

from benchctl.documents import json_document
from benchctl.limits import cut
from benchctl.recordings.descriptions import AXIS_ATTRIBUTES, attributes_of
from benchctl.recordings.hdf5_guard import (
    attribute,
    attribute_names,
    check_samples,
    child,
    child_group,
    names_in,
    plain_errors,
)
from benchctl.recordings.model import axis_of
from benchctl.recordings.opening import read_samples
from benchctl.recordings.schema import STEPS, Plain, write_attribute
from benchctl.side_by_side import cores, in_order
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

BLOCK = 1 << 17
"""Number of samples in memory at once, 1 MiB."""

Item: TypeAlias = h5py.Group | h5py.Dataset | h5py.Datatype
"""What a group may contain."""

Known = Callable[[str, str], str | None]
"""Returns the digest of the samples of a step's group and a channel, if they have been read already; else None."""

_LONG = 80
_HEX_DIGITS = 64


@dataclass(frozen=True, slots=True)
class Mismatch:
    """One difference from the written state: where it is, and what is wrong."""

    where: str
    message: str

    def __str__(self) -> str:
        return f"{self.where}: {self.message}"


@dataclass(frozen=True, slots=True)
class Written:
    """The attributes of a step, and channel -> attributes of that channel, without seals."""

    step: Mapping[str, Any]
    channels: Mapping[str, Mapping[str, Any]]


class SampleDigest:
    """SHA-256 of a channel, fed block by block: a line of JSON with dtype and shape, then little-endian float64."""

    def __init__(self, length: int) -> None:
        self._hash = hashlib.sha256(_canonical({"dtype": "<f8", "shape": [length]}) + b"\n")

    def update(self, block: FloatArray) -> None:
        """Add the next samples, shape (n,)."""
        self._hash.update(np.ascontiguousarray(block, dtype="<f8").data)

    def hexdigest(self) -> str:
        """Return the digest of all samples so far."""
        return self._hash.hexdigest()


def blocks(length: int, size: int = BLOCK) -> Iterator[slice]:
    """Return slices that cover `length` samples."""
    return (slice(start, min(start + size, length)) for start in range(0, length, size))


def digest_of(samples: FloatArray | h5py.Dataset) -> str:
    """Return the digest of a channel in memory or in a file, read block by block."""
    digest = SampleDigest(len(samples))
    for part in blocks(len(samples)):
        stored = isinstance(samples, h5py.Dataset)
        digest.update(read_samples(samples, part.start, part.stop) if stored else samples[part])
    return digest.hexdigest()


def seal_step(
    group: h5py.Group, channels: Mapping[str, h5py.Dataset], digests: Mapping[str, str], written: Written | None = None
) -> str:
    """Write the digests of a finished step, channel -> digest of its samples; return the digest of the step.

    `written` holds the attributes that were just written; None: they are read.
    """
    for name, digest in digests.items():
        _put(channels[name], "digest", digest)
    return _seal(group, _step_manifest(group, channels, digests) if written is None else _manifest_of(written, digests))


def seal_recording(root: h5py.Group, attributes: Mapping[str, Plain] | None = None) -> str:
    """Write the digest of a finished recording whose steps are all sealed; return it.

    `attributes` are those that the root was written with; None: they are read.
    """
    return _seal(root, _root_manifest(root, attributes))


def _none_known(*_: str) -> str | None:
    """Return None: no channel of the recording has been read."""
    return None


def problems_of_recording(root: h5py.Group, known: Known = _none_known) -> Iterator[Mismatch]:
    """Yield every change of a sealed recording since it was sealed; reads all samples except those in `known`."""
    try:
        yield from _compare(root, _root_manifest(root), "recording", "step")
        steps = child_group(root, STEPS)
        yield from (Mismatch("recording", f"{cut(name)} was added") for name in names_in(root) if name != STEPS)
        for name in attribute_names(steps):
            yield Mismatch("recording", f"attribute {cut(name)} of the group {STEPS} was added")
        names = names_in(steps)
    except ValueError as err:
        yield Mismatch("recording", f"cannot be read: {err}")
        return
    for name in names:
        try:
            step = child_group(steps, name)
        except ValueError as err:
            yield Mismatch(f"step {name}", f"cannot be read: {err}")
        else:
            yield from problems_of_step(step, f"step {name}", partial(known, name))


def problems_of_step(
    group: h5py.Group, where: str, known: Callable[[str], str | None] = _none_known
) -> Iterator[Mismatch]:
    """Yield every change of a sealed step since it was sealed; reads all samples except those of `known` channels."""
    try:
        items = {name: _item(group, name) for name in names_in(group)}
        workers = cores() if any(map(_is_long, items.values())) else 1  # starting a thread would take as long
        digests = in_order(lambda name: _digest_or_reason(items[name], known(name)), items, workers)
        found = dict(zip(items, digests, strict=True))
        yield from _compare(group, _step_manifest(group, items, found), where, "channel")
        sealed = _manifest_in(str(attribute(group, "manifest", "")), "channel") or {"channel": {}}
        for name, entry in sealed["channel"].items():
            if isinstance(item := items.get(name), h5py.Dataset):
                if attribute(item, "digest", "none") != entry.get("samples"):
                    yield Mismatch(f"{where}, channel {cut(name)}", "its digest was changed")
                if not _is_on_its_axis(name, item):
                    yield Mismatch(f"{where}, channel {cut(name)}", "what HDF5 notes of its axis was changed")
    except ValueError as err:
        yield Mismatch(where, f"cannot be read: {err}")


def _is_on_its_axis(name: str, item: h5py.Dataset) -> bool:
    """Whether HDF5's bookkeeping of axes is present, and not replaced by text."""
    found = AXIS_ATTRIBUTES & set(attribute_names(item))
    for each in found & {"DIMENSION_LIST", "REFERENCE_LIST"}:
        with plain_errors():
            if h5py.check_string_dtype(kind := h5py.h5a.open(item.id, each.encode()).dtype) or kind.kind not in "OV":
                return False
    if name != axis_of(name):
        return found == {"DIMENSION_LIST"}
    scale = attribute(item, "CLASS", None), attribute(item, "NAME", None)
    return scale == ("DIMENSION_SCALE", name) and "DIMENSION_LIST" not in found


def _item(group: h5py.Group, name: str) -> Item | str:
    """Return what a step contains under this name, or why it cannot be read."""
    try:
        return child(group, name)
    except ValueError as err:
        return f"unreadable: {err}"


def _is_long(item: Item | str) -> bool:
    try:
        with plain_errors():
            return isinstance(item, h5py.Dataset) and (item.size or 0) > BLOCK
    except ValueError:
        return False  # the reason is reported with its digest


def _digest_or_reason(item: Item | str, known: str | None) -> str:
    if isinstance(item, str):
        return item
    try:
        with plain_errors():
            if not isinstance(item, h5py.Dataset) or item.ndim != 1 or item.dtype != np.dtype("<f8"):
                return "no float64 of shape (n,)"
            if known is not None:
                return known
            check_samples(item)
            return digest_of(item)
    except ValueError as err:
        return f"unreadable: {err}"


def _step_manifest(group: h5py.Group, items: Mapping[str, Item | str], digests: Mapping[str, str]) -> dict[str, Any]:
    channels = {name: _told_of(item) for name, item in items.items()}
    return _manifest_of(Written(attributes_of(group), channels), digests)


def _manifest_of(written: Written, digests: Mapping[str, str]) -> dict[str, Any]:
    channels = {name: {"samples": digest, **_brief(written.channels[name])} for name, digest in digests.items()}
    return {"attributes": _brief(written.step), "channel": channels}


def _root_manifest(root: h5py.Group, attributes: Mapping[str, Plain] | None = None) -> dict[str, Any]:
    steps = child_group(root, STEPS)
    digests = {name: {"digest": _digest_of_step(steps, name)} for name in names_in(steps)}
    return {"attributes": _brief(attributes_of(root) if attributes is None else attributes), "step": digests}


def _digest_of_step(steps: h5py.Group, name: str) -> str:
    try:
        return str(attribute(child_group(steps, name), "digest", "none"))
    except ValueError as err:
        return f"unreadable: {err}"


def _seal(group: h5py.Group, manifest: Mapping[str, Any]) -> str:
    text = _canonical(manifest)
    digest = hashlib.sha256(text).hexdigest()
    _put(group, "manifest", text.decode())
    _put(group, "digest", digest)
    return digest


def _put(thing: h5py.Group | h5py.Dataset, name: str, text: str) -> None:
    """Write an attribute, in place of an existing one."""
    if h5py.h5a.exists(thing.id, name.encode()):
        h5py.h5a.delete(thing.id, name.encode())
    write_attribute(thing, name, text)


def _compare(group: h5py.Group, found: Mapping[str, Any], where: str, part: str) -> Iterator[Mismatch]:
    """Yield the differences between the content and the manifest."""
    if not {"manifest", "digest"} <= set(attribute_names(group)):
        yield Mismatch(where, "has no digest: it was not written to its end, or not by this program")
        return
    text = str(attribute(group, "manifest"))
    if hashlib.sha256(text.encode()).hexdigest() != attribute(group, "digest"):
        yield Mismatch(where, "its manifest or its digest was changed")
        return
    sealed = _manifest_in(text, part)
    if sealed is None:
        yield Mismatch(where, "its manifest is none, though it has its digest: it was not written by this program")
        return
    yield from _differences(sealed["attributes"], found["attributes"], where, "attribute")
    for name in sorted(sealed[part].keys() | found[part].keys()):
        if name not in found[part]:
            yield Mismatch(f"{where}, {part} {name}", "was deleted")
        elif name not in sealed[part]:
            yield Mismatch(f"{where}, {part} {name}", "was added")
        else:
            yield from _differences(sealed[part][name], found[part][name], f"{where}, {part} {name}", "")


def _manifest_in(text: str, part: str) -> dict[str, Any] | None:
    """Return a manifest: texts by attribute name, and by the name of a `part` and its attributes; None if invalid.

    A recording that was sealed again may contain anything.
    """
    try:
        found = json_document(text, "manifest")
        groups = [found["attributes"], *found[part].values()]
    except (UsageError, TypeError, LookupError, AttributeError):
        return None
    texts = all(isinstance(group, dict) and all(isinstance(text, str) for text in group.values()) for group in groups)
    return found if texts else None


def _differences(sealed: Mapping[str, Any], found: Mapping[str, Any], where: str, what: str) -> Iterator[Mismatch]:
    for name in sorted(sealed.keys() | found.keys()):
        label = f"{what} {name}".strip()
        if name not in found:
            yield Mismatch(where, f"{label} was deleted")
        elif name not in sealed:
            yield Mismatch(where, f"{label} was added")
        elif sealed[name] != found[name] and len(found[name]) == _HEX_DIGITS:
            yield Mismatch(where, f"{label} changed since it was written")
        elif sealed[name] != found[name]:
            yield Mismatch(where, f"{label} changed from {cut(sealed[name])} to {cut(found[name])}")


def _told_of(item: Item | str) -> dict[str, Any]:
    try:
        return {} if isinstance(item, h5py.Datatype | str) else attributes_of(item)
    except ValueError:
        return {}  # the reason is reported with its digest


def _brief(attributes: Mapping[str, Any]) -> dict[str, str]:
    """Return attributes as JSON; long ones as their digest, so that a manifest stays small."""
    texts = {name: _canonical(value) for name, value in attributes.items()}
    return {
        name: text.decode() if len(text) <= _LONG else f"sha256 {hashlib.sha256(text).hexdigest()}"
        for name, text in texts.items()
    }


def _canonical(value: object) -> bytes:
    """Return JSON with sorted keys, no spaces, UTF-8."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, default=repr).encode()


class ReadDigests:
    """Digests of the channels that were read from the first sample to the last, in order; other channels have none.

    Channels may be read in several threads, each channel in one thread at a time.
    """

    def __init__(self) -> None:
        self._digests: dict[tuple[int, str], SampleDigest] = {}
        self._taken: dict[tuple[int, str], int] = {}
        self._lengths: dict[tuple[int, str], int] = {}

    def take(self, step: int, channel: str, length: int, start: int, samples: FloatArray) -> None:
        """Add samples that were read from `start` on; the channel has `length` samples in the step of this index."""
        key = step, channel
        taken = self._taken.get(key, 0)
        if not start <= taken < start + samples.size:
            return
        self._digests.setdefault(key, SampleDigest(length)).update(samples[taken - start :])
        self._taken[key], self._lengths[key] = start + samples.size, length

    def of(self, step: int, channel: str) -> str | None:
        """Return the digest of a channel that was read completely; None otherwise."""
        key = step, channel
        complete = key in self._taken and self._taken[key] == self._lengths[key]
        return self._digests[key].hexdigest() if complete else None
