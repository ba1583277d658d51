"""Reduction: what is kept, what is left out, and where the rate stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.recordings.model import Step
from benchctl.signals.reduce import reduce_step, reduce_steps
from benchctl.signals.segments import clipped
from benchctl_instruments.errors import UsageError
from tests.benchctl.calibration.synthetic import Ask, Truth, meta_of, steps

TRUTH = Truth()
META = meta_of(TRUTH)


def one(ask: Ask, truth: Truth = TRUTH) -> Step:
    return next(steps(truth, [ask], seed=5))


def changed(step: Step, **channels: np.ndarray) -> Step:
    return Step(step.info, {**step.channels, **channels})


def test_a_constant_rate_becomes_whole_revolutions() -> None:
    reduced = reduce_step(one(Ask(kind="constant_rate", temperature=20, rate=100, seconds=9.5)), META)
    assert reduced is not None
    assert reduced.revolutions == pytest.approx(2.0, abs=0.01)
    assert np.average(reduced.rate_dps, weights=reduced.count) == pytest.approx(100, abs=1e-3)


def test_a_spin_up_inside_the_step_is_found_by_the_encoder() -> None:
    step = one(Ask(kind="constant_rate", temperature=20, rate=50, seconds=20))
    t = np.arange(step["time_s"].size) / TRUTH.fs
    spin = np.where(t < 2, 12.5 * t**2, 50 * t - 50)
    reduced = reduce_step(changed(step, encoder_deg=np.floor(spin * 1000) / 1000 % 360), META)
    assert reduced is not None
    assert reduced.unsettled / TRUTH.fs == pytest.approx(2.1, abs=0.15)
    assert np.all(np.abs(reduced.rate_dps - 50) < 0.05)


def test_a_step_that_never_settles_is_not_used() -> None:
    step = one(Ask(kind="constant_rate", temperature=20, rate=50, seconds=10))
    t = np.arange(step["time_s"].size) / TRUTH.fs
    assert reduce_step(changed(step, encoder_deg=(5 * t**2) % 360), META) is None


def test_clipped_samples_leave_with_their_blocks() -> None:
    step = one(Ask(kind="sine", temperature=20, rate=150, frequency=0.5, seconds=20))
    volts = step["gyro_v"].copy()
    volts[3000:3050] = 10.0
    reduced, whole = reduce_step(changed(step, gyro_v=volts), META), reduce_step(step, META)
    assert reduced is not None
    assert whole is not None
    assert reduced.masked == 50
    assert whole.count.size - 5 <= reduced.count.size <= whole.count.size - 3
    assert reduced.output_v.max() < 8


def test_a_stated_output_limit_clips_too() -> None:
    meta = replace(META, simulation={"output_limit_v": 4.0})
    assert clipped(np.array([3.9, 4.0, -4.0, 9.9]), meta).tolist() == [False, True, True, True]
    assert clipped(np.array([3.9, 4.0, -4.0, 10.0]), META).tolist() == [False, False, False, True]


def test_nothing_is_smoothed_across_a_gap() -> None:
    step = one(Ask(kind="sine", temperature=20, rate=150, frequency=0.5, seconds=20))
    keep = np.r_[0:4000, 4700:10000]
    cut = Step(step.info, {name: values[keep] for name, values in step.channels.items()})
    reduced = reduce_step(cut, META)
    assert reduced is not None
    phase = 2 * np.pi * 0.5 * (reduced.time_s - step["time_s"][0] - reduced.delay_s)
    assert reduced.rate_dps == pytest.approx(150 * np.sin(phase), abs=0.35)
    inside = (reduced.time_s > step["time_s"][4000]) & (reduced.time_s < step["time_s"][4700])
    assert not inside.any()


def test_the_delay_is_found_within_a_step() -> None:
    reduced = reduce_step(one(Ask(kind="sine", temperature=20, rate=150, frequency=1, seconds=20)), META)
    assert reduced is not None
    assert reduced.delay_s == pytest.approx(TRUTH.delay, abs=2e-5)


def test_a_missing_channel_is_named() -> None:
    step = one(Ask(kind="static", temperature=20, seconds=5))
    bare = Step(step.info, {name: values for name, values in step.channels.items() if name != "encoder_deg"})
    with pytest.raises(UsageError, match="needs the channel encoder_deg"):
        reduce_step(bare, META)


@pytest.mark.parametrize("kind", ["soak", "thermal_ramp", "unassigned"])
def test_steps_that_no_calibration_uses_are_passed_over(kind: str) -> None:
    step = one(Ask(kind="static", temperature=20, seconds=5))
    assert list(reduce_steps([Step(replace(step.info, kind=kind), {})], META)) == []


def test_a_recording_without_a_thermistor_reduces() -> None:
    step = one(Ask(kind="static", temperature=20, seconds=5))
    bare = Step(step.info, {name: values for name, values in step.channels.items() if name != "gyro_temp_c"})
    reduced = reduce_step(bare, META)
    assert reduced is not None
    assert np.isnan(reduced.mean_temperature_c)


def test_a_long_free_motion_comes_in_pieces_with_keys_of_their_own() -> None:
    step = one(Ask(kind="sine", temperature=20, rate=50, frequency=0.1, seconds=250))
    free = Step(replace(step.info, kind="motion", frequency_hz=None, amplitude_dps=None), step.channels)
    pieces = list(reduce_steps([free], META))
    assert [piece.key for piece in pieces] == [(1, 0), (1, 1), (1, 2), (1, 3)]


def test_motion_of_which_no_run_is_as_long_as_a_window_gives_nothing() -> None:
    step = next(steps(TRUTH, [Ask(kind="sine", temperature=20, rate=150, frequency=1, seconds=20)], seed=1))
    kept = np.flatnonzero(np.arange(step["time_s"].size) % 40 < 36)
    torn = {name: values[kept] for name, values in step.channels.items()}
    free = replace(step.info, kind="motion", frequency_hz=None, amplitude_dps=None)
    assert reduce_step(Step(free, torn), META) is None
