"""Where a run is by its journal, its plan, and when it will be over."""

from typing import Any

import pytest

from benchctl.bench import load_bench
from benchctl.dashboard.data.follower import doing, patience_s
from benchctl.dashboard.data.readings import Readings
from benchctl.dashboard.data.run_state import RunState, ends_utc, left_s, plan_in, step_now

BENCH = load_bench("simulated")


def _step(index: int, kind: str = "static", lasts_s: float = 100.0, streamed_s: float = 90.0) -> dict[str, Any]:
    times = {"t_start_s": 100.0 * (index - 1), "t_end_s": 100.0 * (index - 1) + lasts_s}
    return {"index": index, "label": kind, "kind": kind, "streamed_s": streamed_s, "setpoint_c": 20.0, **times}


def _plan(*steps: dict[str, Any], of: int | None = None) -> dict[str, Any]:
    return {"kind": "plan", "of": len(steps) if of is None else of, "steps": list(steps)}


def _at(kind: str, bench_s: float, wall: str, **data: Any) -> dict[str, Any]:
    return {"kind": kind, "bench_s": bench_s, "wall_time": f"2026-11-20T{wall}+00:00", **data}


def _state(*events: dict[str, Any]) -> RunState:
    state = RunState()
    state.take(events)
    return state


def test_a_plan_in_pieces_is_taken_once_it_is_whole_and_the_last_one_counts() -> None:
    pieces = [_plan(_step(1), of=2), _plan(_step(2), of=2)]
    assert plan_in(pieces[:1]) == ()
    assert [step.index for step in plan_in(pieces)] == [1, 2]
    assert [step.kind for step in plan_in([*pieces, _plan(_step(1, "soak"))])] == ["soak"]
    assert [step.kind for step in plan_in([*pieces, _plan(_step(1, "soak"), of=9)])] == ["static", "static"]


@pytest.mark.parametrize(
    "broken",
    [
        {"kind": "plan"},
        {"kind": "plan", "of": 1, "steps": 3},
        {"kind": "plan", "of": 1, "steps": [4]},
        {"kind": "plan", "of": 1, "steps": [{"index": 1}]},
        {"kind": "plan", "of": 1, "steps": [_step(2)]},
        {"kind": "plan", "of": 1, "steps": [_step(1) | {"t_end_s": float("nan")}]},
    ],
)
def test_what_is_no_plan_is_none(broken: dict[str, Any]) -> None:
    assert plan_in([broken]) == ()


def test_a_step_that_is_made_again_has_its_number_in_the_plan() -> None:
    state = _state(_plan(_step(1), _step(2)), _at("step", 500.0, "18:00:00", index=3, number=2, name="soak again"))
    told = step_now(state, 550.0)
    assert told is not None
    assert (told["index"], told["count"], told["began_s"], told["ends_s"]) == (2, 2, 500.0, 600.0)


def test_what_is_left_of_the_plan_is_what_is_left_of_the_step_and_of_those_behind_it() -> None:
    state = _state(_plan(_step(1), _step(2)), _at("step", 500.0, "18:00:00", index=1, number=1, name="soak"))
    for now_s, waits_s, ends_s in (
        (550.0, 0.0, 600.0),
        (550.0, 80.0, 630.0),
        (700.0, 0.0, 700.0),
        (700.0, 30.0, 730.0),
    ):
        told, left = step_now(state, now_s, waits_s), left_s(state, now_s, waits_s)
        assert told is not None
        assert (told["ends_s"], left) == (ends_s, ends_s - now_s + 100.0)
    assert state.begun == {1: 500.0}


