"""While a step is recorded the encoder is held against its demand: a stranger moves the table over its real wire."""

from __future__ import annotations

import itertools
import json
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from benchctl.bench import Bench, load_bench
from benchctl.campaign.encoder_motion import Deviation, HeldMotion
from benchctl.campaign.opened import OpenBench, open_bench
from benchctl.campaign.runner import Moment, Outcome, run_campaign
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Static, Step, ThermalRamp
from benchctl.recordings.reader import open_recording
from benchctl_instruments.arrays import FloatArray, IntArray

BENCH = load_bench("simulated")
HZ = BENCH.digitizer.sample_rate_hz
TURN = ConstantRate(rate_dps=60.0, duration_s=20.0)
SWING = Sine(amplitude_dps=100.0, frequency_hz=0.5, cycles=10)
REST = Static(duration_s=20.0)
RAMP = ThermalRamp(from_c=23.0, to_c=24.0, ramp_c_per_min=2.0, swing_dps=50.0)
SOAK = Soak(setpoint_c=23.0, hold_s=10.0, drift_c_per_min=10.0)
TO_7 = (":dem:rate 1,7", ":mode:rate 1")
TO_60 = (":dem:rate 1,60", ":mode:rate 1")
LARGER = (":dem:osc 1,38.2,0.5,0", ":mode:synt 1")


class Stranger:
    """Another program, which commands the table over a connection of its own while steps are recorded."""

    def __init__(self, opened: OpenBench, says: tuple[str, ...], times: int) -> None:
        assert opened.simulated is not None
        where = urlsplit(opened.simulated.addresses["rate_table"])
        self._where, self._says, self._times, self._looks = (where.hostname, where.port), says, times, 0

    def __call__(self, moment: Moment) -> None:
        recorded = moment.doing == "recording" and "soak" not in moment.label
        self._looks = self._looks + 1 if recorded else 0
        if self._looks == 2 and self._times:  # not at once
            self._times -= 1
            with socket.create_connection(self._where, timeout=5) as line, line.makefile("rb") as replies:
                for text in self._says:
                    line.sendall(f"{text}\r\n".encode())
                    replies.readline()


def _run(folder: Path, says: tuple[str, ...], times: int, *steps: Step) -> tuple[Outcome, list[dict[str, Any]], float]:
    plan = Plan(procedure="mine", parameters={}, steps=steps, calibrates=False)
    with open_bench(BENCH) as opened:
        outcome = run_campaign(plan, opened, folder, progress=Stranger(opened, says, times))
        rate_dps = opened.table.read().rate_dps
    events = [json.loads(line) for line in (folder / "journal.jsonl").read_text(encoding="utf-8").splitlines()]
    return outcome, events, rate_dps


def _kinds(events: list[dict[str, Any]], kind: str) -> list[dict[str, Any]]:
    return [event for event in events if event["kind"] == kind]


CASES = [
    (TURN, TO_7, 60.0),
    (REST, TO_7, 0.0),
    (SWING, TO_7, None),
    (SWING, TO_60, None),
    (SWING, LARGER, None),
]


@pytest.mark.parametrize(("step", "says", "demanded_dps"), CASES)
def test_a_step_in_which_a_stranger_moved_the_table_is_not_complete_and_is_played_again(
    step: Step, says: tuple[str, ...], demanded_dps: float | None, tmp_path: Path
) -> None:
    outcome, events, _ = _run(tmp_path / "c", says, 1, SOAK, step)
    assert (outcome.status, outcome.whole, outcome.error) == ("complete", 2, None)
    (seen,) = _kinds(events, "motion")
    assert abs(seen["measured_dps"] - seen["demanded_dps"]) > seen["tolerance_dps"] > 0.5
    if demanded_dps is not None:
        assert seen["demanded_dps"] == demanded_dps
    with open_recording(outcome.recording) as recording:
        _, again, aside = recording.infos
        assert (again.index, again.whole, again.role) == (2, True, "fit")
        assert (aside.index, aside.whole, aside.role) == (3, False, "none")
        assert aside.name == f"cut attempt of step 2: {again.name}"
        assert aside.t_start < seen["time_s"] < aside.t_end < again.t_start
        assert again.samples == round(step.streamed_s * HZ)
        assert outcome.samples == sum(info.samples for info in recording.infos)
        count = np.rint(np.unwrap(recording.step(2)["encoder_deg"], period=360.0) * 1000.0).astype(np.int64)
        assert HeldMotion(BENCH, step, HZ).look(0, count) is None


