from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchctl.recordings.digests import digest_of, seal_recording, seal_step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.step_writer import StepWriter
from benchctl.recordings.verify import verify
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made


def _change_sample(file: h5py.File) -> None:
    file["steps/0002/gyro_v"][17] = np.nextafter(file["steps/0002/gyro_v"][17], np.inf)


def _shorten(file: h5py.File) -> None:
    samples = file["steps/0002/gyro_v"][:-1]
    del file["steps/0002/gyro_v"]
    file["steps/0002"].create_dataset("gyro_v", data=samples)


def _narrow(file: h5py.File) -> None:
    del file["steps/0002/gyro_v"]
    file["steps/0002"].create_dataset("gyro_v", data=np.zeros(200, np.float32))


def _swap_digest(file: h5py.File) -> None:
    file["steps/0002/gyro_v"].attrs["digest"] = file["steps/0002/time_s"].attrs["digest"]


def _set(where: str, name: str, value: object) -> Callable[[h5py.File], None]:
    return lambda file: file[where].attrs.__setitem__(name, value)


def _drop(where: str) -> Callable[[h5py.File], None]:
    return lambda file: file.__delitem__(where)


CHANGES: list[tuple[Callable[[h5py.File], None], str]] = [
    (_change_sample, "step 0002, channel gyro_v: samples changed since it was written"),
    (_shorten, "step 0002, channel gyro_v: samples changed since it was written"),
    (_narrow, "step 0002, channel gyro_v: samples changed from"),
    (_set("steps/0002", "rate_dps", 21.0), "step 0002: attribute rate_dps changed from 20.0 to 21.0"),
    (_set("steps/0002", "note", "added"), "step 0002: attribute note was added"),
    (lambda file: file["steps/0002"].attrs.__delitem__("role"), "step 0002: attribute role was deleted"),
    (lambda file: file["steps/0002"].attrs.__delitem__("kind"), "step 0002: attribute kind was deleted"),
    (lambda file: file.attrs.__delitem__("status"), "recording: attribute status was deleted"),
    (_set("steps/0002/gyro_v", "units", "mV"), 'step 0002, channel gyro_v: units changed from "V" to "mV"'),
    (_set("/", "status", "simulated"), 'recording: attribute status changed from "complete" to "simulated"'),
    (_set("/", "provenance_source", "other"), "recording: attribute provenance_source changed from sha256"),
    (_drop("steps/0002"), "recording, step 0002: was deleted"),
    (lambda file: file.copy("steps/0002", "steps/0009"), "recording, step 0009: was added"),
    (_drop("steps/0002/gyro_v"), "step 0002, channel gyro_v: was deleted"),
    (lambda file: file["steps/0002"].create_group("more"), "step 0002, channel more: was added"),
    (lambda file: file.create_group("more"), "recording: more was added"),
    (lambda file: file.create_dataset("steps2", data=[1.0]), "recording: steps2 was added"),
    (lambda file: file.__setitem__("link", h5py.SoftLink("/steps")), "recording: link was added"),
    (_set("steps", "note", "added"), "recording: attribute note of the group steps was added"),
    (_set("steps", "digest", "0" * 64), "recording: attribute digest of the group steps was added"),
    (_set("/", "CLASS", "added"), "recording: attribute CLASS was added"),
    (_set("steps/0002", "NAME", "added"), "step 0002: attribute NAME was added"),
    (_set("steps/0002/gyro_v", "manifest", "{}"), "step 0002, channel gyro_v: manifest was added"),
    (_set("steps/0002/gyro_v", "DIMENSION_LABELS", "x"), "step 0002, channel gyro_v: DIMENSION_LABELS was added"),
    (_set("steps/0002/gyro_v", "digest", "0" * 64), "step 0002, channel gyro_v: its digest was changed"),
    (_set("steps/0002/gyro_v", "digest", ""), "step 0002, channel gyro_v: its digest was changed"),
    (_swap_digest, "step 0002, channel gyro_v: its digest was changed"),
    (_set("steps/0002/gyro_v", "CLASS", "TABLE"), "step 0002, channel gyro_v: what HDF5 notes of its axis was"),
    (_set("steps/0002/time_s", "NAME", "forged"), "step 0002, channel time_s: what HDF5 notes of its axis was"),
    (_set("steps/0002/gyro_v", "DIMENSION_LIST", "x"), "step 0002, channel gyro_v: what HDF5 notes of its axis was"),
    (_set("steps/0002/time_s", "REFERENCE_LIST", 1.0), "step 0002, channel time_s: what HDF5 notes of its axis was"),
    (lambda file: file["steps/0002/gyro_v"].attrs.__delitem__("DIMENSION_LIST"), "step 0002, channel gyro_v: what"),
    (lambda file: file["steps/0002/gyro_v"].attrs.__delitem__("digest"), "step 0002, channel gyro_v: its digest was"),
    (_set("steps/0002", "digest", "0" * 64), "step 0002: its manifest or its digest was changed"),
    (_set("/", "manifest", "{}"), "recording: its manifest or its digest was changed"),
    (lambda file: file.attrs.__delitem__("digest"), "recording: has no digest"),
]


@pytest.mark.parametrize(("change", "says"), CHANGES, ids=[says for _, says in CHANGES])
def test_a_change_is_found_and_named(tmp_path: Path, change: Callable[[h5py.File], None], says: str) -> None:
    path = made.recording(tmp_path)
    with made.changed(path) as file:
        change(file)
    assert any(str(problem).startswith(says) for problem in verify(path)), [str(problem) for problem in verify(path)]


