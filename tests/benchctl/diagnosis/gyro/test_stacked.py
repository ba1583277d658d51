"""All stretches of a recording in a row, with the pauses between them, and what remembers from one to the next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.diagnosis.gyro.frame import Frame, frame_of
from benchctl.diagnosis.gyro.stacked import Stacked, stacked
from benchctl.recordings.reader import open_recording
from benchctl.signals.temperature import Pause
from benchctl_instruments.physics.chain import Signals
from tests.benchctl.diagnosis.moving import write_moving


@pytest.fixture(scope="module")
def frame(tmp_path_factory: pytest.TempPathFactory) -> Frame:
    """Three stretches without anything known in between."""
    with open_recording(write_moving(tmp_path_factory.mktemp("moving") / "r.h5")) as recording:
        return replace(frame_of(recording), pauses=())


def with_pause(frame: Frame) -> Frame:
    """The same, but for a thermistor that was looked at before the second stretch."""
    time_s = frame.time_s[frame.stretches[1].start] - np.array([1.5, 1.0, 0.5])
    pause = Pause(interval_s=0.5, time_s=time_s, temp_c=np.array([1.0, 2.0, 3.0]), temp_rate_c_per_s=np.full(3, 2.0))
    return replace(frame, pauses=(None, pause, None))


def counted(stack: Stacked, signals: Signals) -> Signals:
    """How many rows were there so far, as an effect with a memory would count them."""

    def count(part: Signals) -> Signals:
        before = part.memory.get("rows", np.zeros(1))
        rows = before[0] + 1.0 + np.arange(part.time_s.size)
        return replace(part, output_v=rows, memory={"rows": rows[-1:]})

    return stack.each(signals, count)


def test_without_pauses_the_rows_are_those_of_the_frame(frame: Frame) -> None:
    stack, signals = stacked(frame)
    assert stack.samples is None
    assert [part.rows for part in stack.parts] == list(frame.stretches)
    assert signals.angle_deg is frame.angle_deg
    assert stack.sampled(signals.rate_dps) is signals.rate_dps


def test_a_pause_lies_between_the_samples_and_the_table_rests_in_it(frame: Frame) -> None:
    paused = with_pause(frame)
    stack, signals = stacked(paused)
    assert [part.is_pause for part in stack.parts] == [False, True, False, False]
    assert [part.stretch for part in stack.stretches] == [0, 1, 2]
    (pause,) = (part for part in stack.parts if part.is_pause)
    assert pause.interval_s == 0.5
    np.testing.assert_array_equal(signals.coil_c[pause.rows], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(signals.coil_rate_c_per_s[pause.rows], 2.0)
    for values in (signals.angle_deg, signals.rate_dps, signals.acceleration_dps2):
        np.testing.assert_array_equal(values[pause.rows], 0.0)
    for values, expected in ((signals.rate_dps, frame.rate_dps), (signals.housing_c, frame.temp_c)):
        np.testing.assert_array_equal(stack.sampled(values), expected)
    assert np.all(np.diff(signals.time_s) > 0.0)


def test_what_remembers_goes_on_through_pauses_and_begins_anew_with_another_recording(frame: Frame) -> None:
    stack, signals = stacked(with_pause(frame))
    assert stack.is_one_recording
    np.testing.assert_array_equal(counted(stack, signals).output_v, 1.0 + np.arange(signals.time_s.size))
    origins = (0.0, 0.0, frame.time_s[frame.stretches[2].start])
    stack, signals = stacked(replace(with_pause(frame), origins_s=origins))
    assert not stack.is_one_recording
    last = stack.parts[-1].rows
    expected = np.concatenate([1.0 + np.arange(last.start), 1.0 + np.arange(last.stop - last.start)])
    np.testing.assert_array_equal(counted(stack, signals).output_v, expected)
    assert signals.time_s[last.start] == 0.0


def test_what_no_work_changes_is_not_copied(frame: Frame) -> None:
    stack, signals = stacked(with_pause(frame))
    done = counted(stack, signals)
    assert done.rate_dps is signals.rate_dps
    assert done.coil_c is signals.coil_c