@pytest.mark.parametrize(("step", "says", "demanded_dps"), [CASES[0], CASES[1], CASES[2]])
def test_where_it_happens_again_the_run_ends_with_the_table_at_rest(
    step: Step, says: tuple[str, ...], demanded_dps: float | None, tmp_path: Path
) -> None:
    outcome, events, rate_dps = _run(tmp_path / "c", says, 2, SOAK, step, TURN)
    assert (outcome.status, outcome.whole) == ("aborted", 1)
    assert outcome.error is not None
    assert outcome.error.exit_status == 3
    assert str(outcome.error).startswith("rate_table: the encoder shows a")
    assert len(_kinds(events, "motion")) == 2
    assert (outcome.safe.problems, outcome.safe.chamber_setpoint_c) == ((), 23.0)
    assert abs(rate_dps) < 0.05
    with open_recording(outcome.recording) as recording:
        assert [(info.index, info.whole) for info in recording.infos] == [(1, True), (2, False), (4, False)]


def test_a_thermal_ramp_is_played_again_from_the_temperature_at_which_it_began(tmp_path: Path) -> None:
    outcome, events, _ = _run(tmp_path / "c", TO_7, 1, SOAK, RAMP, REST)
    assert (outcome.status, outcome.whole, outcome.error) == ("complete", 3, None)
    assert len(_kinds(events, "motion")) == 1
    with open_recording(outcome.recording) as recording:
        names = {info.index: info.name for info in recording.infos}
        assert names[5].startswith("soak at +23 again, before step 2")
        assert recording.step(2)["poll_chamber_setpoint_c"][0] == pytest.approx(23.0, abs=0.2)


def test_a_run_that_nobody_disturbs_has_no_such_event(tmp_path: Path) -> None:
    rises_long = ThermalRamp(from_c=23.0, to_c=24.0, ramp_c_per_min=2.0, swing_dps=52.5, swing_hz=0.2, settle_s=2.0)
    steps = (SOAK, TURN, SWING, REST, RAMP, rises_long, Sine(amplitude_dps=20.0, frequency_hz=10.0, cycles=40))
    outcome, events, _ = _run(tmp_path / "c", TO_7, 0, *steps)
    assert (outcome.status, outcome.error) == ("complete", None)
    assert _kinds(events, "motion") == []


def _counts(angle_deg: FloatArray, counts_per_rev: int = 360_000) -> IntArray:
    return np.floor(angle_deg * counts_per_rev / 360.0).astype(np.int64)


def _coarse(counts_per_rev: int, rate_hz: float = HZ) -> Bench:
    entry = BENCH.digitizer.model_copy(
        update={"encoder_counts_per_rev": counts_per_rev, "encoder_accuracy_arcsec": 0.0, "sample_rate_hz": rate_hz}
    )
    return BENCH.model_copy(update={"digitizer": entry})


def _looked(held: HeldMotion, count: IntArray, cuts: list[int]) -> list[Deviation]:
    bounds = sorted({0, len(count), *(cut for cut in cuts if cut < len(count))})
    looks = [held.look(low, count[low:high]) for low, high in itertools.pairwise(bounds)]
    return [look for look in looks if look is not None]


def _times_s(step: Step) -> FloatArray:
    return np.arange(round(step.streamed_s * HZ)) / HZ