def test_a_recording_as_it_was_written_has_no_problems(tmp_path: Path) -> None:
    assert verify(made.recording(tmp_path)) == []


@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(st.integers(0, 199), st.integers(0, 63), st.sampled_from(made.STREAMED))
def test_any_single_bit_of_any_channel_is_found(tmp_path: Path, row: int, bit: int, channel: str) -> None:
    path = made.recording(tmp_path, count=1)
    with made.changed(path) as file:
        samples = file[f"steps/0001/{channel}"][:]
        samples.view(np.uint64)[row] ^= np.uint64(1 << bit)
        file[f"steps/0001/{channel}"][:] = samples
    assert [str(problem) for problem in verify(path)] == [
        f"step 0001, channel {channel}: samples changed since it was written"
    ]


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_three_hundred_random_bits_of_a_recording_are_all_found(tmp_path: Path) -> None:
    path, chance = made.recording(tmp_path), np.random.default_rng(1)
    with h5py.File(path) as file:
        places = [(step, channel) for step in file["steps"] for channel in file[f"steps/{step}"]]
    for _ in range(300):
        step, channel = places[chance.integers(len(places))]
        with made.changed(path) as file:
            data = file[f"steps/{step}/{channel}"]
            before = data[:]
            row, bit = chance.integers(before.size), chance.integers(64)
            after = before.copy()
            after.view(np.uint64)[row] ^= np.uint64(1) << np.uint64(bit)
            data[:] = after
        assert [problem.where for problem in verify(path)] == [f"step {step}, channel {channel}"], (row, bit)
        with made.changed(path) as file:
            file[f"steps/{step}/{channel}"][:] = before
    assert verify(path) == []


def test_a_damaged_block_is_found_and_named(tmp_path: Path) -> None:
    path = made.recording(tmp_path)
    with h5py.File(path) as file:
        chunk = file["steps/0003/gyro_v"].id.get_chunk_info(0)
    content = bytearray(path.read_bytes())
    middle = chunk.byte_offset + chunk.size // 2
    content[middle : middle + 8] = b"\xff" * 8
    path.write_bytes(content)
    assert [problem.where for problem in verify(path)] == ["step 0003, channel gyro_v"]


def test_the_digest_of_a_channel_can_be_computed_by_anyone(tmp_path: Path) -> None:
    samples = made.step(1)["gyro_v"]
    expected = hashlib.sha256(b'{"dtype":"<f8","shape":[200]}\n' + samples.astype("<f8").tobytes()).hexdigest()
    with h5py.File(made.recording(tmp_path)) as file:
        group = file["steps/0001"]
        assert group["gyro_v"].attrs["digest"] == expected
        assert json.loads(group.attrs["manifest"])["channel"]["gyro_v"]["samples"] == expected
        assert hashlib.sha256(group.attrs["manifest"].encode()).hexdigest() == group.attrs["digest"]


def test_the_digest_stands_for_the_content_and_not_for_the_file(tmp_path: Path) -> None:
    digests = []
    for count, folder in ((3, "a"), (3, "b"), (2, "c")):
        (tmp_path / folder).mkdir()
        with open_recording(made.recording(tmp_path / folder, count)) as recording:
            digests.append(recording.digest)
    assert digests[0] == digests[1]
    assert digests[0] != digests[2]


def test_an_open_recording_has_no_digests_and_says_so(tmp_path: Path) -> None:
    (tmp_path / "recording.json").write_text("{}")
    with pytest.raises(UsageError, match="has no digests to check"):
        verify(tmp_path)


WORDS = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=120)
NUMBERS = st.floats()


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(
    words=WORDS,
    unit=st.none() | WORDS,
    number=NUMBERS,
    whole=st.booleans(),
    count=st.none() | st.integers(0, 2**62),
    mounting=st.sampled_from(["", "across"]),
)
def test_a_seal_made_of_what_is_written_is_the_seal_made_of_what_is_read(
    tmp_path: Path, words: str, unit: str | None, number: float, whole: bool, count: int | None, mounting: str
) -> None:
    extra = {"channel_units": {"gyro_v": unit or "V"}, "channel_comments": {"encoder_deg": words}} if unit else {}
    simulation = {"name": words, "gain": number} if count else None
    meta = made.meta(provenance={"operator": words, "source": words * 30}, extra=extra, simulation=simulation)
    info = made.info(1, whole=whole, chamber_setpoint_c=number, frames_lost=count, rate_dps=None, mounting=mounting)
    folder = Path(tempfile.mkdtemp(dir=tmp_path))
    writer = StepWriter(folder, info, made.STREAMED, meta)
    writer.append(made.streamed(0.0, 20))
    writer.close(info)
    with h5py.File(next(folder.glob("*.h5")), "r+") as file:
        channels = dict(file["steps/0001"])
        written = [(each.attrs["manifest"], each.attrs["digest"]) for each in (file["steps/0001"], file)]
        samples = {name: digest_of(channel) for name, channel in channels.items()}
        read = seal_step(file["steps/0001"], channels, samples), seal_recording(file)
        assert tuple(digest for _, digest in written) == read
        assert [each.attrs["manifest"] for each in (file["steps/0001"], file)] == [text for text, _ in written]
