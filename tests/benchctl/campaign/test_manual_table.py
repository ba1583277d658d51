"""Campaigns with a table that an operator turns by hand, over the wires of the simulated chamber and digitizer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchctl.app.fit import fit
from benchctl.app.run import Watch, play, questions_asked, resume
from benchctl.bench import Bench, bench_of_text, load_bench, template
from benchctl.campaign.check import problems
from benchctl.campaign.opened import open_bench
from benchctl.campaign.operator import (
    MANUAL_RATE_ERROR,
    Meanwhile,
    NoOperator,
    SimulatedOperator,
    answer_line,
    read_answers,
)
from benchctl.campaign.runner import Moment, Outcome, run_campaign
from benchctl.campaign.stop import StopRequest
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Static
from benchctl.plan.find import find_procedure
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import UsageError
from benchctl_instruments.rate_tables.manual import WARNING
from tests.benchctl.campaign.by_hand import REST, done, events, plan_of

BENCH = bench_of_text(template().replace('"acutrol3000"', '"manual"', 1), "bench.toml")
PLUS = "set the table to +40 deg/s (counter-clockwise from above) and wait until it turns steadily"
MINUS = "set the table to -40 deg/s (clockwise from above) and wait until it turns steadily"
STOP = "stop the table"
TURNS = (ConstantRate(rate_dps=40.0, duration_s=9.0), ConstantRate(rate_dps=-40.0, duration_s=9.0))
PLAN = plan_of(REST, *TURNS, REST)
SWEEP = find_procedure("rate_sweep").expand(
    {"at_c": "23", "soak_s": "60", "top_rate_dps": "80", "rates": "2", "run_s": "18", "zero_s": "10", "verify": "false"}
)


def answers_to(plan: Plan, file: Path, bench: Bench = BENCH) -> Path:
    file.write_text("\n".join(answer_line(one.text) for one in questions_asked(plan, bench)), encoding="utf-8")
    return file


def run(plan: Plan, folder: Path, *, off: Callable[[float], float] = lambda rate_dps: rate_dps) -> Outcome:
    """Run a plan; the operator sets `off` of each rate, with the usual error."""

    class Operator(SimulatedOperator):
        def turn(self, rate_dps: float, meanwhile: Meanwhile) -> None:
            super().turn(off(rate_dps), meanwhile)

    with open_bench(BENCH) as opened:
        assert opened.simulated is not None
        return run_campaign(plan, replace(opened, operator=Operator(opened.simulated.world)), folder)


def test_every_rate_and_every_stop_is_a_question_that_is_known_before_anything_moves() -> None:
    asked = [(one.step, one.text) for one in questions_asked(PLAN, BENCH)]
    assert asked == [(2, PLUS), (3, MINUS), (4, STOP)]
    assert [one.text for one in questions_asked(plan_of(TURNS[0]), BENCH)] == [PLUS, STOP]
    assert questions_asked(PLAN, load_bench("simulated")) == []


def test_hand_set_rates_that_are_off_give_the_coefficients_that_the_encoder_proves(tmp_path: Path) -> None:
    said: list[str] = []
    answers = read_answers(answers_to(SWEEP, tmp_path / "answers.toml"))
    outcome = play(SWEEP, BENCH, tmp_path / "c", watch=Watch(warn=said.append), answers=answers)
    assert (outcome.status, outcome.error) == ("complete", None)
    assert said == [WARNING]
    assert done(tmp_path / "c")[-1] == STOP
    with open_recording(outcome.recording) as recording:
        turning = [step for step in recording.steps() if step.info.rate_dps]
        off = [_rate_dps(step) / step.info.rate_dps - 1.0 for step in turning]
    assert np.abs(off) == pytest.approx(MANUAL_RATE_ERROR, abs=0.002)
    assert {np.sign(each) for each in off} == {-1.0, 1.0}
    found = fit([outcome.recording], out=tmp_path / "fit").coefficients
    assert found["K0_v_per_dps"] == pytest.approx(0.05, rel=0.01)
    assert found["U0_v"] == pytest.approx(0.012, abs=1e-3)  # 0.09 V more or less by the rates that were asked for


def _rate_dps(step) -> float:  # type: ignore[no-untyped-def]
    return float(np.polyfit(step["time_s"], np.unwrap(step["encoder_deg"], period=360.0), 1)[0])


def test_answers_without_one_for_a_rate_are_refused_before_anything_moves(tmp_path: Path) -> None:
    (tmp_path / "answers.toml").write_text(answer_line(PLUS), encoding="utf-8")
    with pytest.raises(UsageError, match="2 of the plan's questions have no answer"):
        play(PLAN, BENCH, tmp_path / "c", watch=Watch(warn=print), answers=read_answers(tmp_path / "answers.toml"))
    assert not (tmp_path / "c").exists()


def test_a_rate_that_the_encoder_does_not_show_is_asked_for_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mistakes = iter([50.0])
    outcome = run(PLAN, tmp_path / "c", off=lambda rate_dps: next(mistakes, rate_dps))
    assert outcome.status == "complete"
    assert done(tmp_path / "c") == [PLUS, PLUS, MINUS, STOP]
    assert "benchctl: the encoder shows +51.5" in capsys.readouterr().err


def test_a_table_that_turns_the_other_way_ends_the_run_with_the_table_stopped(tmp_path: Path) -> None:
    outcome = run(PLAN, tmp_path / "c", off=lambda rate_dps: -rate_dps)
    assert outcome.status == "aborted"
    assert outcome.error is not None
    assert str(outcome.error).startswith(f"rate_table: prompted 3 times to {PLUS}; the encoder shows -")
    assert "expected +40 ± 4 deg/s" in str(outcome.error)
    assert (outcome.safe.rate_dps, outcome.safe.problems) == (0.0, ())


def test_a_table_that_nobody_stops_is_not_known_to_be_at_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchctl.campaign.safety.OPERATOR_CHUNKS", 4)
    rates = iter([40.0, -40.0])
    with open_bench(BENCH) as opened:
        assert opened.simulated is not None

        class Deaf(SimulatedOperator):
            def turn(self, rate_dps: float, meanwhile: Meanwhile) -> None:
                if (at := next(rates, None)) is not None:
                    super().turn(at, meanwhile)

        deaf = Deaf(opened.simulated.world)
        chamber, setpoints_c = opened.simulated.world.chamber, list[float]()
        opened.table.operator = lambda rate_dps: setpoints_c.append(chamber.setpoint_c())  # type: ignore[attr-defined]
        warm = plan_of(Soak(setpoint_c=24.0, hold_s=60.0, drift_c_per_min=10.0), *TURNS, REST)
        outcome = run_campaign(warm, replace(opened, operator=deaf), tmp_path / "c")
    assert setpoints_c == [24.0, 23.0]  # demanded first, and again when the chamber is at its safe set point
    assert outcome.status == "aborted"
    assert "prompted 3 times to stop the table" in str(outcome.error)
    assert "the bench is not known to be at rest: rate_table: should have come to rest" in str(outcome.error)


def test_a_resumed_run_asks_for_the_rate_again(tmp_path: Path) -> None:
    stop, folder = StopRequest(), tmp_path / "c"

    def in_the_second_turn(moment: Moment) -> None:
        if moment.index == 3 and moment.doing == "recording" and moment.samples > 8000:
            stop.ask("Ctrl-C")

    with open_bench(BENCH) as opened:
        first = run_campaign(PLAN, opened, folder, stop=stop, progress=in_the_second_turn)
    assert (first.status, first.whole, first.safe.rate_dps) == ("interrupted", 2, 0.0)
    assert done(folder) == [PLUS, MINUS]  # the stop at the end is demanded, not asked
    again = resume(PLAN, BENCH, folder, watch=Watch(warn=print))
    assert (again.status, again.whole) == ("complete", 4)
    assert done(folder)[2:] == [MINUS, STOP]


def test_a_rate_that_changes_while_it_is_recorded_is_set_and_recorded_again(tmp_path: Path) -> None:
    with open_bench(BENCH) as opened:
        assert opened.simulated is not None
        world, bumps = opened.simulated.world, iter([60.0])

        def bump(moment: Moment) -> None:
            if moment.index == 2 and moment.doing == "recording" and (rate_dps := next(bumps, None)) is not None:
                world.table.demand_rate(rate_dps)

        outcome = run_campaign(PLAN, opened, tmp_path / "c", progress=bump)
    assert outcome.status == "complete"
    assert done(tmp_path / "c") == [PLUS, STOP, PLUS, MINUS, STOP]
    assert len(events(tmp_path / "c", "motion")) == 1


def test_a_rate_beyond_the_limit_of_the_bench_stops_the_run(tmp_path: Path) -> None:
    outcome = run(plan_of(ConstantRate(rate_dps=290.0, duration_s=9.0)), tmp_path / "c", off=lambda r: 1.12 * r)
    assert "deg/s measured, the bench's limit is 300 deg/s" in str(outcome.error)
    assert outcome.safe.rate_dps == 0.0


def test_without_an_operator_only_a_plan_at_rest_can_be_run(tmp_path: Path) -> None:
    with open_bench(BENCH) as opened:
        alone = replace(opened, operator=NoOperator())
        with pytest.raises(UsageError, match=r"step 2: rate \+40: needs an operator, and there is none"):
            run_campaign(PLAN, alone, tmp_path / "c")
        assert run_campaign(plan_of(Static(duration_s=5.0)), alone, tmp_path / "d").status == "complete"


def test_swings_and_rates_beyond_the_limits_are_found_by_check() -> None:
    plan = plan_of(Sine(amplitude_dps=20.0, frequency_hz=0.2, cycles=3), ConstantRate(rate_dps=400.0, duration_s=1.0))
    swings, fast = (problem.message for problem in problems(plan, BENCH))
    assert "swings, and the bench's table, manual, has no sinusoid" in swings
    assert "reaches 400 deg/s, the bench's limit is 300 deg/s" in fast


def test_a_simulation_without_wires_is_turned_by_hand_too(tmp_path: Path) -> None:
    with open_bench(BENCH, wires=False) as opened:
        assert run_campaign(PLAN, opened, tmp_path / "c").status == "complete"
    assert done(tmp_path / "c") == [PLUS, MINUS, STOP]


@pytest.mark.parametrize(("stated", "percent"), [("", 10.0), ("motion_error_percent = 3.0\n", 3.0)])
def test_hand_set_rates_may_be_off_by_ten_percent_unless_the_bench_states_another_share(
    stated: str, percent: float
) -> None:
    text = template().replace('"acutrol3000"', '"manual"', 1).replace("[limits]\n", f"[limits]\n{stated}", 1)
    assert bench_of_text(text, "bench.toml").limits.motion_error_percent == percent
    assert load_bench("simulated").limits.motion_error_percent == 2.0


def test_an_address_of_a_manual_table_is_refused() -> None:
    text = template().replace('model = "acutrol3000"', 'model = "manual"\naddress = "tcp://10.0.0.5:1"', 1)
    with pytest.raises(UsageError, match=r"rate_table\.address: a manual table has no wire; leave it out"):
        bench_of_text(text, "bench.toml")