@given(
    counts_per_rev=st.sampled_from([360, 3600, 360_000]),
    amplitude_dps=st.floats(0.5, 300.0),
    frequency_hz=st.floats(0.02, 50.0),
    phase=st.floats(0.0, 6.28),
    servo=st.floats(0.7, 1.3),
    cuts=st.lists(st.integers(1, 5000), max_size=8),
)
@example(
    counts_per_rev=3600, amplitude_dps=10.092, frequency_hz=9.0358, phase=0.074793, servo=1.25794, cuts=[]
)  # both rates of which the amplitude is made are a whole count off
@example(counts_per_rev=1024, amplitude_dps=31.3031, frequency_hz=10.17771, phase=0.912055, servo=1.067005, cuts=[])
def test_a_sine_of_whatever_phase_is_no_deviation_however_coarse_the_encoder(
    counts_per_rev: int, amplitude_dps: float, frequency_hz: float, phase: float, servo: float, cuts: list[int]
) -> None:
    step = Sine(amplitude_dps=amplitude_dps, frequency_hz=frequency_hz, cycles=8)
    omega = 2.0 * np.pi * frequency_hz
    angle_deg = servo * amplitude_dps / omega * np.sin(omega * _times_s(step) + phase)
    assert _looked(HeldMotion(_coarse(counts_per_rev), step, HZ), _counts(angle_deg, counts_per_rev), cuts) == []


@given(
    counts_per_rev=st.sampled_from([360, 3600, 360_000]),
    rate_dps=st.floats(-300.0, 300.0),
    cuts=st.lists(st.integers(1, 5000), max_size=8),
)
def test_a_rate_that_is_kept_is_no_deviation_and_one_that_changes_is(
    counts_per_rev: int, rate_dps: float, cuts: list[int]
) -> None:
    step = ConstantRate(rate_dps=rate_dps, duration_s=10.0)
    bench, time_s = _coarse(counts_per_rev), _times_s(step)
    assert _looked(HeldMotion(bench, step, HZ), _counts(rate_dps * time_s, counts_per_rev), cuts) == []
    angle_deg = rate_dps * time_s + 30.0 * np.maximum(time_s - 5.0, 0.0)
    seen = _looked(HeldMotion(bench, step, HZ), _counts(angle_deg, counts_per_rev), cuts)
    assert seen[0].demanded_dps == rate_dps
    assert 5.0 * HZ < seen[0].index <= 6.0 * HZ


@pytest.mark.parametrize(
    "angle_of",
    [
        lambda time_s: 0.0 * time_s,  # stands still
        lambda time_s: 70.7 * time_s,  # turns, as fast as the sine is in the mean of its square
        lambda time_s: 100.0 / np.pi * np.sin(np.pi * time_s * 1.2),  # swings at another frequency
        lambda time_s: 40.0 / np.pi * np.sin(np.pi * time_s),  # swings far less
        lambda time_s: 100.0 / np.pi * np.sin(np.pi * time_s) + 6.0 * time_s,  # swings and drifts
    ],
)
def test_what_is_not_the_sine_is_a_deviation(angle_of: Callable[[FloatArray], FloatArray]) -> None:
    assert _looked(HeldMotion(BENCH, SWING, HZ), _counts(angle_of(_times_s(SWING))), [700, 1400]) != []


@pytest.mark.parametrize("step", [TURN, SWING])
def test_nothing_is_concluded_across_a_gap(step: Step) -> None:
    time_s = _times_s(step)
    omega = np.pi
    angle_deg = 60.0 * time_s if step is TURN else 100.0 / omega * np.sin(omega * time_s)
    count = _counts(angle_deg)
    count[3210:] += 77_000  # the count was lost with the scans
    held = HeldMotion(BENCH, step, HZ)
    assert held.look(0, count[:3000]) is None
    assert held.look(3210, count[3210:5000]) is None
    assert held.look(5000, count[5000:]) is None


def test_the_tolerance_is_that_of_the_bench() -> None:
    limits = BENCH.limits.model_copy(update={"motion_error_dps": 10.0, "motion_error_percent": 50.0})
    count = _counts(80.0 * _times_s(TURN))
    assert HeldMotion(BENCH, TURN, HZ).look(0, count) is not None
    assert HeldMotion(BENCH.model_copy(update={"limits": limits}), TURN, HZ).look(0, count) is None


def test_a_table_that_needs_its_time_is_not_looked_at_before() -> None:
    at_once = ConstantRate(rate_dps=60.0, duration_s=10.0, settle_s=0.0)
    time_s = _times_s(at_once)
    count = _counts(60.0 * time_s + 6.0 * np.minimum(time_s, 0.4))  # overshoots for 0.4 s
    assert HeldMotion(BENCH, at_once, HZ).look(0, count) is None
    settled = ConstantRate(rate_dps=60.0, duration_s=10.0)
    assert HeldMotion(BENCH, settled, HZ).look(0, count) is not None
