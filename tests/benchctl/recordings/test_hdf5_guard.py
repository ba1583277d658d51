"""HDF5 from strangers, sound as HDF5, hostile as a recording: one line each, nothing read but the file's own."""

from __future__ import annotations

import hashlib
import os
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.hdf5_guard import attribute
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made
from tests.slowness import slowness

Spoil = Callable[[h5py.File, Path], Any]


def spoilt(folder: Path, spoil: Spoil) -> Path:
    """A recording of two steps, spoilt by someone who knows HDF5."""
    path = made.recording(folder, 2)
    with h5py.File(path, "r+") as file:
        spoil(file, folder)
    return path


def _replaced(name: str, make: Callable[[h5py.Group, str, Path], Any]) -> Spoil:
    def spoil(file: h5py.File, folder: Path) -> None:
        group = file["steps/0001"]
        del group[name]
        make(group, name, folder)

    return spoil


def _elsewhere(folder: Path) -> Path:
    with h5py.File(folder / "other.h5", "w") as file:
        file["secret"] = np.full(200, 42.0)
    (folder / "other.bin").write_bytes(np.full(200, 42.0).tobytes())
    return folder / "other.h5"


def _virtual(group: h5py.Group, name: str, folder: Path) -> None:
    layout = h5py.VirtualLayout((200,), "<f8")
    layout[:] = h5py.VirtualSource(str(_elsewhere(folder)), "secret", (200,))
    group.create_virtual_dataset(name, layout)


def _external(group: h5py.Group, name: str, folder: Path) -> None:
    _elsewhere(folder)
    group.create_dataset(name, (200,), "<f8", external=[(str(folder / "other.bin"), 0, 1600)])


def _linked(group: h5py.Group, name: str, folder: Path) -> None:
    group[name] = h5py.ExternalLink(str(_elsewhere(folder)), "secret")


def _bomb(group: h5py.Group, name: str, folder: Path) -> None:
    dataset = group.create_dataset(name, (200,), "<f8", chunks=(200,), compression="gzip")
    dataset.id.write_direct_chunk((0,), zlib.compress(bytes(64 << 20)))


def _packed_twice(group: h5py.Group, name: str, folder: Path) -> None:
    storage = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    storage.set_chunk((200,))
    storage.set_deflate(9)
    storage.set_deflate(9)
    space = h5py.h5s.create_simple((200,))
    h5py.h5d.create(group.id, name.encode(), h5py.h5t.IEEE_F64LE, space, storage)


CHANNELS: dict[str, tuple[Callable[[h5py.Group, str, Path], Any], str]] = {
    "samples of another file": (_linked, "gyro_v is an external link"),
    "a link to itself": (lambda group, name, _: group.__setitem__(name, h5py.SoftLink(group.name)), "is a soft link"),
    "a link to nowhere": (lambda group, name, _: group.__setitem__(name, h5py.SoftLink("/no")), "is a soft link"),
    "a virtual dataset": (_virtual, "its samples are virtual, gathered from elsewhere"),
    "bytes of another file": (_external, "its samples lie outside the file"),
    "a terabyte that is not there": (
        lambda group, name, _: group.create_dataset(name, (1 << 37,), "<f8", chunks=(16384,)),
        "claims 137438953472 samples, which its 0 bytes cannot hold",
    ),
    "2**60 samples in one piece": (
        lambda group, name, _: group.create_dataset(name, (1 << 60,), "<f8"),
        "claims 1152921504606846976 samples",
    ),
    "a chunk of a gigabyte": (
        lambda group, name, _: group.create_dataset(name, (200,), "<f8", maxshape=(None,), chunks=(1 << 27,)),
        "has chunks of 1073741824 bytes, expected at most 1048576",
    ),
    "a chunk that blows up": (_bomb, "is to become 1600"),
    "a chunk packed twice": (_packed_twice, r"is packed with the HDF5 filters \[1, 1\]"),
    "a filter of somebody": (
        lambda group, name, _: group.create_dataset(name, data=np.zeros(200), compression="lzf"),
        "is packed with the HDF5 filters",
    ),
    "texts": (lambda group, name, _: group.create_dataset(name, data=["a"] * 200), "holds object, expected float64"),
    "references": (
        lambda group, name, _: group.create_dataset(name, (200,), dtype=h5py.ref_dtype),
        "holds object, expected float64",
    ),
    "complex numbers": (
        lambda group, name, _: group.create_dataset(name, data=np.zeros(200, complex)),
        "holds complex128, expected float64",
    ),
}


