"""Campaigns that end early and are gone on with, on the simulated bench without wires."""

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from benchctl.bench import Bench, load_bench
from benchctl.calibration.calibrate import calibrate
from benchctl.campaign.opened import another_day, open_bench
from benchctl.campaign.resume import PLAIN_SOAK_S, elapsed_s, past_of, soak_before, steps_to_play
from benchctl.campaign.runner import Moment, Outcome, run_campaign
from benchctl.campaign.stop import StopRequest
from benchctl.notifications import Notify
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Static, Step, ThermalRamp
from benchctl.recordings.digests import seal_recording
from benchctl.recordings.model import StepInfo
from benchctl.recordings.reader import open_recording
from benchctl.recordings.recover import recover
from benchctl.recordings.verify import verify
from benchctl_instruments.errors import UsageError

SOAK = Soak(setpoint_c=25.0, hold_s=300.0)
STEPS: tuple[Step, ...] = (
    SOAK,
    Static(duration_s=10.0),
    ConstantRate(rate_dps=60.0, duration_s=60.0),
    ConstantRate(rate_dps=-60.0, duration_s=12.0),
    Static(duration_s=10.0),
)


def plan_of(*steps: Step, **parameters: Any) -> Plan:
    return Plan(procedure="mine", parameters=parameters, steps=steps, calibrates=False, source="source")


PLAN = plan_of(*STEPS)
BENCH = load_bench("simulated")


def begin(folder: Path, stop_at: Callable[[Moment], bool] | None, plan: Plan = PLAN, bench: Bench = BENCH) -> Outcome:
    """Run a plan; where `stop_at` says so, it is interrupted."""
    stop = StopRequest()

    def look(moment: Moment) -> None:
        if stop_at is not None and stop_at(moment):
            stop.ask("Ctrl-C")

    with open_bench(bench, wires=False) as opened:
        return run_campaign(plan, opened, folder, stop=stop, progress=look)


def go_on(
    folder: Path, stop_at: Callable[[Moment], bool] | None = None, plan: Plan = PLAN, bench: Bench = BENCH
) -> Outcome:
    stop = StopRequest()

    def look(moment: Moment) -> None:
        if stop_at is not None and stop_at(moment):
            stop.ask("Ctrl-C")

    with (
        past_of(folder, plan, bench) as past,
        open_bench(past.bench, wires=False, elapsed_s=past.elapsed_s) as opened,
    ):
        return run_campaign(plan, opened, folder, stop=stop, progress=look, past=past)


def in_the_third_step(moment: Moment) -> bool:
    return moment.index == 3 and moment.samples > 10_000


def _events(folder: Path, kind: str) -> list[dict[str, Any]]:
    lines = [json.loads(line) for line in (folder / "journal.jsonl").read_text(encoding="utf-8").splitlines()]
    return [line for line in lines if line["kind"] == kind]


