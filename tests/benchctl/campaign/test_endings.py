"""The ways out of a run that are not its end: what is done first, what is said, what is left on the disk."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchctl.bench import load_bench
from benchctl.campaign.opened import OpenBench, open_bench
from benchctl.campaign.runner import Moment, Outcome, run_campaign
from benchctl.campaign.safety import Supervisor, bring_to_rest
from benchctl.campaign.stop import StopRequest
from benchctl.plan import ConstantRate, Plan, Static, Step
from benchctl.recordings.campaign_folder import StepWriter
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import LinkError, SafetyError, UsageError
from benchctl_instruments.interfaces import ScanBlock, TableReading, TableState

TURN = ConstantRate(rate_dps=50.0, duration_s=100.0)


@pytest.fixture
def opened() -> Iterator[OpenBench]:
    with open_bench(load_bench("simulated"), wires=False) as bench:
        yield bench


def _plan(*steps: Step) -> Plan:
    return Plan(procedure="mine", parameters={}, steps=steps, calibrates=False)


def _run_and_stop(opened: OpenBench, folder: Path) -> Outcome:
    stop = StopRequest()

    def ask(moment: Moment) -> None:
        if moment.samples:
            stop.ask("Ctrl-C")

    return run_campaign(_plan(TURN), opened, folder, stop=stop, progress=ask)


def _noting(calls: list[str], name: str, method: Any) -> Any:
    def noted(self: Any, *args: Any) -> Any:
        calls.append(name)
        return method(self, *args)

    return noted


def test_the_table_is_stopped_before_the_stream_and_before_the_torn_step_is_written_once_more(
    opened: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    for owner, method in (
        (type(opened.table), "stop"),
        (type(opened.chamber), "go_to"),
        (type(opened.digitizer), "stop_stream"),
        (StepWriter, "cut"),
    ):
        monkeypatch.setattr(owner, method, _noting(calls, method, getattr(owner, method)))
    outcome = _run_and_stop(opened, tmp_path / "c")
    assert outcome.status == "interrupted"
    assert calls == ["go_to", "stop", "go_to", "stop_stream", "cut"]


def test_a_stream_that_cannot_be_stopped_does_not_hide_what_ended_the_run(
    opened: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def dead(*_: object) -> None:
        raise LinkError("digitizer at tcp://x: no answer")

    monkeypatch.setattr(type(opened.digitizer), "stop_stream", dead)
    outcome = _run_and_stop(opened, tmp_path / "c")
    assert outcome.status == "interrupted"
    assert str(outcome.error) == (
        "stopped by Ctrl-C; the bench is not known to be at rest: digitizer: digitizer at tcp://x: no answer"
    )


def test_a_wish_to_stop_from_before_the_start_is_heeded_before_anything_moves(
    opened: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    monkeypatch.setattr(type(opened.table), "enable", _noting(calls, "enable", type(opened.table).enable))
    stop = StopRequest()
    stop.ask("SIGTERM")
    outcome = run_campaign(_plan(TURN), opened, tmp_path / "c", stop=stop)
    assert (outcome.status, outcome.whole, calls) == ("interrupted", 0, [])
    with open_recording(tmp_path / "c") as recording:
        assert (recording.meta.status, recording.infos) == ("interrupted", ())


def test_an_interlock_that_opens_while_the_stream_runs_ends_the_run(
    opened: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def trip(moment: Moment) -> None:
        if moment.samples:
            monkeypatch.setattr(type(opened.table), "state", lambda table: TableState.FAULT)

    outcome = run_campaign(_plan(TURN), opened, tmp_path / "c", progress=trip)
    assert (outcome.status, outcome.whole) == ("aborted", 0)
    assert "rate_table: fault" in str(outcome.error)


def test_a_table_in_fault_that_goes_on_turning_is_not_said_to_be_at_rest(
    opened: OpenBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    turning = TableReading(angle_deg=0.0, rate_dps=120.0, acceleration_dps2=0.0)
    monkeypatch.setattr(type(opened.table), "state", lambda table: TableState.FAULT)
    monkeypatch.setattr(type(opened.table), "read", lambda table: turning)
    safe = bring_to_rest(opened)
    assert safe.problems == (
        "rate_table: should have come to rest, but still turns at +120.000 deg/s; keep clear of it, and stop it at its "
        "controller",
    )


def test_one_lost_reply_does_not_leave_the_table_in_motion(
    opened: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop, lost = type(opened.table).stop, [LinkError("no reply")]

    def stop_once_lost(table: Any) -> None:
        if lost:
            raise lost.pop()
        stop(table)

    monkeypatch.setattr(type(opened.table), "stop", stop_once_lost)
    outcome = _run_and_stop(opened, tmp_path / "c")
    assert outcome.safe.problems == ()
    assert abs(opened.table.read().rate_dps) < 0.05


def test_a_fault_of_a_driver_does_not_keep_the_chamber_from_its_safe_set_point(
    opened: OpenBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> TableState:
        raise ValueError("not in the table of states")

    opened.chamber.go_to(50.0)
    monkeypatch.setattr(type(opened.table), "state", broken)
    safe = bring_to_rest(opened)
    assert safe.chamber_setpoint_c == opened.chamber.read().setpoint_c == 23.0
    assert safe.problems == ("rate_table: ValueError('not in the table of states')",)


def test_an_instrument_is_silent_since_its_first_question_without_an_answer_not_since_it_was_last_asked(
    opened: OpenBench,
) -> None:
    def silent() -> None:
        raise LinkError("no answer")

    events: list[str] = []
    supervisor = Supervisor(opened, lambda kind, **_: events.append(kind))
    assert supervisor.ask("digitizer", lambda: 1) == 1
    opened.clock.sleep(3600.0)
    assert supervisor.ask("digitizer", silent) is None
    opened.clock.sleep(9.0)
    assert supervisor.ask("digitizer", silent) is None
    assert supervisor.ask("digitizer", lambda: 2) == 2
    opened.clock.sleep(9.0)
    assert supervisor.ask("digitizer", silent) is None
    opened.clock.sleep(11.0)
    with pytest.raises(SafetyError, match="digitizer: no news for 11 s: no answer"):
        supervisor.ask("digitizer", silent)
    assert events == ["silence"] * 3


def test_a_disk_that_fills_up_ends_the_run_as_aborted_and_leaves_a_folder_that_opens(
    opened: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)

    def fill(moment: Moment) -> None:
        if moment.index == 2 and moment.samples > 3000:
            monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=1000))

    outcome = run_campaign(_plan(Static(duration_s=5.0), TURN), opened, tmp_path / "c", progress=fill)
    assert (outcome.status, outcome.whole, outcome.recording) == ("aborted", 1, tmp_path / "c")
    assert outcome.error is not None
    assert outcome.error.exit_status == 3
    assert "the disk has 0 MB left" in str(outcome.error)
    assert outcome.safe.problems == ()
    assert abs(opened.table.read().rate_dps) < 0.05
    with open_recording(tmp_path / "c") as recording:
        assert [info.whole for info in recording.infos] == [True, False]
        assert recording.infos[0].samples == 2500


def test_what_an_instrument_refuses_in_the_middle_of_a_run_is_no_fault_of_the_command(
    opened: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise UsageError("rate 50 deg/s: the controller was set to 40 deg/s at its panel")

    monkeypatch.setattr(type(opened.table), "go_to_rate", refuse)
    outcome = run_campaign(_plan(TURN), opened, tmp_path / "c")
    assert outcome.error is not None
    assert (outcome.status, outcome.error.exit_status) == ("aborted", 3)
    assert str(outcome.error) == "rate 50 deg/s: the controller was set to 40 deg/s at its panel"


def test_the_plan_begins_from_the_safe_set_point_whatever_was_left_at_the_chamber(
    opened: OpenBench, tmp_path: Path
) -> None:
    opened.chamber.go_to(60.0)
    outcome = run_campaign(_plan(Static(duration_s=20.0)), opened, tmp_path / "c")
    with open_recording(outcome.recording) as recording:
        step = recording.step(1)
        assert step.info.chamber_setpoint_c == 23.0
        assert set(step["poll_chamber_setpoint_c"]) == {23.0}


def test_a_torn_step_keeps_the_count_of_its_gaps(
    opened: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read_stream = type(opened.digitizer).read_stream
    jumped: list[int] = []

    def with_a_gap(digitizer: Any, scans: int, timeout_s: float) -> ScanBlock:
        block: ScanBlock = read_stream(digitizer, scans, timeout_s)
        jumped.append(block.first_index)
        return replace(block, first_index=block.first_index + 10) if len(jumped) == 2 else block

    monkeypatch.setattr(type(opened.digitizer), "read_stream", with_a_gap)
    stop = StopRequest()

    def ask(moment: Moment) -> None:
        if len(jumped) > 1:
            stop.ask("Ctrl-C")

    outcome = run_campaign(_plan(TURN), opened, tmp_path / "c", stop=stop, progress=ask)
    with open_recording(outcome.recording) as recording:
        assert [(info.whole, info.gaps) for info in recording.infos] == [(False, 1)]
