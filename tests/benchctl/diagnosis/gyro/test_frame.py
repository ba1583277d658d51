"""Frames of campaigns with pauses, of joined recordings and of motion that nobody planned."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchctl.diagnosis.gyro.chain import GyroChain, Law
from benchctl.diagnosis.gyro.frame import frame_of, turned_unseen
from benchctl.diagnosis.gyro.problem import gyro_problem
from benchctl.diagnosis.series import series_of
from benchctl.recordings.importing import import_recording
from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit
from benchctl.recordings.reader import join, open_recording
from benchctl.recordings.writer import write_recording
from benchctl_instruments.physics.effects.thermal_lag import ThermalLag
from benchctl_instruments.physics.effects.warm_up import WarmUp
from tests.benchctl.diagnosis.moving import SIMULATION, write_moving
from tests.shared import SHARED, needs_shared

RATE_HZ, TURNING_DPS = 100.0, 50.0
LAW = Law(T0_c=20.0, temperature_terms=1, rate_terms=0)
BASELINE = np.array([0.02, 0.0, 1e-3])
MAP = Path(__file__).parents[2] / "recordings" / "maps" / "uiuc.toml"


def air_c(time_s):
    """Up by 40 °C and down again while nobody streams."""
    return 20.0 + 40.0 * np.exp(-(((time_s - 150.0) / 40.0) ** 2))


def stream(index, start_s, length_s=20.0):
    time_s = start_s + np.arange(0.0, length_s, 1 / RATE_HZ)
    channels = {
        "time_s": time_s,
        "encoder_deg": np.mod(TURNING_DPS * (time_s - start_s), 360.0),
        "gyro_v": 0.02 * TURNING_DPS * np.ones_like(time_s),
        "gyro_temp_c": air_c(time_s),
        "poll_time_s": time_s[::200],
        "poll_chamber_temp_c": air_c(time_s[::200]) + 1.0,
    }
    return Step(info_of(index, f"rate {index}", "constant_rate", start_s, start_s + length_s), channels)


def info_of(index, name, kind, start_s, end_s):
    return StepInfo(index=index, name=name, kind=kind, t_start=start_s, t_end=end_s, chamber_setpoint_c=20.0)


def campaign(path: Path, *, soaked: bool) -> Path:
    """Two streams; in between the gyro is polled, or nobody looks."""
    steps = [stream(1, 0.0), stream(3, 280.0)]
    if soaked:
        polls = np.arange(20.0, 280.0, 6.0)
        channels = {"poll_time_s": polls, "poll_chamber_temp_c": air_c(polls), "poll_gyro_temp_c": air_c(polls)}
        steps.insert(1, Step(info_of(2, "soak", "soak", 20.0, 280.0), channels))
    meta = Meta(
        status="complete",
        unit=Unit(serial="G-1", range_dps=100.0),
        bench=BenchFacts(sample_rate_hz=RATE_HZ, encoder_counts_per_rev=3600000),
        simulation={**SIMULATION, "T0_c": 20.0},
    )
    write_recording(path, meta, steps)
    return path


def lagging(tau_s):
    """The coil at the second stream, from a dense run of all that happened."""
    time_s = np.arange(0.0, 300.0, 0.01)
    coil = np.empty_like(time_s)
    coil[0] = air_c(time_s[0])
    for i in range(1, time_s.size):
        coil[i] = coil[i - 1] + 0.01 / tau_s * (air_c(time_s[i]) - coil[i - 1])
    return np.interp(280.0 + np.arange(0.0, 20.0, 1 / RATE_HZ), time_s, coil)


MOVES = {
    "steady": lambda s: 30.0 * s,
    "swinging": lambda s: 20.0 * np.sin(s),
    "still": lambda s: np.full_like(s, 10.0),
    "moved": lambda s: np.full_like(s, 11.0),
    "starting": lambda s: 10.0 + 30.0 * np.maximum(s - 10.0, 0.0),
}


@pytest.mark.parametrize(
    ("moves", "unknown"),
    [
        (("still",), 1.0),
        (("steady", "still"), 0.0),  # a table stops without turning back
        (("swinging", "still"), 1.0),
        (("steady", "still", "still"), 0.0),
        (("steady", "still", "moved"), 1.0),
        (("swinging", "starting"), 0.5),
        (("swinging", "starting", "still"), 0.0),
    ],
)
def test_the_direction_of_a_turn_that_nobody_recorded_is_unknown_until_the_table_turns(moves, unknown, tmp_path):
    steps = []
    for number, move in enumerate(moves):
        step = stream(number + 1, 30.0 * number)
        turned_deg = MOVES[move](step["time_s"] - step["time_s"][0])
        steps.append(Step(step.info, {**step.channels, "encoder_deg": np.mod(turned_deg, 360.0)}))
    bench = BenchFacts(sample_rate_hz=RATE_HZ, encoder_counts_per_rev=3600000)
    meta = Meta(status="complete", unit=Unit(serial="G-1", range_dps=100.0), bench=bench)
    write_recording(tmp_path / "r.h5", meta, steps)
    with open_recording(tmp_path / "r.h5") as recording:
        frame = frame_of(recording)
    assert np.mean(turned_unseen(frame)[frame.stretches[-1]]) == pytest.approx(unknown, abs=0.02)


@pytest.mark.parametrize(("soaked", "error_c"), [(True, 0.1), (False, None)])
def test_a_lagging_coil_remembers_what_the_polls_of_a_soak_saw(soaked, error_c, tmp_path):
    with open_recording(campaign(tmp_path / "soak.h5", soaked=soaked)) as recording:
        frame = frame_of(recording)
    assert [pause is not None for pause in frame.pauses] == [False, soaked]
    volts = GyroChain(frame, LAW).predict(BASELINE, (ThermalLag(tau_s=120.0),))
    assert volts.shape == (frame.rows,)
    coil_c = (volts[2000:] / (0.02 * TURNING_DPS) - 1.0) / 1e-3 + 20.0
    away = np.abs(coil_c - lagging(120.0))[100:-100].max()
    if error_c is None:
        assert away > 2.0  # that soak was worth looking at
    else:
        assert away < error_c


def test_an_attempt_that_was_cut_and_made_again_is_not_looked_at(tmp_path):
    first, second = stream(1, 0.0), stream(2, 280.0)
    attempt = stream(3, 100.0)
    cut = Step(replace(attempt.info, whole=False, role="none"), attempt.channels)
    meta = Meta(status="complete", unit=Unit(serial="G-1", range_dps=100.0), bench=BenchFacts(sample_rate_hz=RATE_HZ))
    write_recording(tmp_path / "r.h5", meta, [first, second, cut])
    with open_recording(tmp_path / "r.h5") as recording:
        frame = frame_of(recording)
        series = series_of(recording, ("encoder_deg", "gyro_v"), polled=False)
    for found in (frame, series):
        assert [info.index for info in found.infos] == [1, 2]
        assert np.all(np.diff(found.time_s) > 0)


def test_the_air_between_scans_is_that_of_the_polls(tmp_path):
    with open_recording(campaign(tmp_path / "soak.h5", soaked=True)) as recording:
        frame = frame_of(recording)
    inside = slice(200, 1700)
    np.testing.assert_allclose(frame.chamber_c[inside], air_c(frame.time_s[inside]) + 1.0, atol=0.02)


def test_recordings_of_two_days_begin_twice(tmp_path):
    paths = [write_moving(tmp_path / f"{i}.h5", seed=i) for i in (1, 2)]
    effect = (WarmUp(amplitude_v=0.01, tau_s=10.0),)
    recordings = [open_recording(path) for path in paths]
    frames = [frame_of(recording) for recording in (*recordings, join(recordings))]
    base = np.array([0.02, 0.01, 0.0])
    first, second, both = (GyroChain(frame, LAW).predict(base, effect) for frame in frames)
    for recording in recordings:
        recording.close()
    np.testing.assert_allclose(both, np.concatenate([first, second]), atol=1e-5)


def test_a_recording_of_few_steps_is_cut_so_that_some_can_be_held_out(tmp_path):
    with open_recording(write_moving(tmp_path / "few.h5")) as recording:
        problem = gyro_problem(recording)
    assert len(problem.steps) > 36
    assert {info.kind for info in problem.steps} == {"static", "constant_rate", "sine"}
    assert problem.step_names[0] == "static at +23, 1 of 36"


@needs_shared("data/uiuc_encoder_imu")
def test_a_stepped_shaft_is_compared_in_the_band_of_its_sweep(tmp_path):
    recording = tmp_path / "slow.h5"
    import_recording(SHARED / "data" / "uiuc_encoder_imu" / "raw_yaw_slow.mat", MAP, recording)
    model = {"K0_v_per_dps": 1.0, "U0_v": 0.0, "T0_c": 25.0, "k_T": [], "k_omega": []}
    with open_recording(recording) as opened:
        problem = gyro_problem(opened, model=model)
    assert problem.band is not None
    assert 1.0 < problem.band.stop_hz < 2.2  # from 2.2 to 3 Hz there is motion that was folded back
    assert problem.measured.shape == problem.step.shape == problem.usable.shape == problem.coordinates["rate"].shape
    said = " ".join(problem.remarks(problem.measured, problem.measured, problem.usable))
    assert "A line at 3.6° of angle (100 a turn, 12.8 Hz at 45.9 °/s) is true motion" in said
    assert "The encoder was read over 185° of its turn only" in said
    assert "No temperature was recorded" in said