def test_an_interrupted_campaign_goes_on_after_a_soak_and_keeps_the_attempt_that_was_cut(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    first = begin(folder, in_the_third_step)
    assert (first.status, first.whole) == ("interrupted", 2)
    outcome = go_on(folder)
    assert (outcome.status, outcome.whole, outcome.planned, outcome.error) == ("complete", 5, 5, None)
    assert verify(folder / "recording.h5") == []
    with open_recording(folder) as recording:
        assert recording.meta.status == "complete"
        assert [(info.index, info.whole, info.role) for info in recording.infos] == [
            (1, True, "none"),
            (2, True, "fit"),
            (3, True, "fit"),
            (4, True, "fit"),
            (5, True, "fit"),
            (6, False, "none"),
            (7, True, "none"),
        ]
        cut, again = recording.infos[5], recording.infos[6]
        assert cut.name == "cut attempt of step 3: rate +60 at +25"
        assert cut.is_cut_attempt
        assert 0 < cut.samples < 30_000
        assert again.name == "soak at +25 again, before step 3"
        assert recording.infos[1].t_end < cut.t_start < cut.t_end < again.t_start < again.t_end
        assert again.t_end < recording.infos[2].t_start
        assert outcome.samples == sum(info.samples for info in recording.infos)
        in_time = sorted((step for step in recording.steps() if step.info.samples), key=lambda step: step.info.t_start)
        assert np.all(np.diff(np.concatenate([step["time_s"] for step in in_time])) > 0)
        for step in recording.steps():
            stamps = step.channels.get("time_s", step["poll_time_s"])
            assert step.info.t_start - 0.01 <= stamps[0] <= stamps[-1] <= step.info.t_end + 0.01
    assert outcome.bench_time_s > first.bench_time_s
    assert len(_events(folder, "resume")) == 1


def test_every_whole_step_is_in_the_journal_with_its_digest(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    begin(folder, None)
    with open_recording(folder) as recording:
        assert [(event["index"], event["digest"]) for event in _events(folder, "whole")] == [
            (info.index, info.digest) for info in recording.infos
        ]


@pytest.mark.parametrize("length", [0, 5000])
def test_a_campaign_whose_newest_step_is_damaged_plays_that_step_again(tmp_path: Path, length: int) -> None:
    folder = tmp_path / "c"
    begin(folder, in_the_third_step)
    with past_of(folder, PLAN, BENCH) as past:  # and dies before its first step
        past.reopen()[0].release()
    [newest] = (folder / "steps").glob("0002_*.h5")
    newest.write_bytes(newest.read_bytes()[:length])
    with past_of(folder, PLAN, BENCH) as past:
        assert past.first == 2
    assert newest.exists()
    outcome = go_on(folder)
    assert (outcome.status, outcome.whole) == ("complete", 5)
    assert [file.name for file in (folder / "unreadable").iterdir()] == [newest.name]
    assert verify(folder / "recording.h5") == []


@pytest.mark.slow
def test_a_campaign_may_be_cut_again_and_again(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    begin(folder, in_the_third_step)
    for _ in range(2):
        again = go_on(folder, lambda moment: moment.index == 3 and moment.doing == "recording")
        assert (again.status, again.whole) == ("interrupted", 2)
    cut_in_the_soak = go_on(folder, lambda moment: moment.doing == "soaking")
    assert (cut_in_the_soak.status, cut_in_the_soak.whole) == ("interrupted", 2)
    assert go_on(folder).status == "complete"
    with open_recording(folder) as recording:
        assert [info.whole for info in recording.infos[:5]] == [True] * 5
        assert sum(info.is_cut_attempt for info in recording.infos) >= 1
        assert sum("again, before step 3" in info.name for info in recording.infos) == 4
        begins = sorted(info.t_start for info in recording.infos)
        assert begins == sorted(set(begins))
    assert [event["day"] for event in _events(folder, "resume")] == [1, 2, 3, 4]


def test_another_noise_but_the_same_unit_and_encoder_after_a_resume(tmp_path: Path) -> None:
    plan = plan_of(Static(duration_s=4.0), Static(duration_s=40.0))
    folder = tmp_path / "c"
    begin(folder, lambda moment: moment.index == 2 and moment.samples > 4000, plan)
    with past_of(folder, plan, BENCH) as past:
        assert past.bench.physics["seed"] == 1 + BENCH.physics.get("seed", 1)
        assert {"eccentricity_phase_deg", "ellipticity_phase_deg"} <= set(past.bench.physics["encoder"])
    go_on(folder, plan=plan)
    begin(tmp_path / "d", None, plan)
    with open_recording(folder) as resumed, open_recording(tmp_path / "d") as straight:
        assert np.array_equal(resumed.step(1)["gyro_v"], straight.step(1)["gyro_v"])
        ours, theirs = resumed.step(2)["gyro_v"], straight.step(2)["gyro_v"]
        assert abs(np.corrcoef(ours, theirs)[0, 1]) < 0.1
        assert ours.std() == pytest.approx(theirs.std(), rel=0.1)


def test_a_rerun_of_another_day_that_was_cut_goes_on_with_the_bench_that_it_was_told_to_use(tmp_path: Path) -> None:
    plan = plan_of(Static(duration_s=4.0), Static(duration_s=40.0))
    rerun = another_day(BENCH, 1)
    begin(tmp_path / "c", lambda moment: moment.index == 2 and moment.samples > 4000, plan, rerun)
    with past_of(tmp_path / "c", plan, BENCH) as past:
        assert past.bench.physics["seed"] == rerun.physics["seed"] + 1
        assert past.bench.physics["encoder"] == rerun.physics["encoder"]
    assert go_on(tmp_path / "c", plan=plan).status == "complete"


@pytest.mark.slow
def test_a_resumed_campaign_fits_like_an_uninterrupted_one(tmp_path: Path) -> None:
    rates = [sign * rate for rate in (30.0, 60.0, 90.0, 120.0, 150.0) for sign in (1.0, -1.0)]
    runs = [
        ConstantRate(rate_dps=rate, duration_s=12.0, role="verify" if abs(rate) == 90.0 else "fit") for rate in rates
    ]
    plan = plan_of(SOAK, Static(duration_s=20.0), *runs, Static(duration_s=20.0))
    begin(
        tmp_path / "c",
        lambda moment: moment.index == 6 and moment.doing == "recording" and moment.samples > 29_000,
        plan,
    )
    assert go_on(tmp_path / "c", plan=plan).status == "complete"
    begin(tmp_path / "d", None, plan)
    values = {}
    for name in ("c", "d"):
        with open_recording(tmp_path / name) as recording:
            assert any(info.is_cut_attempt for info in recording.infos) == (name == "c")
            result = calibrate(recording.steps(), recording.meta)
            values[name] = {one: result.best.parameter(one) for one in ("K0_v_per_dps", "S_rad_per_dps")}
            assert result.error_percent["joint"] < 0.1
    for parameter, resumed in values["c"].items():
        straight = values["d"][parameter]
        assert resumed.ci95[0] <= straight.ci95[1]
        assert straight.ci95[0] <= resumed.ci95[1]
        assert resumed.standard == pytest.approx(straight.standard, rel=0.5)


@pytest.mark.parametrize(
    ("whole", "expected"),
    [
        (0, [(1, 1, "soak at +25")]),
        (1, [(6, 2, "soak at +25 again, before step 2"), (2, 2, "static")]),
        (4, [(6, 5, "soak at +25 again, before step 5"), (5, 5, "static")]),
        (5, []),
    ],
)
def test_what_is_still_to_be_played(whole: int, expected: list[tuple[int, int, str]]) -> None:
    infos = [_whole(number) for number in range(1, whole + 1)]
    to_play = [(index, number, step.label) for index, number, step in steps_to_play(PLAN, infos, 23.0)]
    assert to_play[: len(expected)] == expected
    assert [number for index, number, _ in to_play if index == number] == list(range(whole + 1, 6))


def _whole(index: int) -> StepInfo:
    return StepInfo(index=index, name="", kind="", t_start=0.0, t_end=1.0, chamber_setpoint_c=25.0)


def test_a_soak_that_was_cut_is_just_done_again() -> None:
    assert next(steps_to_play(plan_of(Static(duration_s=1.0), SOAK), [_whole(1)], 23.0)) == (2, 2, SOAK)


def test_a_step_that_got_lost_between_whole_ones_is_played_after_a_soak_of_its_own() -> None:
    infos = [_whole(number) for number in (1, 2, 4)]
    assert [(index, number) for index, number, _ in steps_to_play(PLAN, infos, 23.0)] == [
        (6, 3),
        (3, 3),
        (7, 5),
        (5, 5),
    ]


def test_the_chamber_is_soaked_as_the_plan_asked_last() -> None:
    ramp = ThermalRamp(from_c=25.0, to_c=40.0, ramp_c_per_min=1.0)
    cold = Soak(setpoint_c=-10.0, hold_s=77.0, tolerance_c=0.1)
    plan = plan_of(
        Static(duration_s=1.0), cold, Static(duration_s=1.0), ramp, Sine(amplitude_dps=1.0, frequency_hz=1.0, cycles=1)
    )
    before_third, before_fifth, before_first = (soak_before(plan, number, 23.0) for number in (3, 5, 2))
    assert (before_third.setpoint_c, before_third.hold_s, before_third.tolerance_c) == (-10.0, 77.0, 0.1)
    assert (before_fifth.setpoint_c, before_fifth.hold_s) == (40.0, PLAIN_SOAK_S)
    assert (before_first.setpoint_c, before_first.hold_s) == (23.0, PLAIN_SOAK_S)


def _bench(**changes: Any) -> Bench:
    tables: dict[str, Any] = {}
    for name, fields in changes.items():
        table = getattr(BENCH, name)
        tables[name] = (
            table.model_copy(update=fields) if isinstance(fields, Mapping) and not isinstance(table, dict) else fields
        )
    return BENCH.model_copy(update=tables)


@pytest.mark.parametrize(
    ("plan", "bench", "says"),
    [
        (replace(PLAN, procedure="yours"), BENCH, "procedure was mine, is yours"),
        (replace(PLAN, source="other"), BENCH, "source of the procedure (SHA-256) was 41cf6794ba42, is d9298a10d1b0"),
        (replace(PLAN, parameters={"points": 3}), BENCH, "parameter points was not there, is 3"),
        (PLAN, _bench(unit={"serial": "OTHER-7"}), "unit.serial was SIM-0001, is OTHER-7"),
        (PLAN, _bench(limits={"rate_dps": 250.0}), "limits.rate_dps was 300.0, is 250.0"),
        (PLAN, _bench(digitizer={"sample_rate_hz": 250.0}), "digitizer.sample_rate_hz was 500.0, is 250.0"),
        (PLAN, _bench(effects={"adc_coarse": {"bits_lost": 2}}), "effects.adc_coarse.bits_lost was not there, is 2"),
        (plan_of(SOAK, Static(duration_s=10.0), *STEPS[3:]), BENCH, None),
        (plan_of(SOAK, ConstantRate(rate_dps=1.0, duration_s=1.0)), BENCH, "step 2 was static at +25, is rate +1"),
    ],
)
def test_another_procedure_unit_or_bench_is_refused_in_one_line(
    interrupted: Path, plan: Plan, bench: Bench, says: str | None
) -> None:
    before = sorted(interrupted.iterdir())
    if says is None:  # what is to come may not be known yet: only what was recorded is compared
        with past_of(interrupted, plan, bench) as past:
            assert past.first == 3
    else:
        with pytest.raises(UsageError) as caught, past_of(interrupted, plan, bench):
            pass
        assert says in str(caught.value)
        assert str(caught.value).startswith("--resume: this is not the campaign that was begun: ")
        assert "\n" not in str(caught.value)
    assert sorted(interrupted.iterdir()) == before


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("resume") / "c"
    begin(folder, in_the_third_step)
    return folder


def test_who_runs_it_and_how_it_is_reached_and_watched_may_change(interrupted: Path) -> None:
    bench = _bench(
        operator="somebody else",
        name="the bench",
        rate_table={"address": "tcp://x:1"},
        limits={"silence_s": 3.0},
    ).model_copy(update={"notify": Notify.model_validate({"urls": ["json://127.0.0.1:9"]})})
    with past_of(interrupted, PLAN, bench) as past:
        assert past.first == 3


def test_another_instrument_is_refused_before_anything_moves_or_is_written(
    interrupted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with past_of(interrupted, PLAN, BENCH) as past, open_bench(past.bench, wires=False) as opened:
        begun = json.loads(past.meta.provenance["instruments"])
        begun["chamber"]["serial"] = "4711"
        provenance = {**past.meta.provenance, "instruments": json.dumps(begun)}
        past = replace(past, meta=replace(past.meta, provenance=provenance))
        other = replace(opened.identities["chamber"], serial="4712")
        opened = replace(opened, identities={**opened.identities, "chamber": other})
        with pytest.raises(UsageError, match="another instrument answers: chamber: serial was '4711', is '4712'"):
            run_campaign(PLAN, opened, interrupted, past=past)
    assert sorted(item.name for item in interrupted.iterdir()) == ["journal.jsonl", "recording.h5"]


def test_time_goes_on_by_the_wall_and_the_benchs_factor_on_a_real_bench_and_never_back() -> None:
    real = _bench(simulated=False, time_factor=20.0)
    ago = datetime.now(UTC) - timedelta(seconds=100.0)
    events = [{"bench_s": 500.0, "wall_time": ago.isoformat()}, {"kind": "guard", "wall_time": "not a time"}]
    assert elapsed_s(real, [_whole(1)], events) == pytest.approx(500.0 + 20.0 * 100.0, abs=20.0)
    ahead = [{"bench_s": 500.0, "wall_time": (ago + timedelta(days=1)).isoformat()}]
    assert 500.0 < elapsed_s(real, [_whole(1)], ahead) < 510.0
    assert 500.0 < elapsed_s(BENCH, [_whole(1)], events) < 510.0
    assert 900.0 < elapsed_s(BENCH, [replace(_whole(1), t_end=900.0)], events) < 910.0


def test_a_campaign_that_died_after_its_last_step_is_closed_as_complete(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    begin(folder, lambda moment: moment.index == 5 and moment.doing == "recording")
    with past_of(folder, PLAN, BENCH) as past:
        writer, _ = past.reopen()
        step = writer.begin_step(replace(_whole(5), name="static at +25", kind="static"), ("time_s", "gyro_v"))
        step.append({"time_s": np.arange(3.0), "gyro_v": np.ones(3)})
        writer.step_over(step.close(replace(_whole(5), name="static at +25", kind="static")))
        writer.release()
    closed = recover(folder)
    assert (closed.status, closed.reason) == ("complete", "")
    with past_of(folder, PLAN, BENCH) as past:
        assert past.is_whole


def test_a_description_that_makes_no_sense_is_refused_in_one_line(interrupted: Path, tmp_path: Path) -> None:
    shutil.copytree(interrupted, tmp_path / "c")
    with h5py.File(tmp_path / "c" / "recording.h5", "r+") as file:
        file.attrs["provenance_parameters"] = "{"
        seal_recording(file)
    damaged = pytest.raises(UsageError, match=r"^parameters of the campaign, line 1: not JSON: ")
    with damaged as caught, past_of(tmp_path / "c", PLAN, BENCH):
        pass
    assert "\n" not in str(caught.value)
