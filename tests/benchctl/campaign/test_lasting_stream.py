"""A stream that falls silent in the middle of a step: over the wires as it befalls a run, and by itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.bench import Bench, load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import Outcome, run_campaign
from benchctl.campaign.stream import LastingStream
from benchctl.plan import ConstantRate, Plan
from benchctl.recordings.reader import Recording, open_recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import LinkError, SafetyError
from benchctl_instruments.interfaces import ScanBlock
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.direct import DirectDigitizer
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World

TURN = ConstantRate(rate_dps=50.0, duration_s=30.0, settle_s=1.0)
WANTED = 15_000
STOPS = "^10 13 7e 00 02 04 00 00 00 00"  # ENABLE, register 4990, written with 0


def bench_with(*faults: dict[str, Any], silence_s: float = 0.4) -> Bench:
    """The simulated bench with faults, and little patience."""
    document = load_bench("simulated").model_dump()
    document["limits"]["silence_s"] = silence_s
    document["digitizer"]["options"] = {"timeout_s": 0.25}
    return Bench.model_validate({**document, "faults": faults})


def run(bench: Bench, folder: Path, step: ConstantRate = TURN) -> Outcome:
    plan = Plan(procedure="mine", parameters={}, steps=(step,), calibrates=False)
    with open_bench(bench) as opened:
        return run_campaign(plan, opened, folder)


def events_of(recording: Recording) -> list[dict[str, Any]]:
    return [json.loads(line) for line in str(recording.meta.provenance["journal"]).splitlines()]


def off_the_line_deg(recording: Recording) -> FloatArray:
    """How far the angle is from that of a constant rate, by the step's own stamps, before and behind gaps alike."""
    step = recording.step(1)
    turned = np.mod(step["encoder_deg"] - TURN.rate_dps * step["time_s"], 360.0)
    return np.asarray((turned - turned[0] + 180.0) % 360.0 - 180.0)


@pytest.mark.parametrize(
    ("fault", "from_the_start"),
    [
        ({"kind": "stream_ends", "from_s": 12.0, "times": 1}, False),
        ({"kind": "stream_ends", "nth": 1}, True),
        ({"kind": "stream_cut", "nth": 1}, True),  # before any packet came: nobody knows how many are missing
    ],
    ids=["ends", "ends at once", "breaks at once"],
)
def test_a_stream_that_is_over_is_started_anew_and_the_gap_is_marked(
    fault: dict[str, Any], from_the_start: bool, tmp_path: Path
) -> None:
    outcome = run(bench_with({"on": "digitizer_stream", **fault}), tmp_path / "c")
    assert (outcome.status, outcome.whole, outcome.error) == ("complete", 1, None)
    with open_recording(outcome.recording) as recording:
        (info,) = recording.infos
        stamps = recording.step(1)["time_s"]
        events = events_of(recording)
        assert np.abs(off_the_line_deg(recording)).max() < 0.02
        assert np.isfinite(recording.step(1)["gyro_v"]).all()
    assert (info.whole, info.gaps) == (True, 1)
    assert 0 < info.samples < WANTED
    assert stamps.size == info.samples
    assert (stamps[0] - info.t_start > 0.1) == from_the_start
    assert np.count_nonzero(np.diff(stamps) > 1.5 / 500.0) == (0 if from_the_start else 1)
    assert info.t_end - info.t_start == pytest.approx(TURN.duration_s, abs=0.002)
    told = [event["kind"] for event in events if event["kind"] in ("silence", "recovered", "gap")]
    assert told == ["silence", "recovered", "gap"]
    (gap,) = (event for event in events if event["kind"] == "gap")
    assert gap["scans"] == WANTED - info.samples
    (recovered,) = (event for event in events if event["kind"] == "recovered")
    assert recovered["says"].endswith("; its stream was started anew, what is missing is a gap")


def test_a_stream_that_is_late_is_waited_for_and_nothing_is_missing(tmp_path: Path) -> None:
    late = {"on": "digitizer_stream", "kind": "stream_stalls", "for_s": 0.7, "from_s": 12.0, "times": 1}
    outcome = run(bench_with(late, silence_s=1.0), tmp_path / "c")
    with open_recording(outcome.recording) as recording:
        assert (recording.infos[0].samples, recording.infos[0].gaps) == (WANTED, 0)
        kinds = [event["kind"] for event in events_of(recording)]
    assert kinds.count("silence") == 1
    assert "recovered" not in kinds


def test_a_gap_that_reaches_beyond_the_step_ends_with_it(tmp_path: Path) -> None:
    at_the_end = {"on": "digitizer_stream", "kind": "stream_ends", "pattern": f"packet {WANTED // 25 - 20}$"}
    outcome = run(bench_with(at_the_end), tmp_path / "c")
    assert outcome.error is None
    with open_recording(outcome.recording) as recording:
        (info,) = recording.infos
        (gap,) = (event for event in events_of(recording) if event["kind"] == "gap")
    assert (info.samples, info.gaps, gap["scans"]) == (WANTED - 500, 1, 500)
    assert info.t_end - info.t_start == pytest.approx(TURN.duration_s, abs=0.002)


SHORT = ConstantRate(rate_dps=50.0, duration_s=0.4, settle_s=1.0)
"""Over before a stream that ended in it has been started anew: a gap takes all of it."""


