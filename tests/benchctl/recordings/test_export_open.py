from __future__ import annotations

import gzip
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchctl.recordings.exporting import export_open
from benchctl.recordings.import_open import read_open_recording
from benchctl.recordings.model import Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made
from tests.shared import SHARED, needs_shared


def _export(tmp_path: Path, steps: list[Step], **changes: object) -> Path:
    source, folder = tmp_path / "a.h5", tmp_path / "open"
    write_recording(source, made.meta(**changes), steps)
    with open_recording(source) as recording:
        export_open(recording, folder)
    return folder


def _described(folder: Path) -> dict[str, list[dict[str, object]]]:
    described: dict[str, list[dict[str, object]]] = json.loads((folder / "recording.json").read_text())
    return described


@needs_shared("recordings/examples")
@pytest.mark.parametrize("example", ["single", "pair", "null"])
@pytest.mark.slow
def test_the_examples_come_back_to_the_last_digit(tmp_path: Path, example: str) -> None:
    source = SHARED / "recordings/examples" / example
    path = tmp_path / "a.h5"
    write_recording(path, *read_open_recording(source))
    with open_recording(path) as recording:
        export_open(recording, tmp_path / "open")
    digits = [gzip.decompress((folder / "samples.csv.gz").read_bytes()) for folder in (source, tmp_path / "open")]
    assert digits[0] == digits[1]
    assert _described(source) == _described(tmp_path / "open")


def test_a_campaign_with_soaks_becomes_one_clock_and_says_so(tmp_path: Path) -> None:
    soak = Step(made.info(2, kind="soak", role="none", t_start=102.0), made.polled(102.0))
    cut = made.step(3, rows=50, role="verify", whole=False)
    folder = _export(tmp_path, [made.step(1), soak, cut])
    described = _described(folder)
    assert "restamped" in described
    assert [step["name"] for step in described["steps"]] == ["rate +1", "rate +3"]
    assert [(step["t_start"], step["t_end"]) for step in described["steps"]] == [(0.0, 2.0), (2.0, 2.5)]
    assert [step["original_t_start"] for step in described["steps"]] == [100.0, 300.0]
    assert [step.get("whole") for step in described["steps"]] == [None, False]
    assert [step.get("role") for step in described["steps"]] == [None, "verify"]


def test_a_torn_step_that_begins_before_its_samples_and_ends_after_them_can_be_imported_again(tmp_path: Path) -> None:
    made_step = made.step(1, whole=False)
    torn = Step(replace(made_step.info, t_start=98.9, t_end=102.7), made_step.channels)
    _, steps = read_open_recording(_export(tmp_path, [torn]))
    assert [(step.info.t_start, step.info.t_end, step.info.samples) for step in steps] == [(100.0, 102.0, 200)]


def test_what_a_campaign_exports_can_be_imported_and_no_sample_was_touched(tmp_path: Path) -> None:
    meta, steps = read_open_recording(_export(tmp_path, [made.step(1), made.step(3)]))
    assert meta.unit.serial == "VG-7"
    assert [step.info.kind for step in steps] == ["constant_rate", "constant_rate"]
    for back, original in zip(steps, [made.step(1), made.step(3)], strict=True):
        for name in ("encoder_deg", "gyro_v", "gyro_temp_c"):
            assert np.array_equal(back[name], original[name])
        assert back.info.rate_dps == original.info.rate_dps


def test_the_chamber_is_interpolated_between_its_polls(tmp_path: Path) -> None:
    _, (step,) = read_open_recording(_export(tmp_path, [made.step(1)]))
    polls = made.polled(100.0)
    time_s = made.streamed(100.0, 200)["time_s"]
    expected = np.interp(time_s, polls["poll_time_s"], polls["poll_chamber_temp_c"])
    assert np.array_equal(step["chamber_temp_c"], expected)


def test_a_gap_in_the_stream_makes_one_step_two(tmp_path: Path) -> None:
    whole = made.step(1)
    channels = dict(whole.channels)
    channels["time_s"] = np.where(np.arange(200) < 120, channels["time_s"], channels["time_s"] + 0.37)
    folder = _export(tmp_path, [Step(replace(whole.info, gaps=1), channels)])
    steps = _described(folder)["steps"]
    assert [step["name"] for step in steps] == ["rate +1, part 1", "rate +1, part 2"]
    assert [(step["t_start"], step["t_end"]) for step in steps] == [(0.0, 1.2), (1.2, 2.0)]
    assert steps[1]["original_t_start"] == pytest.approx(101.57)
    assert len(read_open_recording(folder)[1]) == 2


def test_rows_of_a_kind_that_the_format_does_not_know_belong_to_no_step(tmp_path: Path) -> None:
    folder = _export(tmp_path, [made.step(1), made.step(2, kind="spin_up")])
    assert [step["name"] for step in _described(folder)["steps"]] == ["rate +1"]
    assert [step.info.kind for step in read_open_recording(folder)[1]] == ["constant_rate", "unassigned"]


def test_stamps_that_are_one_clock_already_are_kept(tmp_path: Path) -> None:
    folder = _export(tmp_path, [made.step(1, t_start=5.0), made.step(2, t_start=7.0)])
    described = _described(folder)
    assert "restamped" not in described
    assert [step["t_start"] for step in described["steps"]] == [5.0, 7.0]
    assert gzip.decompress((folder / "samples.csv.gz").read_bytes()).splitlines()[1].startswith(b"5.0,")


def test_the_same_recording_gives_the_same_bytes(tmp_path: Path) -> None:
    contents = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        folder = _export(tmp_path / name, [made.step(1), made.step(3)])
        contents.append([file.read_bytes() for file in sorted(folder.iterdir())])
    assert contents[0] == contents[1]


def _no_encoder() -> Step:
    step = made.step(4)
    return Step(step.info, {name: samples for name, samples in step.channels.items() if name != "encoder_deg"})


def _no_number() -> Step:
    step = made.step(4)
    step["gyro_v"][7] = np.nan
    return step


def _other_rate() -> Step:
    return made.step(4, sample_rate_hz=50.0)


@pytest.mark.parametrize(
    ("steps", "says"),
    [
        ([made.step(1), _no_encoder()], r"step 4 'rate \+4' has no encoder_deg"),
        ([made.step(1), _no_number()], r"step 4 'rate \+4', gyro_v: holds samples that are no numbers"),
        ([made.step(1), _other_rate()], "one sample rate, step 4 has 50 Hz and step 1 has 100 Hz"),
        ([Step(made.info(1, kind="soak"), made.polled(0.0))], "no step was streamed"),
    ],
)
def test_what_the_format_cannot_hold_is_refused_and_leaves_nothing(
    tmp_path: Path, steps: list[Step], says: str
) -> None:
    with pytest.raises(UsageError, match=says):
        _export(tmp_path, steps)
    assert [item.name for item in tmp_path.iterdir()] == ["a.h5"]


def test_a_folder_that_holds_something_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open" / "mine.txt").write_text("mine")
    with pytest.raises(UsageError, match="already and not empty"):
        _export(tmp_path, [made.step(1)])
    assert (tmp_path / "open" / "mine.txt").read_text() == "mine"
