from __future__ import annotations

import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchctl.recordings.model import Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.step_writer import StepWriter
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made
from tests.benchmarks.recording_blocks import SAMPLES_A_SECOND, sustained

CHANNELS = (*made.STREAMED, *made.POLLED)


@pytest.fixture
def step(tmp_path: Path) -> Iterator[StepWriter]:
    writer = StepWriter(tmp_path, made.info(1), CHANNELS, made.meta(status="running"))
    yield writer
    writer.release()


def _point(time_s: float) -> dict[str, float]:
    return {"time_s": time_s, "encoder_deg": 90.0, "gyro_v": time_s + 1.0, "gyro_temp_c": 20.0}


def _in_file(step: StepWriter) -> Step:
    with open_recording(step.path) as recording:
        return recording.step(1)


def _closed(step: StepWriter) -> Step:
    step.close(made.info(1))
    with open_recording(step.path.with_suffix("")) as recording:
        return recording.step(1)


def test_points_are_recorded_in_the_order_in_which_they_came_among_blocks(step: StepWriter) -> None:
    step.append_point(_point(0.0))
    step.append({name: np.array([value, value]) for name, value in _point(1.0).items()})
    step.append_point({"poll_time_s": 0.5, "poll_chamber_temp_c": 21.0})
    step.append_point(_point(2.0))
    found = _closed(step)
    assert found["time_s"].tolist() == [0.0, 1.0, 1.0, 2.0]
    assert found["gyro_v"].tolist() == [1.0, 2.0, 2.0, 3.0]
    assert found["poll_chamber_temp_c"].tolist() == [21.0]


def test_more_points_than_may_wait_are_written_without_a_pause(step: StepWriter) -> None:
    most = 1 << 17
    count = 2 * most
    for number in range(count):
        step.append_point(_point(float(number)))
    assert _in_file(step)["time_s"].size >= most
    assert np.array_equal(_closed(step)["time_s"], np.arange(float(count)))


def test_what_came_before_a_silence_is_in_the_file_within_half_a_second(step: StepWriter) -> None:
    step.append_point(_point(0.0))
    step.flush()
    step.append_point(_point(1.0))
    step.append({"poll_time_s": np.array([1.0]), "poll_chamber_temp_c": np.array([21.0])})
    time.sleep(0.5)
    found = _in_file(step)
    assert found["time_s"].tolist() == [0.0, 1.0]
    assert found["poll_time_s"].tolist() == [1.0]


@pytest.mark.parametrize(
    ("point", "says"),
    [
        ({"time_s": 0.0, "gyro_v": 1.0}, r"step 1 'rate \+1': expected all of"),
        ({"gyro_v": 1.0}, r"expected a point with one of \['time_s', 'poll_time_s'\], got \['gyro_v'\]"),
        (_point(0.0) | {"poll_time_s": 0.0, "poll_chamber_temp_c": 20.0}, "expected all of"),
    ],
)
def test_a_point_that_does_not_fit_is_refused_and_not_written(
    step: StepWriter, point: dict[str, float], says: str
) -> None:
    with pytest.raises(UsageError, match=says):
        step.append_point(point)
    assert _closed(step).info.samples == 0


def test_after_the_disk_refused_what_was_held_whoever_appends_next_is_told_and_nothing_is_lost(
    step: StepWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as full:
        full.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1_000))
        step.append_point(_point(0.0))
        time.sleep(0.5)
        with pytest.raises(UsageError, match="make room"):
            step.append_point(_point(1.0))
    step.append_point(_point(2.0))
    assert _in_file(step)["time_s"].tolist() == [0.0, 1.0, 2.0]


def test_a_step_is_the_same_whether_its_samples_had_come_into_the_part_file_or_not(tmp_path: Path) -> None:
    steps = []
    for name in ("at once", "later"):
        (tmp_path / name).mkdir()
        step = StepWriter(tmp_path / name, made.info(1), CHANNELS, made.meta(status="running"))
        step.append({name: np.array([value, value]) for name, value in _point(1.0).items()})
        step.append_point({"poll_time_s": 0.5, "poll_chamber_temp_c": 21.0})
        if name == "later":
            step.flush()
        step.append_point(_point(2.0))
        steps.append(_closed(step))
    assert steps[0].info == steps[1].info
    assert list(steps[0].channels) == list(steps[1].channels)
    for name, samples in steps[0].channels.items():
        np.testing.assert_array_equal(samples, steps[1].channels[name])


def test_of_a_step_that_could_not_be_finished_every_point_is_in_the_part_file(step: StepWriter) -> None:
    step.append_point(_point(0.0))
    step.path.with_suffix("").mkdir()  # its name is taken
    with pytest.raises(UsageError, match="cannot be written"):
        step.close(made.info(1))
    assert _in_file(step)["time_s"].tolist() == [0.0]
    step.path.with_suffix("").rmdir()
    assert _closed(step)["time_s"].tolist() == [0.0]


def test_a_step_that_is_over_takes_nothing_more_and_leaves_no_thread(step: StepWriter) -> None:
    step.append_point(_point(0.0))
    assert _closed(step).info.samples == 1
    with pytest.raises(UsageError, match="is over"):
        step.flush()
    for thread in threading.enumerate():
        if isinstance(thread, threading.Timer):
            thread.join(1.0)
    assert not any(isinstance(thread, threading.Timer) for thread in threading.enumerate())


def test_a_program_that_ends_without_closing_its_step_leaves_every_point_in_the_file(tmp_path: Path) -> None:
    program = (
        "import sys\n"
        "from pathlib import Path\n"
        "from benchctl.recordings.step_writer import StepWriter\n"
        "from tests.benchctl.recordings import made\n"
        "step = StepWriter(Path(sys.argv[1]), made.info(1), made.STREAMED, made.meta())\n"
        "step.append_point(dict.fromkeys(made.STREAMED, 3.0))\n"
    )
    root = Path(__file__).resolve().parents[3]
    subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=True, cwd=root, timeout=60)
    (part,) = tmp_path.iterdir()
    with open_recording(part) as recording:
        assert recording.step(1)["time_s"].tolist() == [3.0]


def test_a_stream_of_a_million_scans_a_second_is_read_back_as_it_was_sent() -> None:
    streamed = sustained(2.0)  # raises where a sample is missing or another
    assert streamed.in_file > 0.5 * SAMPLES_A_SECOND  # all of it on a machine that does nothing else
