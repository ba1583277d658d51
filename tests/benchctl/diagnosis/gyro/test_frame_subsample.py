"""Fewer rows of a recording: what a model predicts there is what it predicts for all."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.diagnosis.gyro import frame_subsample as cut
from benchctl.diagnosis.gyro import problem as made
from benchctl.diagnosis.gyro.frame_subsample import _begins, pieces_of, thinned
from benchctl.diagnosis.gyro.problem import GyroProblem, gyro_problem
from benchctl.recordings.reader import open_recording
from benchctl_instruments.physics.effects.registry import effects
from tests.benchctl.diagnosis.gyro.ramps import STEPS, recorded

EFFECTS: Mapping[str, Mapping[str, float]] = {
    "thermal_lag": {"tau_s": 100.0},
    "thermal_hysteresis": {"fraction_per_c": 1e-4, "width_c": 1.0},
    "scale_asymmetry": {"fraction": 4e-4},
    "heading_dependent_bias": {"amplitude_v": 6e-4, "phase_deg": 40.0, "order": 1.0},
    "timing_offset": {"offset_s": 1e-3},
    "sensor_bandwidth": {"cutoff_hz": 20.0, "order": 1.0},
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> GyroProblem:
    with open_recording(recorded(tmp_path_factory.mktemp("thinned") / "recording.h5")) as recording:
        return gyro_problem(recording)


@pytest.fixture
def few(whole: GyroProblem, monkeypatch: pytest.MonkeyPatch) -> GyroProblem:
    monkeypatch.setattr(made, "_MANY", 10_000)
    problem = whole.thinned()
    assert problem is not None
    return problem


def rows_of(whole: GyroProblem, few: GyroProblem) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return np.searchsorted(whole.time_s, few.time_s)


@given(st.integers(0, 10_000), st.integers(1, 20_000), st.integers(1, 400))
def test_pieces_lie_apart_and_reach_from_the_first_row_to_the_last(start: int, rows: int, length: int) -> None:
    begins = list(_begins(slice(start, start + rows), length))
    assert begins[0] == start
    assert all(later - earlier >= length for earlier, later in itertools.pairwise(begins))
    assert len(begins) == 1 or begins[-1] + length == start + rows


def test_every_step_has_rows_and_long_ones_a_small_share_of_theirs(whole: GyroProblem, few: GyroProblem) -> None:
    kept, all_of_them = (np.bincount(one.step, minlength=STEPS) for one in (few, whole))
    assert (kept > 0).all()
    shares = kept / all_of_them
    assert shares[::2].max() < 0.5 * shares[1::2].min()


def test_what_was_measured_is_that_of_the_same_instants(whole: GyroProblem, few: GyroProblem) -> None:
    rows = rows_of(whole, few)
    np.testing.assert_array_equal(few.measured, whole.measured[rows])
    np.testing.assert_array_equal(few.step, whole.step[rows])
    for name, values in few.coordinates.items():
        # running means differ in the last digits, as other rows stand before them
        np.testing.assert_allclose(values, whole.coordinates[name][rows], rtol=0.0, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_does_the_same_there_as_in_all_rows(name: str, whole: GyroProblem, few: GyroProblem) -> None:
    one = effects()[name].make(dict(EFFECTS[name]), dict(whole.circumstances))
    start = whole.baseline_start
    rows = rows_of(whole, few)[few.usable]
    does = (whole.predict(start, [one]) - whole.predict(start, []))[rows]
    there = (few.predict(start, [one]) - few.predict(start, []))[few.usable]
    assert float(np.abs(does).max()) > 0.0
    assert float(np.abs(there - does).max()) < 0.01 * float(np.abs(does).max())


def test_pieces_behind_one_another_have_no_pause_between_them(whole: GyroProblem) -> None:
    everything = [(0, slice(0, 100)), (0, slice(100, whole.frame.stretches[0].stop))]
    frame, rows = thinned(whole.frame, everything)
    assert frame.pauses[1] is None
    assert rows.size == whole.frame.stretches[0].stop
    apart, _ = thinned(whole.frame, pieces_of(whole.frame, 256))
    assert sum(pause is not None for pause in apart.pauses) > STEPS


def test_of_too_many_pieces_some_are_drawn_the_same_each_time(
    whole: GyroProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    everything = pieces_of(whole.frame, 256)
    monkeypatch.setattr(cut, "_MOST_PIECES", 10)
    some = pieces_of(whole.frame, 256)
    assert len(everything) > len(some) == 10
    assert some == [piece for piece in everything if piece in some]
    assert some == pieces_of(whole.frame, 256)


def test_of_few_rows_or_two_recordings_nothing_is_left_out(whole: GyroProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    assert whole.thinned() is None
    monkeypatch.setattr(made, "_MANY", 10_000)
    joined = replace(whole.frame, origins_s=(*whole.frame.origins_s[:-1], 1e3))
    assert replace(whole, frame=joined).thinned() is None
