"""What a person does between two measurements, played, recorded and resumed on the simulated bench."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import Bench, Interlock
from benchctl.campaign.opened import open_bench
from benchctl.campaign.operator import Meanwhile, NoOperator, Operator
from benchctl.campaign.resume import past_of, steps_to_play
from benchctl.campaign.runner import Moment, Outcome, run_campaign
from benchctl.campaign.stop import StopRequest
from benchctl.diagnosis.gyro.frame import frame_of
from benchctl.plan import ConstantRate, PowerCycle
from benchctl.recordings.model import StepInfo
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from benchctl.signals.reduce import reduce_steps
from benchctl_instruments.interfaces import Position, TableState
from tests.benchctl.campaign.by_hand import ACROSS, BENCH, PLAN, PROCEDURE, REST, done, events, plan_of
from tests.benchctl.cli.processes import benchctl


def bench_with(**gyro: float) -> Bench:
    physics = {**BENCH.physics, "gyro": {**BENCH.physics.get("gyro", {}), **gyro}}
    return BENCH.model_copy(update={"physics": physics})


class Slow:
    """An operator who takes a while; `look` is called meanwhile."""

    who = "somebody slow"

    def __init__(self, operator: Operator, look: Callable[[], None]) -> None:
        self._operator, self._look = operator, look

    def power(self, on: bool, meanwhile: Meanwhile) -> None:
        self._take(meanwhile)
        self._operator.power(on, meanwhile)

    def mount(self, position: Position, meanwhile: Meanwhile) -> None:
        self._take(meanwhile)
        self._operator.mount(position, meanwhile)

    def ask(self, says: str, meanwhile: Meanwhile) -> None:
        self._take(meanwhile)
        self._operator.ask(says, meanwhile)

    def _take(self, meanwhile: Meanwhile) -> None:
        for _ in range(8):
            meanwhile()
            self._look()


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    folder = tmp_path_factory.mktemp("operator") / "c"
    with open_bench(bench_with(misalignment_mrad=2.0), wires=False) as opened:
        return run_campaign(PLAN, opened, folder)


def test_the_simulated_bench_does_it_itself_and_the_journal_says_what_and_when(played: Outcome) -> None:
    assert (played.status, played.whole, played.error) == ("complete", 9, None)
    assert verify(played.recording) == []
    told = [(event["says"], event["by"], event["waited_s"]) for event in events(played.campaign, "operator")]
    whose = ("the simulated bench", 0.0)
    assert told == [(says, *whose) for says in ("supply off", "supply on", "mount across", "mount along")]
    with open_recording(played.recording) as recording:
        cycle, across = recording.infos[2], recording.infos[4]
    at_s = [event["bench_s"] for event in events(played.campaign, "operator")]
    assert at_s[:2] == [pytest.approx(cycle.t_start, abs=0.01), pytest.approx(cycle.t_end, abs=0.01)]
    assert at_s[2] == pytest.approx(across.t_start, abs=0.01)


def test_the_steps_are_recorded_and_those_across_say_so_and_are_in_no_role(played: Outcome) -> None:
    with open_recording(played.recording) as recording:
        told = [(info.name, info.kind, info.role, info.mounting) for info in recording.infos]
        assert told == [
            ("soak at +23", "soak", "none", ""),
            ("static at +23", "static", "fit", ""),
            ("power cycle at +23", "power_cycle", "none", ""),
            ("static at +23", "static", "fit", ""),
            ("mount across", "mount", "none", "across"),
            ("rate +90 at +23, across", "constant_rate", "none", "across"),
            ("rate -90 at +23, across", "constant_rate", "none", "across"),
            ("mount along", "mount", "none", ""),
            ("static at +23", "static", "fit", ""),
        ]
        assert all(info.whole and not info.is_cut_attempt for info in recording.infos)
        for number in (3, 5, 8):
            step = recording.step(number)
            assert (step.info.samples, step.info.sample_rate_hz, step.info.frame_rate_hz) == (0, None, None)
            assert set(step.channels) == set(recording.channels(1))
            assert step["poll_time_s"].size >= 1
            assert step.info.t_start <= step["poll_time_s"][0] <= step["poll_time_s"][-1] <= step.info.t_end
        cycle = recording.step(3)
        assert cycle.info.t_end - cycle.info.t_start == pytest.approx(75.0, abs=0.01)
        assert abs(cycle["poll_gyro_v"]).max() < 1e-3
        assert cycle["poll_gyro_temp_c"] == pytest.approx(23.0, abs=1.0)


def test_across_the_unit_shows_its_misalignment(played: Outcome) -> None:
    with open_recording(played.recording) as recording:
        forth, back = (float(recording.step(number)["gyro_v"].mean()) for number in (6, 7))
    found_mrad = 1e3 * (forth - back) / (2 * 0.05 * 90.0)
    assert found_mrad == pytest.approx(1e3 * math.sin(2e-3), rel=0.05)


def test_neither_a_fit_nor_a_diagnosis_sees_what_was_across_or_off(played: Outcome) -> None:
    with open_recording(played.recording) as recording:
        assert {step.info.index for step in reduce_steps(recording.steps(), recording.meta)} == {2, 4, 9}
        frame = frame_of(recording)
        assert [info.index for info in frame.infos] == [2, 4, 9]
        assert abs(frame.rate_dps).max() < 1.0


@pytest.mark.slow
def test_over_the_wires_it_is_the_same(tmp_path: Path) -> None:
    (tmp_path / "by_hand.py").write_text(PROCEDURE)
    ran = benchctl(
        "run", tmp_path / "by_hand.py", "--bench", "simulated", "--out", tmp_path / "c", "--json", tmp_path / "r.json"
    )
    assert ran.returncode == 0, ran.stderr
    assert json.loads((tmp_path / "r.json").read_text())["steps"] == {"planned": 7, "whole": 7}
    with open_recording(tmp_path / "c") as recording:
        assert abs(recording.step(1)["poll_gyro_v"]).max() < 1e-3
        assert abs(recording.step(4)["gyro_v"]).mean() < 0.1
        assert [info.mounting for info in recording.infos] == ["", "", "across", "across", "across", "", ""]
    simulated = benchctl("simulate", tmp_path / "by_hand.py", "-o", tmp_path / "s.h5")
    assert simulated.returncode == 0, simulated.stderr
    shown = benchctl("show", tmp_path / "s.h5").stdout
    assert "rate +90 at +23, across          constant_rate  none" in shown
    assert "power cycle at +23               power_cycle    none" in shown


def test_while_somebody_works_the_table_rests_and_the_bench_is_looked_at(tmp_path: Path) -> None:
    rates: list[float] = []
    doing: list[str] = []
    with open_bench(BENCH, wires=False) as opened:
        slow = Slow(opened.operator, lambda: rates.append(opened.table.read().rate_dps))
        outcome = run_campaign(
            plan_of(ConstantRate(rate_dps=100.0, duration_s=2.0), ACROSS, PowerCycle(off_s=10.0)),
            replace(opened, operator=slow),
            tmp_path / "c",
            progress=lambda moment: doing.append(moment.doing),
        )
    assert outcome.status == "complete"
    assert len(rates) == 24
    assert max(map(abs, rates)) < 0.05
    assert {"waiting for somebody slow: mount across", "waiting for somebody slow: supply on", "supply off"} <= {*doing}
    told = events(tmp_path / "c", "operator")
    assert [(event["by"], event["waited_s"]) for event in told] == [("somebody slow", 40.0)] * 3
    with open_recording(outcome.recording) as recording:
        mount, cycle = recording.infos[1:]
    assert mount.t_end - mount.t_start == pytest.approx(40.0, abs=2.0)
    assert cycle.t_end - cycle.t_start == pytest.approx(50.0, abs=0.1)  # off until somebody has switched it on


def test_a_wish_to_stop_ends_the_waiting_and_a_table_that_faults_meanwhile_ends_the_run(tmp_path: Path) -> None:
    stop = StopRequest()
    with open_bench(BENCH, wires=False) as opened:
        slow = Slow(opened.operator, lambda: stop.ask("Ctrl-C"))
        outcome = run_campaign(plan_of(ACROSS, REST), replace(opened, operator=slow), tmp_path / "c", stop=stop)
    assert (outcome.status, outcome.whole, str(outcome.error)) == ("interrupted", 0, "stopped by Ctrl-C")
    assert done(tmp_path / "c") == []

    with open_bench(BENCH, wires=False) as opened:
        slow = Slow(opened.operator, opened.table.disable)
        outcome = run_campaign(plan_of(ACROSS, REST), replace(opened, operator=slow), tmp_path / "d")
    assert outcome.status == "aborted"
    assert f"rate_table: {TableState.DISABLED.value}; find out why" in str(outcome.error)


def test_an_interlock_on_the_gyro_does_not_heed_a_gyro_without_supply(tmp_path: Path) -> None:
    alive = Interlock(quantity="gyro_v", below=0.005)
    bench = BENCH.model_copy(update={"interlocks": (alive,)})
    with open_bench(bench, wires=False) as opened:
        outcome = run_campaign(plan_of(PowerCycle(off_s=60.0), REST), opened, tmp_path / "c")
    assert outcome.status == "complete"


def stop_in(step: int) -> tuple[StopRequest, Callable[[Moment], None]]:
    stop = StopRequest()

    def look(moment: Moment) -> None:
        if moment.index == step and moment.doing == "recording" and moment.samples > 1000:
            stop.ask("Ctrl-C")

    return stop, look


def test_a_run_that_ended_under_across_begins_with_the_unit_mounted_across_again(tmp_path: Path) -> None:
    folder, bench = tmp_path / "c", bench_with(misalignment_mrad=2.0)
    stop, look = stop_in(6)
    with open_bench(bench, wires=False) as opened:
        first = run_campaign(PLAN, opened, folder, stop=stop, progress=look)
    assert (first.status, first.whole) == ("interrupted", 5)
    assert done(folder) == ["supply off", "supply on", "mount across"]  # at the end nothing is asked
    with past_of(folder, PLAN, bench) as past, open_bench(past.bench, wires=False, elapsed_s=past.elapsed_s) as opened:
        again = run_campaign(PLAN, opened, folder, past=past)
    assert (again.status, again.whole) == ("complete", 9)
    assert done(folder)[3:] == ["mount across again, before step 6", "mount along"]
    assert verify(folder / "recording.h5") == []
    with open_recording(folder) as recording:
        told = [(info.index, info.name, info.role, info.mounting, info.whole) for info in recording.infos[5:]]
        assert told == [
            (6, "rate +90 at +23, across", "none", "across", True),
            (7, "rate -90 at +23, across", "none", "across", True),
            (8, "mount along", "none", "", True),
            (9, "static at +23", "fit", "", True),
            (10, "cut attempt of step 6: rate +90 at +23, across", "none", "across", False),
            (11, "mount across again, before step 6", "none", "across", True),
            (12, "soak at +23 again, before step 6, across", "none", "across", True),
        ]
        forth, back = (float(recording.step(number)["gyro_v"].mean()) for number in (6, 7))
        assert 1e3 * (forth - back) / (2 * 0.05 * 90.0) == pytest.approx(2.0, rel=0.05)


def test_a_run_that_ended_in_a_power_cycle_begins_with_the_supply_on(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    stop = StopRequest()

    def look(moment: Moment) -> None:
        if moment.doing == "supply off":
            stop.ask("Ctrl-C")

    with open_bench(BENCH, wires=False) as opened:
        first = run_campaign(PLAN, opened, folder, stop=stop, progress=look)
    assert (first.status, first.whole, done(folder)) == ("interrupted", 2, ["supply off"])
    with past_of(folder, PLAN, BENCH) as past, open_bench(past.bench, wires=False, elapsed_s=past.elapsed_s) as opened:
        assert past.may_be_off
        assert run_campaign(PLAN, opened, folder, past=past).status == "complete"
    assert done(folder)[1:4] == ["supply on", "supply off", "supply on"]
    with open_recording(folder) as recording:
        assert all(info.whole for info in recording.infos[:9])
        assert recording.infos[2].t_end - recording.infos[2].t_start == pytest.approx(75.0, abs=0.01)


def _whole(index: int) -> StepInfo:
    return StepInfo(index=index, name="", kind="", t_start=0.0, t_end=1.0, chamber_setpoint_c=25.0)


@pytest.mark.parametrize(
    ("whole", "expected"),
    [
        ((), [(1, "soak at +23"), (2, "static"), (3, "power cycle")]),
        ((1, 2), [(10, "soak at +23 again, before step 3"), (3, "power cycle"), (4, "static"), (5, "mount across")]),
        ((1, 2, 3, 4), [(10, "soak at +23 again, before step 5"), (5, "mount across"), (6, "rate +90")]),
        (
            (1, 2, 3, 4, 5, 6),
            [(10, "mount across again, before step 7"), (11, "soak at +23 again, before step 7"), (7, "rate -90")],
        ),
        ((1, 2, 3, 4, 5, 6, 7), [(10, "soak at +23 again, before step 8"), (8, "mount along"), (9, "static")]),
        ((1, 2, 3, 4, 5, 6, 7, 8), [(10, "soak at +23 again, before step 9"), (9, "static")]),
        # steps that got lost between whole ones
        (
            (1, 3, 4, 5, 6),
            [
                (10, "mount along again, before step 2"),
                (11, "soak at +23 again, before step 2"),
                (2, "static"),
                (12, "mount across again, before step 7"),
                (13, "soak at +23 again, before step 7"),
                (7, "rate -90"),
            ],
        ),
    ],
)
def test_what_is_done_again_before_a_run_goes_on(whole: tuple[int, ...], expected: list[tuple[int, str]]) -> None:
    to_play = [(index, step.label) for index, _, step in steps_to_play(PLAN, [_whole(one) for one in whole], 23.0)]
    assert to_play[: len(expected)] == expected


def test_nobody_is_needed_to_go_on_once_all_is_done_that_somebody_had_to_do(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    stop, look = stop_in(9)
    with open_bench(BENCH, wires=False) as opened:
        run_campaign(PLAN, opened, folder, stop=stop, progress=look)
    with past_of(folder, PLAN, BENCH) as past, open_bench(past.bench, wires=False, elapsed_s=past.elapsed_s) as opened:
        assert past.first == 9
        assert run_campaign(PLAN, replace(opened, operator=NoOperator()), folder, past=past).status == "complete"


def test_across_in_a_stream_of_samples_nothing_is_lost(played: Outcome) -> None:
    with open_recording(played.recording) as recording:
        stamps = np.concatenate([step["time_s"] for step in recording.steps() if step.info.samples])
        assert np.all(np.diff(stamps) > 0)
        assert [info.gaps for info in recording.infos] == [0] * 9
