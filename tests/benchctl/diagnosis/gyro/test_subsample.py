"""What a diagnosis looks at of a recording that is larger than memory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from benchctl.diagnosis.diagnose import diagnose
from benchctl.diagnosis.gyro import subsample as taking
from benchctl.diagnosis.gyro.problem import GyroProblem, gyro_problem
from benchctl.diagnosis.gyro.subsample import Subsample, most_rows, subsample_of
from benchctl.recordings.model import Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from benchctl_instruments.physics.effects.registry import effects
from tests.benchctl.diagnosis.gyro.ramps import STEPS, recorded

PIECE, MOST = 2000, 40_000


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("taken") / "recording.h5")


@pytest.fixture(autouse=True)
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(taking, "PIECE", PIECE)


def taken(path: Path, most: int | None) -> Subsample:
    with open_recording(path) as recording:
        return subsample_of(recording, most)


def problem(path: Path, most: int, monkeypatch: pytest.MonkeyPatch) -> GyroProblem:
    monkeypatch.setattr("benchctl.diagnosis.gyro.problem.most_rows", lambda: most)
    with open_recording(path) as recording:
        return gyro_problem(recording)


def all_rows(steps: Sequence[Step], name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.concatenate([step[name] for step in steps])


@pytest.mark.parametrize("most", [None, 10_000_000])
def test_a_recording_that_fits_is_looked_at_as_a_whole(path: Path, most: int | None) -> None:
    whole = taken(path, most)
    assert (whole.left_out, whole.unseen, whole.thermometer) == (0, (), "gyro_temp_c")
    assert len(whole.steps) == STEPS


def test_of_a_larger_one_pieces_are_drawn_always_the_same_and_none_is_cut(path: Path) -> None:
    whole, some = taken(path, None), taken(path, MOST)
    rows = np.searchsorted(all_rows(whole.steps, "time_s"), all_rows(some.steps, "time_s"))
    assert MOST - PIECE < rows.size <= MOST
    assert rows.size + some.left_out == all_rows(whole.steps, "time_s").size
    assert (np.diff(rows) > 0).all()
    breaks = np.flatnonzero(np.diff(rows) > 1) + 1
    assert all(piece.size % PIECE == 0 for piece in np.split(rows, breaks))
    for name in ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c"):
        np.testing.assert_array_equal(all_rows(some.steps, name), all_rows(whole.steps, name)[rows])
    np.testing.assert_array_equal(all_rows(taken(path, MOST).steps, "time_s"), all_rows(some.steps, "time_s"))


def test_what_the_thermistor_said_in_between_is_kept_as_means(path: Path) -> None:
    whole, some = taken(path, None), taken(path, MOST)
    times, temps, samples = (np.concatenate(one) for one in zip(*some.unseen, strict=True))
    assert samples.sum() == some.left_out
    assert times.size < 0.1 * some.left_out
    expected = np.interp(times, all_rows(whole.steps, "time_s"), all_rows(whole.steps, "gyro_temp_c"))
    assert float(np.abs(temps - expected).max()) < 1e-9


def test_a_lag_does_the_same_there_as_in_all_rows(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, some = (problem(path, most, monkeypatch) for most in (10_000_000, MOST))
    lag = effects()["thermal_lag"].make({"tau_s": 100.0}, dict(whole.circumstances))
    does, there = (
        one.predict(one.baseline_start, [lag]) - one.predict(one.baseline_start, []) for one in (whole, some)
    )
    rows = np.searchsorted(whole.time_s, some.time_s)
    assert float(np.abs(there - does[rows])[some.usable].max()) < 0.01 * float(np.abs(does).max())


def test_a_concealed_lag_is_found_in_the_pieces_and_the_diagnosis_says_that_it_did_not_look_at_all(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = problem(path, 10_000_000, monkeypatch)
    lag = effects()["thermal_lag"].make({"tau_s": 100.0}, dict(whole.circumstances))
    noise_v = 5e-4 * np.random.default_rng(0).standard_normal(whole.time_s.size)
    volts = whole.predict(whole.baseline_start, [lag]) + noise_v
    with open_recording(path) as recording:
        steps, first = [], 0
        for step in recording.steps():
            rows = step["time_s"].size
            steps.append(Step(step.info, {**step.channels, "gyro_v": volts[first : first + rows]}))
            first += rows
        write_recording(tmp_path / "lagging.h5", recording.meta, steps)
    monkeypatch.setattr("benchctl.diagnosis.gyro.problem.most_rows", lambda: MOST)
    with open_recording(tmp_path / "lagging.h5") as recording:
        told = diagnose(recording)
    assert [finding.effect for finding in told.findings] == ["thermal_lag"]
    tau_s = told.findings[0].parameters["tau_s"]
    assert tau_s.low < 100.0 < tau_s.high
    (note,) = (one for one in told.notes if "rows" in one)
    assert note.startswith("The recording has 156,000 rows: 40,000 of them were looked at")


@pytest.mark.parametrize(("there", "rows"), [(64 << 30, 10_000_000), (8 << 30, 4_000_000), (1 << 29, 1_000_000)])
def test_a_machine_with_less_memory_looks_at_fewer_rows(there: int, rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(taking, "memory_bytes", lambda: there)
    assert most_rows() == rows


def test_steps_without_a_thermometer_have_none_and_polls_stay_whole(tmp_path: Path, path: Path) -> None:
    with open_recording(path) as recording:
        steps = [
            Step(
                step.info,
                {
                    **{name: values for name, values in step.channels.items() if name != "gyro_temp_c"},
                    "poll_time_s": step["time_s"][::100],
                    "poll_chamber_temp_c": step["gyro_temp_c"][::100],
                },
            )
            for step in recording.steps()
        ]
        write_recording(tmp_path / "polled.h5", recording.meta, steps)
    some = taken(tmp_path / "polled.h5", MOST)
    assert some.thermometer == ""
    assert all(one.time_s.size == 0 for one in some.unseen)
    polled = {step.info.index: step["poll_time_s"].size for step in steps}
    assert all(step["poll_time_s"].size == polled[step.info.index] for step in some.steps)
