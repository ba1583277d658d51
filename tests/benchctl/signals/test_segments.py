"""A step read part by part is the same segments as in one piece, and says what of them is not to be used."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.recordings.mapped import FILLED
from benchctl.recordings.model import Step, StepInfo
from benchctl.signals.segments import Segment, SegmentReader
from tests.benchctl.calibration.synthetic import Truth, meta_of

INTERVAL_S = 0.01
META = meta_of(Truth())


def step(samples: int = 100, **channels: np.ndarray) -> Step:
    """A table that turns at 1000 deg/s under a gyro that is quiet."""
    time_s = np.arange(samples) * INTERVAL_S
    made = {"time_s": time_s, "encoder_deg": 1000.0 * time_s % 360.0, "gyro_v": np.zeros(samples), **channels}
    info = StepInfo(index=0, name="", kind="motion", t_start=0.0, t_end=float(time_s[-1]), chamber_setpoint_c=20.0)
    return Step(info, made)


def part(of: Step, first: int, last: int) -> Step:
    return Step(of.info, {name: values[first:last] for name, values in of.channels.items()})


def places(segments: list[Segment]) -> list[tuple[int, int]]:
    return [(one.first, one.first + one.samples) for one in segments]


def test_the_angle_is_unwrapped_in_each_segment() -> None:
    (segment,) = SegmentReader(INTERVAL_S, META).take(step(), last=True)
    assert np.diff(segment.angle_deg) == pytest.approx(np.full(99, 10.0))


def test_a_missing_sample_and_an_unknown_angle_are_gaps() -> None:
    whole = step()
    whole["encoder_deg"][60] = np.nan
    gone = Step(whole.info, {name: np.delete(values, 20) for name, values in whole.channels.items()})
    segments = SegmentReader(INTERVAL_S, META).take(gone, last=False)
    assert places(segments) == [(0, 20), (20, 59), (59, 98)]
    assert [one.ends for one in segments] == [True, True, False]


def test_what_is_clipped_filled_in_or_no_number_is_flagged_and_counted() -> None:
    volts, filled = np.zeros(100), np.zeros(100)
    volts[3], volts[5], filled[7] = 10.0, np.nan, 1.0
    reader = SegmentReader(INTERVAL_S, META)
    (segment,) = reader.take(step(gyro_v=volts, **{FILLED: filled}), last=True)
    assert np.flatnonzero(segment.bad).tolist() == [3, 5, 7]
    assert reader.masked == 3


def test_a_segment_goes_on_in_the_next_part_from_what_was_kept() -> None:
    whole, reader = step(), SegmentReader(INTERVAL_S, META)
    (begun,) = reader.take(part(whole, 0, 50), last=False)
    assert not begun.ends
    reader.keep(40)
    (rest,) = reader.take(part(whole, 50, 100), last=True)
    assert rest.ends
    assert rest.time_s == pytest.approx(whole["time_s"][40:])
    assert np.diff(rest.angle_deg) == pytest.approx(np.full(59, 10.0))


def test_nothing_goes_on_where_nothing_was_kept() -> None:
    whole, reader = step(), SegmentReader(INTERVAL_S, META)
    reader.take(part(whole, 0, 50), last=False)
    reader.keep(None)
    assert places(reader.take(part(whole, 50, 100), last=True)) == [(0, 50)]


def test_a_cut_of_a_segment_knows_its_place() -> None:
    (segment,) = SegmentReader(INTERVAL_S, META).take(step(), last=True)
    cut = segment.cut(10, 30).cut(5, 8)
    assert (cut.first, cut.samples, cut.time_s[0]) == (15, 3, pytest.approx(0.15))
