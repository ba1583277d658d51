"""What is read from its first sample to its last is digested on the way; nothing else is vouched for."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from benchctl.recordings import digests as seals
from benchctl.recordings.digests import ReadDigests, digest_of
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import opened_unchanged, refuse_changed
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made

SAMPLES = np.random.default_rng(2).normal(size=1000)


@pytest.mark.parametrize(
    "parts",
    [
        [(0, 1000)],
        [(0, 300), (300, 301), (301, 1000)],
        [(0, 1), (999, 1000), (0, 500), (500, 1000)],
        [(0, 600), (400, 1000)],
    ],
)
def test_parts_in_order_make_the_digest_of_the_whole(parts: list[tuple[int, int]]) -> None:
    read = ReadDigests()
    for start, stop in parts:
        read.take(3, "gyro_v", 1000, start, SAMPLES[start:stop])
    assert read.of(3, "gyro_v") == digest_of(SAMPLES)
    assert read.of(3, "encoder_deg") is None
    assert read.of(2, "gyro_v") is None


@pytest.mark.parametrize("parts", [[], [(0, 999)], [(1, 1000)], [(500, 1000), (0, 500)], [(0, 400), (500, 1000)]])
def test_what_was_not_read_whole_and_in_order_has_no_digest(parts: list[tuple[int, int]]) -> None:
    read = ReadDigests()
    for start, stop in parts:
        read.take(3, "gyro_v", 1000, start, SAMPLES[start:stop])
    assert read.of(3, "gyro_v") is None


def _read_whole(path: Path) -> None:
    with opened_unchanged([path], "fitted") as (recording,):
        for step in recording.stored_steps():
            step.part(0, step.scans)


def _changed(folder: Path, channel: str) -> Path:
    path = made.recording(folder)
    with h5py.File(path, "r+") as file:
        file[f"steps/0002/{channel}"][2] += 1e-9
    return path


@pytest.mark.parametrize("channel", ["gyro_v", "poll_chamber_temp_c"])
def test_a_changed_sample_is_found_whether_its_channel_was_read_or_not(tmp_path: Path, channel: str) -> None:
    path = _changed(tmp_path, channel)
    with pytest.raises(UsageError, match=rf"not fitted: step 0002, channel {channel}: samples changed"):
        _read_whole(path)


def test_channels_that_were_read_are_not_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, read = made.recording(tmp_path), ReadDigests()
    with open_recording(path, read) as recording:
        for step in recording.stored_steps():
            step.part(0, step.scans)
    again: list[str] = []

    def counted(item: h5py.Dataset) -> str:
        again.append(item.name)
        return digest_of(item)

    monkeypatch.setattr(seals, "digest_of", counted)
    refuse_changed(path, "fitted", read)
    assert sorted(again) == [f"/steps/000{index}/{name}" for index in (1, 2, 3) for name in sorted(made.POLLED)]


def test_that_a_recording_was_changed_is_said_before_anything_that_follows_from_it(tmp_path: Path) -> None:
    path = _changed(tmp_path, "gyro_v")
    with (
        pytest.raises(UsageError, match="changed since it was written, and so not fitted"),
        opened_unchanged([path], "fitted"),
    ):
        raise UsageError("a fit of nonsense")


def test_what_else_is_wrong_is_said_where_nothing_was_changed(tmp_path: Path) -> None:
    path = made.recording(tmp_path)
    with pytest.raises(UsageError, match="a fit of nonsense"), opened_unchanged([path], "fitted"):
        raise UsageError("a fit of nonsense")
    with (
        pytest.raises(UsageError, match="there is no such file"),
        opened_unchanged([path, tmp_path / "no.h5"], "fitted"),
    ):
        pass