def test_a_step_that_a_gap_has_swallowed_is_not_complete_and_is_played_again(tmp_path: Path) -> None:
    outcome = run(bench_with({"on": "digitizer_stream", "kind": "stream_ends", "nth": 1}), tmp_path / "c", SHORT)
    assert (outcome.status, outcome.whole, outcome.error) == ("complete", 1, None)
    with open_recording(outcome.recording) as recording:
        again, aside = recording.infos
    assert (again.index, again.whole, again.samples, again.gaps) == (1, True, 200, 0)
    assert (aside.index, aside.whole, aside.samples, aside.gaps) == (2, False, 0, 1)
    assert (aside.name, aside.role) == (f"cut attempt of step 1: {again.name}", "none")


def test_where_a_gap_swallows_a_step_twice_the_run_ends_with_the_bench_at_rest(tmp_path: Path) -> None:
    always = {"on": "digitizer_stream", "kind": "stream_ends", "pattern": "packet 1$"}
    outcome = run(bench_with(always), tmp_path / "c", SHORT)
    assert (outcome.status, outcome.whole, outcome.safe.problems) == ("aborted", 0, ())
    assert isinstance(outcome.error, SafetyError)
    assert str(outcome.error).startswith("digitizer: 0 of 200 scans of a step came")
    with open_recording(outcome.recording) as recording:
        assert [info.whole for info in recording.infos] == [False, False]


def test_a_digitizer_that_never_streams_again_ends_the_run_with_the_bench_at_rest(tmp_path: Path) -> None:
    outcome = run(bench_with({"on": "digitizer_stream", "kind": "stream_ends", "from_s": 12.0}), tmp_path / "c")
    assert outcome.status == "aborted"
    assert isinstance(outcome.error, SafetyError)
    assert str(outcome.error).startswith("digitizer: no news for ")
    assert "\n" not in str(outcome.error)
    assert outcome.safe.problems == ()
    with open_recording(outcome.recording) as recording:
        assert [info.whole for info in recording.infos] == [False]
        assert recording.infos[0].samples > 1000


def test_a_digitizer_that_lost_its_count_meanwhile_is_not_started_anew(tmp_path: Path) -> None:
    ends = {"on": "digitizer_stream", "kind": "stream_ends", "from_s": 12.0, "times": 1}
    restarts = {"on": "digitizer", "kind": "restart", "pattern": STOPS, "from_s": 12.0, "times": 1, "for_s": 0.1}
    outcome = run(bench_with(ends, restarts), tmp_path / "c")
    assert outcome.status == "aborted"
    assert "it has restarted, and the count is lost" in str(outcome.error)
    assert outcome.safe.problems == ()


class Mortal(DirectDigitizer):
    """A digitizer whose stream may die: it brings nothing more, until another one is started."""

    dead = False

    def read_stream(self, scans: int, timeout_s: float) -> ScanBlock:
        if self.dead:
            raise LinkError("digitizer: nothing came")
        return super().read_stream(scans, timeout_s)

    def start_stream(self, rate_hz: float) -> Any:
        self.dead = False
        return super().start_stream(rate_hz)


@pytest.fixture
def turning() -> tuple[VirtualClock, World]:
    clock = VirtualClock()
    world = World(clock, WorldSettings())
    world.table.close_loop()
    world.table.demand_rate(40.0)
    clock.sleep(5.0)
    return clock, world


def stream_of(clock: VirtualClock, world: World) -> tuple[Mortal, LastingStream]:
    digitizer = Mortal(world)
    digitizer.open()
    stream = LastingStream(digitizer, clock, rate_hz=100.0, patience_s=0.001, first_scans_s=0.02, beat=lambda: None)
    return digitizer, stream


ACTS = st.one_of(
    st.tuples(st.just("wait"), st.floats(0.001, 0.7)),
    st.tuples(st.just("die"), st.just(0.0)),
    st.tuples(st.just("read"), st.integers(1, 30)),
)


@settings(deadline=None, max_examples=25)
@given(acts=st.lists(ACTS, max_size=25))
def test_whatever_befalls_a_stream_every_scan_has_its_true_instant(acts: list[tuple[str, float]]) -> None:
    clock = VirtualClock()
    world = World(clock, WorldSettings())
    world.table.close_loop()
    world.table.demand_rate(40.0)
    clock.sleep(5.0)
    began_s = clock.now()
    digitizer, stream = stream_of(clock, world)
    next_index = 0
    for act, amount in acts:
        if act == "wait":
            clock.sleep(amount)
        elif act == "die":
            digitizer.dead = True
        else:
            try:
                block = stream.read(int(amount))
            except LinkError:
                continue
            assert block.first_index >= next_index
            next_index = block.first_index + len(block.gyro_v)
            at_s = began_s + stream.instant_s(np.arange(block.first_index, next_index, dtype=np.float64))
            assert at_s[-1] <= clock.now() + 1e-9
            angles = world.table.at(at_s).angle_deg
            np.testing.assert_allclose(block.encoder_count / 1000.0, angles, atol=0.01)


def test_between_two_streams_there_is_always_a_gap_however_soon_one_follows_the_other(
    turning: tuple[VirtualClock, World],
) -> None:
    clock, world = turning
    digitizer, stream = stream_of(clock, world)
    clock.sleep(0.1)
    before = stream.read(10)
    digitizer.dead = True
    with pytest.raises(LinkError):
        stream.read(10)
    assert stream.read(10).first_index == before.first_index + len(before.gyro_v) + 1


def test_what_came_while_nobody_listened_is_taken_before_a_stream_is_given_up(
    turning: tuple[VirtualClock, World],
) -> None:
    clock, world = turning
    _, stream = stream_of(clock, world)
    clock.sleep(0.1)
    assert len(stream.read(10).gyro_v) >= 10
    with pytest.raises(LinkError):
        stream.read(50)
    clock.sleep(0.2)
    late = stream.read(50)
    assert late.first_index == 11
    assert len(late.gyro_v) == 20