@pytest.mark.parametrize("attack", CHANNELS)
def test_a_channel_that_is_not_the_recordings_own_is_refused_when_its_step_is_read_and_named_by_verify(
    tmp_path: Path, attack: str
) -> None:
    make, says = CHANNELS[attack]
    path = spoilt(tmp_path, _replaced("gyro_v", make))
    with open_recording(path) as recording:
        assert made.same(recording.step(2), made.step(2))
        begun = time.process_time()
        with pytest.raises(UsageError, match=rf"made\.h5: step 1 .*{says}") as caught:
            recording.step(1)
        assert time.process_time() - begun < 1.0 * slowness()
    assert "\n" not in str(caught.value)
    begun = time.process_time()
    problems = verify(path)
    assert time.process_time() - begun < 1.0 * slowness()
    assert any(problem.where == "step 0001, channel gyro_v" for problem in problems)


def test_numbers_of_another_kind_become_float64(tmp_path: Path) -> None:
    path = spoilt(
        tmp_path,
        _replaced("gyro_v", lambda group, name, _: group.create_dataset(name, data=np.arange(200, dtype=">i2"))),
    )
    with open_recording(path) as recording:
        assert recording.step(1)["gyro_v"].dtype == np.float64
        assert recording.step(1)["gyro_v"].tolist() == list(range(200))


def test_a_long_step_of_equal_samples_packs_a_thousandfold_and_is_read(tmp_path: Path) -> None:
    path = spoilt(
        tmp_path,
        _replaced(
            "time_s",
            lambda group, name, _: group.create_dataset(
                name, data=np.zeros(6 << 20), chunks=(1 << 17,), compression="gzip", compression_opts=9
            ),
        ),
    )
    assert path.stat().st_size < 1 << 20
    with open_recording(path) as recording:
        assert recording.step(1, ["time_s"])["time_s"].size == 200  # as many as the shortest channel has


ATTRIBUTES: dict[str, tuple[Any, str]] = {
    "a thousand texts": (np.array(["x" * 99] * 1000, dtype=h5py.string_dtype()), "is 1000 texts"),
    "a million numbers": (np.zeros(7000), "rate_dps"),
    "a text": ("fast", "rate_dps is 'fast', expected a finite number"),
    "not a number": (np.nan, "rate_dps is nan, expected a finite number"),
    "a compound": (np.array([(1, 2.0)], dtype=[("a", "i4"), ("b", "f8")]), "expected text or numbers"),
    "nothing": (h5py.Empty("f8"), "holds 0 numbers"),
    "a complex number": (np.complex128(1), "expected text or numbers"),
    "bytes that are no text": (np.bytes_(b"\xff\xfe"), "can't decode byte 0xff"),
    "several numbers": ([1.0, 2.0], r"rate_dps is \[1.0, 2.0\], expected a finite number"),
}


@pytest.mark.parametrize("attack", ATTRIBUTES)
def test_an_attribute_that_is_none_of_ours_is_refused(tmp_path: Path, attack: str) -> None:
    value, says = ATTRIBUTES[attack]
    path = spoilt(tmp_path, lambda file, _: file["steps/0001"].attrs.__setitem__("rate_dps", value))
    with pytest.raises(UsageError, match=rf"its description is damaged \(step '0001': .*{says}"):
        open_recording(path)
    assert any("attribute rate_dps changed" in str(problem) for problem in verify(path))


def test_an_attribute_that_refers_to_something_is_refused_and_not_followed(tmp_path: Path) -> None:
    path = spoilt(tmp_path, lambda file, _: file.attrs.__setitem__("unit_serial", file["steps"].ref))
    with pytest.raises(UsageError, match="expected text or numbers"):
        open_recording(path)


