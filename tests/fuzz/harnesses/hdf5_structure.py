"""Recordings in HDF5 that are sound as HDF5 and hostile as recordings: types, shapes, links, filters, seals.

The bytes are a list of changes to a small recording, four bytes each: which change, at which place, with which of its
values, and how much.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from benchctl.recordings.reader import open_recording
from benchctl.recordings.schema import JOURNAL
from benchctl.recordings.verify import verify
from benchctl.recordings.writer import write_recording
from benchctl_instruments.arrays import FloatArray
from tests.benchctl.recordings import made
from tests.fuzz.harness import Harness, refusals, workplace

_SECRET = 5.8e147
"""A sample that lies in another file; whoever reads it has left the recording."""
_MOST_CHANGES = 8

_NAMES = ("gyro_v", "time_s", "poll_time_s", "x" * 300, "a b", "é", "../up", "0009", "digest", "\x1b[31m", "steps")
_JSON = (
    "[]",
    "{}",
    "null",
    "7",
    "[" * 5000,
    '{"csv_decimals": {"time_s": 1000000000}}',
    '{"csv_decimals": {"time_s": "5f%s%s%n"}}',
    '{"channel_units": 5}',
    '{"channel_units": {"gyro_v": [1]}}',
    '{"foreign_keys": {"steps": []}}',
    '{"csv_columns": []}',
    '{"gyro_output_unit": {}}',
    '{"K0_v_per_dps": "x"}',
    '{"K0_v_per_dps": 1e999}',
    '{"x": ' + "9" * 5000 + "}",
    '{"attributes": {}, "step": {}, "channel": {}}',
    '{"attributes": [], "step": 1, "channel": null}',
    '{"attributes": {"name": 1}, "channel": {"time_s": {"samples": []}}}',
)


def _values(file: h5py.File, much: int) -> list[Any]:
    """What an attribute may be set to."""
    return [
        much,
        -1,
        2**63 - 1,
        np.uint64(2**64 - 1),
        np.nan,
        np.inf,
        1e308,
        True,
        "",
        "x" * (much * 200),
        "\udcff",
        "\n\x1b[2J",
        b"\xff\xfe",
        h5py.Empty("f8"),
        file.ref,
        np.arange(much * 30),
        np.array(["x" * 1000] * much, dtype=h5py.string_dtype()),
        np.array([(1, 2.0)], dtype=[("a", "i4"), ("b", "f8")]),
        np.array([file.ref] * 2, dtype=h5py.ref_dtype),
        np.zeros(2, dtype=np.complex128),
        np.void(b"opaque"),
        np.longdouble(1),
        *_JSON,
    ]


def _set_attribute(file: h5py.File, place: Any, which: int, much: int) -> None:
    names = list(place.attrs) or ["name"]
    values = _values(file, much)
    place.attrs[names[much % len(names)]] = values[which % len(values)]


def _delete_attribute(file: h5py.File, place: Any, which: int, much: int) -> None:
    names = list(place.attrs)
    del place.attrs[names[which % len(names)]]


def _set_json(file: h5py.File, place: Any, which: int, much: int) -> None:
    place.attrs[("extra", "simulation", "manifest")[much % 3]] = _JSON[which % len(_JSON)]
    if much % 3 == 2:  # a manifest that has its digest
        place.attrs["digest"] = hashlib.sha256(place.attrs["manifest"].encode()).hexdigest()


def _replace_dataset(file: h5py.File, place: Any, which: int, much: int) -> None:
    group, name = place.parent, place.name.rpartition("/")[2]
    makers: list[Callable[[], Any]] = [
        lambda: group.create_dataset(name, (2**40,), "<f8"),
        lambda: group.create_dataset(name, (2**60,), "<f8", chunks=(1024,)),
        lambda: group.create_dataset(name, (2**31,), "<f8", chunks=(2**20 * (much + 1),), compression="gzip"),
        lambda: group.create_dataset(name, (8, 2), "<f8"),
        lambda: group.create_dataset(name, (), "<f8"),
        lambda: group.create_dataset(name, data=h5py.Empty("f8")),
        lambda: group.create_dataset(name, data=np.arange(much, dtype="f2")),
        lambda: group.create_dataset(name, data=np.arange(much, dtype=">i8")),
        lambda: group.create_dataset(name, data=np.zeros(8, np.complex128)),
        lambda: group.create_dataset(name, data=["a"] * 8, dtype=h5py.string_dtype()),
        lambda: group.create_dataset(name, data=np.array([file.ref] * 8, dtype=h5py.ref_dtype)),
        lambda: group.create_dataset(name, (8,), dtype=h5py.vlen_dtype("f8")),
        lambda: group.create_dataset(name, (8,), dtype=[("a", "f8")]),
        lambda: group.create_dataset(name, (8,), dtype=np.dtype(("f8", (3,)))),
        lambda: group.create_dataset(name, data=np.zeros(2000), chunks=(1000,), compression="lzf"),
        lambda: group.create_dataset(name, data=np.zeros(2000), chunks=(1000,), scaleoffset=2),
        lambda: group.create_dataset(name, (8,), "<f8", external=[(str(workplace() / "secret.bin"), 0, 64)]),
        lambda: group.create_virtual_dataset(name, _virtual()),
        lambda: _bomb(group, name, much),
        lambda: _packed_twice(group, name),
        lambda: group.create_dataset(name, data=np.zeros(10**6), chunks=(2**17,), compression="gzip"),
    ]
    del group[name]
    makers[which % len(makers)]()


def _virtual() -> h5py.VirtualLayout:
    layout = h5py.VirtualLayout((8,), "<f8")
    layout[:] = h5py.VirtualSource(str(workplace() / "secret.h5"), "secret", (8,))
    return layout


def _bomb(group: h5py.Group, name: str, much: int) -> None:
    """A chunk that unpacks to far more than it should."""
    dataset = group.create_dataset(name, (8,), "<f8", chunks=(8,), compression="gzip")
    dataset.id.write_direct_chunk((0,), zlib.compress(bytes(much << 18)))


def _packed_twice(group: h5py.Group, name: str) -> None:
    storage = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    storage.set_chunk((1 << 16,))
    storage.set_deflate(9)
    storage.set_deflate(9)
    space = h5py.h5s.create_simple((1 << 16,))
    found = h5py.h5d.create(group.id, name.encode(), h5py.h5t.IEEE_F64LE, space, storage)
    h5py.Dataset(found)[:] = 0.0


def _replace_link(file: h5py.File, place: Any, which: int, much: int) -> None:
    group, name = (place.parent, place.name.rpartition("/")[2]) if place.name != "/" else (file, "steps")
    targets: list[Any] = [
        h5py.SoftLink("/nowhere"),
        h5py.SoftLink(f"{group.name}/{name}"),
        h5py.SoftLink("/"),
        h5py.SoftLink("/steps/0001/time_s"),
        h5py.ExternalLink(str(workplace() / "secret.h5"), "secret"),
        h5py.ExternalLink("/etc/passwd", "/"),
        h5py.ExternalLink("nowhere.h5", "/"),
        file,
        file["steps"],
        file["steps/0001"],
        file["steps/0001/time_s"],
    ]
    target = targets[which % len(targets)]
    del group[name]
    group[name] = target


def _add(file: h5py.File, place: Any, which: int, much: int) -> None:
    group = place if isinstance(place, h5py.Group) else place.parent
    name = _NAMES[which % len(_NAMES)]
    if much % 3 == 0:
        group.create_group(name)
    elif much % 3 == 1:
        group.create_dataset(name, data=np.arange(float(much)))
    else:
        group[name] = np.dtype([("a", "i4")])


def _rename(file: h5py.File, place: Any, which: int, much: int) -> None:
    place.parent.move(place.name, f"{place.parent.name}/{_NAMES[which % len(_NAMES)]}")


def _delete(file: h5py.File, place: Any, which: int, much: int) -> None:
    del place.parent[place.name]


_CHANGES = (
    _set_attribute,
    _set_attribute,
    _replace_dataset,
    _replace_dataset,
    _replace_link,
    _set_json,
    _delete_attribute,
    _add,
    _rename,
    _delete,
)


def one_input(data: bytes) -> None:
    path = workplace() / "changed.h5"
    path.write_bytes(_template())
    with h5py.File(path, "r+") as file:
        for start in range(0, min(len(data) - 3, 4 * _MOST_CHANGES), 4):
            what, where, which, much = data[start : start + 4]
            places: list[Any] = [file]
            file.visititems(lambda name, item, places=places: places.append(item))
            try:
                _CHANGES[what % len(_CHANGES)](file, places[where % len(places)], which, much)
            except (ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError):
                continue  # HDF5 does not let it be written
    for samples in _read_everything(path):
        assert not (samples == _SECRET).any(), "the samples of another file were read"


def _read_everything(path: Path) -> list[FloatArray]:
    """Open a file, load each step, check all digests; returns the samples of all channels that could be read."""
    found: list[FloatArray] = []
    with refusals(), open_recording(path) as recording:
        for info in recording.infos:
            with refusals():
                found += recording.step(info.index).channels.values()
    with refusals():
        for problem in verify(path):
            str(problem).encode("utf-8")
    assert all(samples.dtype == np.float64 and samples.ndim == 1 for samples in found)
    return found


def _template() -> bytes:
    if not (workplace() / "template").exists():
        (workplace() / JOURNAL).touch()  # as in a campaign's folder: no child process tries each file first
        with h5py.File(workplace() / "secret.h5", "w") as file:
            file["secret"] = np.full(8, _SECRET)
        (workplace() / "secret.bin").write_bytes(np.full(8, _SECRET).tobytes())
        seed, steps = workplace() / "seed.h5", [made.step(1, rows=8), made.step(2, rows=8)]
        write_recording(seed, made.meta(provenance={"operator": "A"}), steps)
        seed.rename(workplace() / "template")
    return (workplace() / "template").read_bytes()


def seeds() -> list[bytes]:
    changes = [
        *(bytes([2, 3, which, 7]) for which in range(21)),
        *(bytes([4, where, which, 0]) for where in (2, 3) for which in range(0, 11, 2)),
        *(bytes([5, 0, which, which]) for which in range(0, len(_JSON), 3)),
        *(bytes([0, 2, which, which]) for which in range(0, 22, 4)),
    ]
    return [*changes, b"".join(changes[:5]), bytes([2, 3, 18, 200])]


HARNESS = Harness(
    name="hdf5_structure", weight=4, one_input=one_input, seeds=seeds, native=True, longest=4 * _MOST_CHANGES
)
