"""The air of a chamber: what it does beyond following its heater through one lag."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchctl.diagnosis.chamber.problem import ChamberProblem, chamber_problem
from benchctl.diagnosis.parts import problem_of
from benchctl.diagnosis.search.select import reduced
from benchctl.diagnosis.search.subsets import select_subset
from benchctl.estimation.disturbance import with_disturbance
from benchctl.estimation.fit import Point
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import Recording, open_recording
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chamber_effects.air import air_c
from benchctl_instruments.physics.chamber_effects.effect import ChamberSignals
from benchctl_instruments.physics.chamber_effects.second_lag import SecondLag
from tests.benchctl.diagnosis.made_chamber import GAIN_C_PER_PERCENT, ROOM_C, TAU_S, Truth, chamber_channels
from tests.benchctl.diagnosis.made_recording import found_in, model_found, recording_of
from tests.shared import SHARED, needs_shared

MAPS = Path(__file__).parents[2] / "recordings" / "maps"
DATA = SHARED / "data" / "thermal"


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3, 4))])
@pytest.mark.slow
def test_a_chamber_of_one_lag_brings_no_finding(seed: int) -> None:
    problem = chamber_problem(recording_of(chamber_channels(Truth(), seed)))
    assert found_in(problem) == {}
    assert problem.baseline_names == ("gain_c_per_percent", "tau_s", "ambient_c", "start_c")
    assert problem.baseline_start == pytest.approx([GAIN_C_PER_PERCENT, TAU_S, ROOM_C, ROOM_C], rel=0.03)


@pytest.mark.parametrize(
    ("truth", "effect", "parameters"),
    [
        (Truth(second_lag_s=40.0), "second_lag", {"tau_s": 40.0}),
        (Truth(dead_time_s=12.0), "dead_time", {"delay_s": 12.0}),
        (Truth(radiation=0.5), "radiation", {"share": 0.5}),
        (Truth(store=0.5, store_s=300.0), "heat_store", {"capacity": 0.5 * 300.0 / TAU_S, "tau_s": 300.0}),
        (Truth(drift_c_per_hour=45.0), "ambient_drift", {"c_per_hour": 45.0}),
        (Truth(door=0.3, door_s=600.0), "loss_step", {"fraction": 1 / 1.3 - 1, "moment": 600 / 1300}),
        (Truth(curvature=0.2), "heater_nonlinearity", {"curvature": 0.2}),
    ],
)
@pytest.mark.slow
def test_what_a_chamber_does_beside_is_found_and_nothing_else(
    truth: Truth, effect: str, parameters: dict[str, float]
) -> None:
    found = found_in(chamber_problem(recording_of(chamber_channels(truth, 1))))
    assert list(found) == [effect]
    assert found[effect].values == pytest.approx(parameters, rel=0.1)


@pytest.mark.slow
def test_two_effects_at_once_are_both_found() -> None:
    found = found_in(chamber_problem(recording_of(chamber_channels(Truth(second_lag_s=30.0, radiation=0.5), 1))))
    assert set(found) == {"second_lag", "radiation"}
    assert found["second_lag"].values["tau_s"] == pytest.approx(30.0, rel=0.05)


@pytest.mark.slow
def test_a_lag_of_seconds_beside_a_store_of_heat_is_found_though_it_takes_little_off_the_misses() -> None:
    truth = Truth(second_lag_s=4.0, store=0.5, store_s=200.0, draught=0.01)
    found = found_in(chamber_problem(recording_of(chamber_channels(truth, 1))))
    assert set(found) == {"second_lag", "heat_store"}
    assert found["second_lag"].values["tau_s"] == pytest.approx(4.0, rel=0.3)
    assert found["heat_store"].values["tau_s"] == pytest.approx(200.0, rel=0.15)


@pytest.mark.slow
def test_without_one_finding_the_others_keep_the_errors_that_the_draughts_give_them() -> None:
    problem = chamber_problem(recording_of(chamber_channels(Truth(second_lag_s=30.0, radiation=0.5), 1)))
    chosen = select_subset(problem, seed=0, progress=lambda _name, _share: None)
    rest = reduced(problem, chosen, {"radiation"}).full
    beside = with_disturbance(problem, replace(rest, disturbed_covariance=None))
    np.testing.assert_allclose(rest.robust_covariance(problem.step), beside.robust_covariance(problem.step))


def test_a_limited_ramp_is_found_in_the_set_point_of_a_polled_chamber() -> None:
    time_s = np.arange(0.0, 7200.0, 5.0)
    asked = np.select([time_s < 300, time_s < 2400, time_s < 5000], [20.0, 60.0, -10.0], 35.0)
    led = np.empty_like(asked)
    led[0] = air = 20.0
    reading = [air]
    for k in range(1, time_s.size):
        led[k] = led[k - 1] + np.clip(asked[k] - led[k - 1], -2.0 / 12, 2.0 / 12)
        for step in range(50):
            wanted = led[k - 1] + (led[k] - led[k - 1]) * step / 50
            air += 0.1 * (wanted - air) / 60.0
        reading.append(air)
    noisy = np.array(reading) + np.random.default_rng(3).normal(0.0, 0.03, time_s.size)
    channels = {"poll_time_s": time_s, "poll_chamber_temp_c": noisy.round(2), "poll_chamber_setpoint_c": asked}
    problem = chamber_problem(recording_of(channels))
    assert problem.baseline_names == ("tau_s", "offset_c", "start_c")
    found = found_in(problem)
    assert "ramp_limit" in found
    assert found["ramp_limit"].values["c_per_min"] == pytest.approx(2.0, rel=0.05)


def test_the_simulated_air_agrees_with_an_integrator_of_differential_equations() -> None:
    time_s = np.arange(0.0, 900.0, 0.5)
    drive = np.where(time_s < 60.0, 0.0, 45.0)

    def course(t: float, state: np.ndarray[tuple[int], np.dtype[np.float64]]) -> list[float]:
        air, wall = state
        power = 0.0 if t < 60.0 else 45.0
        loss = 0.7 * (air - 22.0) + 0.3 * ((air + 273.15) ** 4 - 295.15**4) / (4 * 300.0**3) + 0.4 * (air - wall)
        return [(4.0 * power - loss) / 150.0, (air - wall) / 250.0]

    parts = [
        solve_ivp(course, (0.0, 60.0), [25.0, 25.0], t_eval=time_s[:120], rtol=1e-9, atol=1e-9),
        solve_ivp(course, (0.0, 60.0), [25.0, 25.0], rtol=1e-9, atol=1e-9),
    ]
    then = solve_ivp(course, (60.0, 900.0), parts[1].y[:, -1], t_eval=time_s[120:], rtol=1e-9, atol=1e-9)
    signals = ChamberSignals(
        time_s=time_s,
        interval_s=0.5,
        drive=drive,
        room_c=np.full(time_s.size, 22.0),
        loss=np.full(time_s.size, 0.7),
        radiation=0.3,
        stores=((0.4 * 250.0 / 150.0, 250.0),),
    )
    expected = np.concatenate([parts[0].y[0], then.y[0]])
    assert air_c(signals, 25.0, 4.0, 150.0) == pytest.approx(expected, abs=0.05)


def test_a_boiler_that_never_leaves_its_working_point_has_the_gain_that_holds_it_there() -> None:
    gain_c, tau_s, time_s = 10.0, 180.0, 0.5 * np.arange(2400)
    percent = np.where(np.mod(time_s, 150.0) < 75.0, 5.5, 8.0)
    air_c = [ROOM_C + gain_c * 6.75]
    for one in percent[:-1]:
        air_c.append(air_c[-1] + 0.5 * (gain_c * one + ROOM_C - air_c[-1]) / tau_s)
    read = np.array(air_c) + np.random.default_rng(3).normal(0.0, 0.02, time_s.size)
    problem = chamber_problem(recording_of({"time_s": time_s, "chamber_temp_c": read, "heater_percent": percent}))
    assert problem.baseline_start[0] == pytest.approx(gain_c, rel=0.2)
    assert np.std(problem.predict(problem.baseline_start, ()) - problem.measured) < 0.03


def test_a_lab_that_believes_in_another_gain_has_its_change_weighed() -> None:
    recording = recording_of(chamber_channels(Truth(), 1))
    model = {"gain_c_per_percent": 3.0, "tau_s": TAU_S, "ambient_c": ROOM_C}
    problem = problem_of(recording, "chamber", model=model)
    assert problem.believed
    assert problem.matters("gain_c_per_percent", 1.0) == pytest.approx(1 / 3)
    lag = SecondLag(tau_s=40.0)
    told = problem.model_of(problem.baseline_start, (lag,), 0.1)
    assert told == {
        "parts": {"chamber": {**model, "noise_k_rms": 0.1, "effects": {"second_lag": {"tau_s": pytest.approx(40.0)}}}}
    }
    again = problem_of(recording, "chamber", model=told["parts"]["chamber"])
    assert (again.baseline_start == problem.baseline_start).all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"heater_percent": None}, "a chamber needs chamber_temp_c together with one of"),
        ({"chamber_temp_c": None}, "a chamber needs chamber_temp_c together with one of"),
        ({"chamber_temp_c": 25.0}, "the air never changes"),
    ],
)
def test_what_is_missing_for_a_chamber_is_said(change: dict[str, float | None], says: str) -> None:
    channels = chamber_channels(Truth(), 1, seconds=300.0)
    for name, value in change.items():
        samples = channels.pop(name)
        if value is not None:
            channels[name] = np.full(samples.size, value)
    with pytest.raises(UsageError, match=says):
        chamber_problem(recording_of(channels))


def test_a_few_readings_are_too_few() -> None:
    with pytest.raises(UsageError, match="a diagnosis of a chamber needs 60 or more"):
        chamber_problem(recording_of(chamber_channels(Truth(), 1, seconds=20.0)))


def test_a_field_that_the_model_of_a_chamber_does_not_have_is_named() -> None:
    with pytest.raises(UsageError, match=r"\[chamber\] gain: no such field; there are gain_c_per_percent"):
        problem_of(recording_of(chamber_channels(Truth(), 1, seconds=300.0)), "chamber", model={"gain": 4.0})


def _imported(name: str, map_name: str, folder: Path) -> Recording:
    output = folder / "imported.h5"
    import_recording(DATA / name, MAPS / map_name, output)
    return open_recording(output)


def _missed_k(problem: ChamberProblem, model: Point) -> float:
    """The rms of the temperatures by which a free run of a model misses."""
    air = problem.air_c(model.baseline, model.effects)
    return float(np.sqrt(np.mean((air - problem.rows.air_c) ** 2)))


@pytest.mark.slow
@needs_shared("data/thermal")
@pytest.mark.parametrize(("percent", "before_k", "after_k"), [(30, 4.5, 1.1), (50, 6.77, 1.6)])
def test_an_oven_heats_through_a_second_lag(percent: int, before_k: float, after_k: float, tmp_path: Path) -> None:
    with _imported(f"2024-07-27__signals_step_{percent}_percent.log", "oven_step.toml", tmp_path) as recording:
        problem = chamber_problem(recording)
    # a room of less than 5 °C would fit better: the lag that is missing is not to hide in it
    assert _missed_k(problem, Point(baseline=problem.baseline_start)) == pytest.approx(before_k, rel=0.05)
    found = model_found(problem)
    (lag,) = (effect for effect in found.effects if effect.identifier == "second_lag")
    # by independent fits to the temperature: 85 s at 50 %, 108 to 180 s at 30 % with a changing loss and without
    assert lag.values["tau_s"] == pytest.approx({30: 108.0, 50: 85.0}[percent], rel=0.3)
    assert _missed_k(problem, found) < after_k
