"""Interlocks on the simulated bench without wires: what they end, what they pause, what the journal says of it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import Interlock, load_bench
from benchctl.campaign.opened import OpenBench, open_bench
from benchctl.campaign.runner import Moment, Outcome, no_progress, run_campaign
from benchctl.campaign.stop import StopRequest
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Static, Step, ThermalRamp
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import SafetyError

RAMP = ThermalRamp(from_c=23.0, to_c=27.0, ramp_c_per_min=2.0, rate_dps=30.0)
TURN = ConstantRate(rate_dps=50.0, duration_s=20.0)
LAGS = Interlock(quantity="setpoint_error_c", below=-0.5, hysteresis=0.3, action="hold", give_up_s=7200.0)


@contextmanager
def bench_with(*interlocks: Interlock) -> Iterator[OpenBench]:
    bench = load_bench("simulated").model_copy(update={"interlocks": interlocks})
    with open_bench(bench, wires=False) as opened:
        yield opened


def _plan(*steps: Step) -> Plan:
    return Plan(procedure="mine", parameters={}, steps=steps, calibrates=False)


def _events(outcome: Outcome) -> list[dict[str, object]]:
    lines = (outcome.campaign / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines]


def test_a_hold_lets_the_step_come_to_its_end_then_waits_at_rest_until_the_condition_is_over(tmp_path: Path) -> None:
    held: list[Moment] = []

    with bench_with(LAGS) as opened:

        def look(moment: Moment) -> None:
            if moment.doing.startswith("on hold"):
                assert abs(opened.table.read().rate_dps) < 0.05
                held.append(moment)

        outcome = run_campaign(_plan(RAMP, TURN), opened, tmp_path / "c", progress=look)
    assert (outcome.status, outcome.whole) == ("complete", 2)
    assert held[0].doing == "on hold, setpoint_error_c below -0.5"
    assert held[0].index == 2
    told = [
        (event["kind"], event.get("on", event.get("index")))
        for event in _events(outcome)
        if event["kind"] in ("interlock", "hold", "step")
    ]
    assert told == [
        ("step", 1),
        ("interlock", True),
        ("hold", True),
        ("interlock", False),
        ("hold", False),
        ("step", 2),
    ]
    begun, over = (event for event in _events(outcome) if event["kind"] == "interlock")
    assert (begun["says"], begun["action"]) == ("setpoint_error_c below -0.5", "hold")
    assert isinstance(begun["value"], float)
    assert begun["value"] < -0.5
    assert isinstance(over["value"], float)
    assert over["value"] >= -0.2
    with open_recording(outcome.recording) as recording:
        assert recording.step(1)["time_s"].size == RAMP.streamed_s * 500
        assert recording.infos[1].t_start - recording.infos[0].t_end > 10.0


def test_a_condition_that_is_over_before_the_step_is_pauses_nothing(tmp_path: Path) -> None:
    with bench_with(LAGS) as opened:
        outcome = run_campaign(_plan(Soak(setpoint_c=25.0, hold_s=600.0), TURN), opened, tmp_path / "c")
    assert outcome.status == "complete"
    kinds = [event["kind"] for event in _events(outcome)]
    assert (kinds.count("interlock"), kinds.count("hold")) == (2, 0)


def test_a_condition_that_only_the_motion_makes_is_over_once_the_table_rests(tmp_path: Path) -> None:
    turns = Interlock(quantity="gyro_v", above=1.0, action="hold", give_up_s=60.0)
    with bench_with(turns) as opened:
        outcome = run_campaign(_plan(TURN, Static(duration_s=2.0)), opened, tmp_path / "c")
    assert outcome.status == "complete"
    kinds = [event["kind"] for event in _events(outcome)]
    assert (kinds.count("interlock"), kinds.count("hold")) == (2, 2)


def test_a_hold_that_does_not_end_in_time_ends_the_run(tmp_path: Path) -> None:
    cold = Interlock(quantity="air_c", below=40.0, action="hold", give_up_s=300.0)
    with bench_with(cold) as opened:
        outcome = run_campaign(_plan(TURN), opened, tmp_path / "c")
        assert abs(opened.table.read().rate_dps) < 0.05
    assert (outcome.status, outcome.whole) == ("aborted", 0)
    assert isinstance(outcome.error, SafetyError)
    assert str(outcome.error).startswith("on hold for 310 s: air_c below 40 (23")
    assert 300.0 < outcome.bench_time_s < 320.0


def test_a_wish_to_stop_ends_a_hold(tmp_path: Path) -> None:
    stop = StopRequest()

    def ask(moment: Moment) -> None:
        if moment.doing.startswith("on hold"):
            stop.ask("Ctrl-C")

    cold = Interlock(quantity="air_c", below=40.0, action="hold", give_up_s=1e6)
    with bench_with(cold) as opened:
        outcome = run_campaign(_plan(TURN), opened, tmp_path / "c", stop=stop, progress=ask)
    assert (outcome.status, str(outcome.error)) == ("interrupted", "stopped by Ctrl-C")


@pytest.mark.parametrize(
    ("quantity", "above"),
    [("rate_dps", 40.0), ("angle_deg", 200.0), ("gyro_v", 2.0), ("gyro_c", 20.0), ("encoder_dps", 49.0)],
)
def test_a_stop_ends_the_run_at_once_and_what_was_measured_is_kept(tmp_path: Path, quantity: str, above: float) -> None:
    interlock = Interlock.model_validate({"quantity": quantity, "above": above})
    with bench_with(interlock) as opened:
        outcome = run_campaign(_plan(TURN), opened, tmp_path / "c")
        assert abs(opened.table.read().rate_dps) < 0.05
    assert (outcome.status, outcome.whole) == ("aborted", 0)
    assert isinstance(outcome.error, SafetyError)
    assert str(outcome.error).startswith(f"interlock {quantity} above {above:g}: ")
    assert outcome.safe.problems == ()
    (event,) = (event for event in _events(outcome) if event["kind"] == "interlock")
    assert (event["on"], event["action"]) == (True, "stop")
    if quantity == "gyro_v":
        with open_recording(outcome.recording) as recording:
            assert np.max(recording.step(1)["gyro_v"]) > above


def test_a_stop_heeds_what_the_table_says_of_its_acceleration(tmp_path: Path) -> None:
    swing = Sine(amplitude_dps=100.0, frequency_hz=0.37, cycles=30)
    with bench_with(Interlock(quantity="acceleration_dps2", above=100.0)) as opened:
        outcome = run_campaign(_plan(swing), opened, tmp_path / "c")
    assert outcome.status == "aborted"
    assert str(outcome.error).startswith("interlock acceleration_dps2 above 100: ")


@pytest.mark.parametrize(
    ("quantity", "limits"),
    [
        ("air_c", {"above": 23.5}),
        ("setpoint_c", {"above": 23.5}),
        ("setpoint_error_c", {"below": -0.2}),
        ("power_percent", {"above": 5.0}),
    ],
)
def test_what_the_chamber_says_is_held_against_interlocks_too(
    tmp_path: Path, quantity: str, limits: dict[str, float]
) -> None:
    with bench_with(Interlock.model_validate({"quantity": quantity, **limits})) as opened:
        outcome = run_campaign(_plan(RAMP), opened, tmp_path / "c")
    assert outcome.status == "aborted"
    assert str(outcome.error).startswith(f"interlock {quantity} ")


def test_without_interlocks_nothing_is_looked_at_between_steps(tmp_path: Path) -> None:
    def recorded(name: str, *interlocks: Interlock) -> list[float]:
        with bench_with(*interlocks) as opened:
            outcome = run_campaign(_plan(TURN), opened, tmp_path / name, progress=no_progress)
        with open_recording(outcome.recording) as recording:
            return [float(value) for value in recording.step(1)["gyro_v"]]

    never = Interlock(quantity="gyro_v", above=1000.0)
    assert recorded("a") == recorded("b", never)