def test_attributes_of_others_are_theirs_and_only_verify_speaks_of_them(tmp_path: Path) -> None:
    def spoil(file: h5py.File, _: Path) -> None:
        file.attrs["of_somebody"] = np.array(["x"] * 50, dtype=h5py.string_dtype())
        file["steps/0001"].attrs["of_somebody"] = file.ref

    path = spoilt(tmp_path, spoil)
    open_recording(path).close()
    assert [str(problem) for problem in verify(path)] == [
        "recording: attribute of_somebody was added",
        "step 0001: attribute of_somebody was added",
    ]


STEPS: dict[str, tuple[Spoil, str]] = {
    "the steps of another file": (
        lambda file, folder: (
            file.__delitem__("steps"),
            file.__setitem__("steps", h5py.ExternalLink(str(_elsewhere(folder)), "/")),
        ),
        "steps is an external link|its steps are gone",
    ),
    "a step that is a link": (
        lambda file, _: file["steps"].__setitem__("0003", h5py.SoftLink("/steps/0001")),
        "step '0003': 0003 is a soft link",
    ),
    "a step within itself": (
        lambda file, _: file["steps"].__setitem__("0003", file["steps"]),
        "step '0003': whole is not there",
    ),
    "a step twice": (
        lambda file, _: file["steps"].__setitem__("0003", file["steps/0001"]),
        "the group /steps/0003 states that its index is 1",
    ),
    "a step that is a dataset": (
        lambda file, _: file["steps"].create_dataset("0003", data=[1.0]),
        "0003 should be a group",
    ),
    "steps that are a dataset": (
        lambda file, _: (file.__delitem__("steps"), file.create_dataset("steps", data=[1.0])),
        "steps should be a group",
    ),
}


@pytest.mark.parametrize("attack", STEPS)
def test_steps_that_are_not_the_recordings_own_are_refused(tmp_path: Path, attack: str) -> None:
    spoil, says = STEPS[attack]
    path = spoilt(tmp_path, spoil)
    with pytest.raises(UsageError, match=rf"made\.h5: .*({says})"):
        open_recording(path)
    try:
        assert verify(path) != []
    except UsageError as err:
        assert "steps" in str(err)  # noqa: PT017 - either is an answer


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "7",
        '{"attributes": []}',
        '{"attributes": {}, "step": 1}',
        '{"attributes": {"a": 1}, "step": {}}',
        "[" * 9999,
    ],
)
def test_a_seal_of_nonsense_is_a_problem_and_no_crash(tmp_path: Path, text: str) -> None:
    def seal(file: h5py.File, _: Path) -> None:
        file.attrs["manifest"] = text
        file.attrs["digest"] = hashlib.sha256(text.encode()).hexdigest()

    [problem] = verify(spoilt(tmp_path, seal))
    assert str(problem).startswith("recording: its manifest is none")


@pytest.mark.slow
def test_a_damaged_step_that_is_being_written_is_refused_in_time(tmp_path: Path) -> None:
    """HDF5 itself would read a header with a wrong checksum again, with pauses that double, for ever."""
    writer = CampaignWriter(tmp_path / "campaign", made.meta(status="running"))
    writer.begin_step(made.info(1), made.STREAMED).flush()
    [part] = (tmp_path / "campaign" / "steps").glob("*.part")
    content = bytearray(part.read_bytes())
    writer.release()
    for place in (content.find(b"OHDR") + 8, content.rfind(b"OHDR") + 8):
        content[place] ^= 0xFF
    copy = tmp_path / "0001_copy.h5.part"
    copy.write_bytes(content)
    with pytest.raises(UsageError, match=r"0001_copy\.h5\.part"):
        open_recording(copy)


def test_a_pipe_in_the_place_of_a_recording_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "recording.h5")
    with pytest.raises(UsageError, match="it is no file"):
        open_recording(tmp_path)


def test_a_name_with_a_nul_is_refused() -> None:
    with pytest.raises(UsageError, match="there is no such file"):
        open_recording(Path("a\0b.h5"))


def test_text_of_a_fixed_length_and_text_in_a_list_of_one_are_text(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["fixed"] = np.bytes_("é".encode())
        file.attrs["listed"] = ["one"]
        file.attrs["true"] = True
        file.attrs["pair"] = [1, 2]
        assert attribute(file, "fixed") == "é"
        assert attribute(file, "listed") == "one"
        assert attribute(file, "true") is True
        assert attribute(file, "pair") == [1, 2]
        assert attribute(file, "absent", "default") == "default"