def test_the_end_is_forecast_by_the_plan_and_by_the_pace_since_the_run_began() -> None:
    state = _state(
        _plan(_step(1), _step(2)),
        _at("step", 0.0, "10:00:00", index=1, number=1, name="a"),
        _at("resume", 1000.0, "18:00:00", whole=1, day=1),
        _at("step", 1010.0, "18:00:01", index=2, number=2, name="b"),
    )
    assert left_s(state, 1050.0) == 60.0
    wall_s = state.began.wall_s + 10.0 if state.began else 0.0
    assert (
        ends_utc(state, 1050.0, wall_s, 60.0) == "2026-11-20T18:00:22+00:00"
    )  # 50 s of the bench in 10 s: 60 s take 12
    assert ends_utc(state, 1050.0, wall_s - 9.0, 60.0) is None
    assert left_s(state, 9999.0) == 0.0


def test_without_a_plan_nothing_is_forecast() -> None:
    state = _state(_at("step", 0.0, "10:00:00", index=1, name="a"), {"kind": "prepared", "planned": 7})
    told = step_now(state, 1.0)
    assert told is not None
    assert (told["count"], told["ends_s"], told["kind"]) == (7, None, "")
    assert left_s(state, 1.0) is ends_utc(state, 1.0, 1e10, None) is None
    assert step_now(RunState(), 0.0) is left_s(RunState(), 0.0) is None


def test_samples_of_steps_are_counted_once_each_and_cut_attempts_too() -> None:
    state = _state(
        {"kind": "whole", "index": 1, "samples": 10},
        {"kind": "cut", "index": 2, "samples": 3},
        {"kind": "cut", "index": 2, "samples": 4},
        {"kind": "whole", "index": 2, "samples": 20},
        {"kind": "whole", "index": "2", "samples": 99},
        {"kind": "whole", "index": 3, "samples": None},
    )
    assert state.samples == 37


@pytest.mark.parametrize(
    ("events", "says"),
    [
        ([], "preparing the bench"),
        ([_plan(_step(1)), _at("step", 0.0, "10:00:00", index=1)], "moving and settling"),
        ([_plan(_step(1, "soak")), _at("step", 0.0, "10:00:00", index=1)], "going to the set point"),
        ([_plan(_step(1, "mount")), _at("step", 0.0, "10:00:00", index=1)], "waiting for the unit to be mounted"),
        ([_at("hold", 0.0, "10:00:00", on=True, says="x")], "on hold"),
        ([_at("hold", 0.0, "10:00:00", on=True), _at("step", 1.0, "10:00:01", index=1)], "moving and settling"),
        ([_at("safe", 0.0, "10:00:00", status="complete")], "at rest"),
        ([_at("safe", 0.0, "10:00:00"), {"kind": "finish"}], "closing the recording"),
    ],
)
def test_what_a_run_does_is_told_in_a_word_or_two(events: list[dict[str, Any]], says: str) -> None:
    assert doing(_state(*events), Readings()) == says


def test_patience_is_longer_where_no_sample_can_come() -> None:
    silence_s, limits = BENCH.limits.silence_s, BENCH.limits
    begun = _at("step", 0.0, "10:00:00", index=1, number=1)
    recording = Readings()
    recording.index, recording.recorded, recording.streamed = 1, True, 1_000_000
    state = _state(_plan(_step(1, lasts_s=300.0, streamed_s=60.0)), begun)
    assert patience_s(state, recording, BENCH) == pytest.approx(silence_s + 10.0)  # its file is written once more
    before = patience_s(state, Readings(), BENCH)
    assert before == pytest.approx(silence_s + 10.0 + 240.0 + 4 * limits.rate_dps / limits.acceleration_dps2)
    assert patience_s(_state(_plan(_step(1, "mount")), begun), Readings(), BENCH) is None
    assert patience_s(_state(begun, _at("hold", 1.0, "10:00:01", on=True)), recording, BENCH) is None
    gathered = _state({"kind": "whole", "index": 1, "samples": 10_000_000}, {"kind": "finish"})
    assert patience_s(gathered, recording, BENCH) == pytest.approx(silence_s + 100.0)
    assert patience_s(_state(begun), recording, None) == 20.0
