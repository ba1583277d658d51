"""A plan as rows before it has been run: motion, temperatures, and how much each row stands for."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.campaign.timing import timeline
from benchctl.diagnosis.next_run.planned import planned
from benchctl.diagnosis.next_run.sampled import SampleNoise
from benchctl.plan import ConstantRate, Mount, PowerCycle, Sine, Soak, Static, ThermalRamp
from benchctl.plan.find import find_procedure
from tests.benchctl.diagnosis.following import bench, plan_of

STEPS = (
    Static(duration_s=600.0),
    ConstantRate(rate_dps=-40.0, duration_s=30.0),
    Sine(amplitude_dps=20.0, frequency_hz=2.0, cycles=60),
    ThermalRamp(from_c=23.0, to_c=43.0, ramp_c_per_min=1.0, swing_dps=30.0, swing_hz=0.2),
    Soak(setpoint_c=43.0, hold_s=7200.0),
    Static(duration_s=20.0),
)


def test_rows_stand_for_all_samples_that_would_be_taken() -> None:
    rows = planned(plan_of(*STEPS), bench())
    stands_for = np.bincount(rows.frame.step, rows.stands_for, minlength=len(STEPS))
    assert stands_for == pytest.approx([100.0 * step.streamed_s for step in STEPS])
    assert rows.frame.rows < 0.1 * stands_for.sum()


def test_times_are_those_of_the_timeline_in_order() -> None:
    stands = bench()
    plan = plan_of(*STEPS)
    rows = planned(plan, stands)
    assert (np.diff(rows.frame.time_s) > 0.0).all()
    for place, (start_s, end_s, _) in enumerate(timeline(plan, stands.limits, stands.safe.chamber_c)):
        times = rows.frame.time_s[rows.frame.step == place]
        assert times.size == 0 if isinstance(STEPS[place], Soak) else (times.min(), times.max()) <= (end_s, end_s)
        assert (times >= start_s).all()
    assert rows.bench_time_s == end_s


def test_motion_is_what_the_steps_ask_for_and_its_own_derivative() -> None:
    frame = planned(plan_of(*STEPS), bench()).frame
    peaks = [np.abs(frame.rate_dps[frame.step == place]).max(initial=0.0) for place in range(len(STEPS))]
    assert peaks == pytest.approx([0.0, 40.0, 20.0, 30.0, 0.0, 0.0], rel=0.02)
    assert (frame.rate_dps[frame.step == 1] == -40.0).all()
    for part in frame.stretches:
        rate = np.gradient(frame.angle_deg[part], frame.interval_s)
        turning = np.gradient(frame.rate_dps[part], frame.interval_s)
        assert rate[1:-1] == pytest.approx(frame.rate_dps[part][1:-1], abs=0.02 * 40.0)
        assert turning[1:-1] == pytest.approx(frame.acceleration_dps2[part][1:-1], abs=0.03 * 252.0)


def test_what_a_person_does_and_a_unit_mounted_across_have_no_rows_and_take_their_time() -> None:
    turn = ConstantRate(rate_dps=-40.0, duration_s=30.0)
    steps = (turn, Mount(position="across"), turn, Mount(position="along"), PowerCycle(off_s=60.0), turn)
    rows = planned(plan_of(*steps), bench())
    assert set(rows.frame.step) == {0, 5}
    assert rows.bench_time_s > 3 * 30.0 + 2 * 120.0 + 60.0


def test_the_thermistor_lags_behind_a_ramp_and_arrives_after_a_soak() -> None:
    frame = planned(plan_of(*STEPS), bench()).frame
    ramp = frame.step == 3
    assert frame.temp_c[frame.step < 3] == pytest.approx(23.0)
    assert (np.diff(frame.temp_c[ramp]) >= 0.0).all()
    assert 28.0 < frame.temp_c[ramp].max() < 36.0
    assert 0.005 < frame.temp_rate_c_per_s[ramp].max() < 1.0 / 60.0
    assert frame.temp_c[frame.step == 5] == pytest.approx(43.0, abs=0.05)


@pytest.mark.parametrize("name", ["diagnostic", "rate_sweep", "sine_sweep", "static", "temperature_sweep"])
def test_every_installed_procedure_can_be_laid_out_in_few_rows(name: str) -> None:
    rows = planned(find_procedure(name).expand(), bench(), ("supply_v",))
    assert 0 < rows.frame.rows < 120_000
    assert rows.frame.auxiliary["supply_v"].shape == rows.stands_for.shape
    for values in (rows.frame.angle_deg, rows.frame.temp_c, rows.frame.temp_rate_c_per_s, rows.stands_for):
        assert np.isfinite(values).all()


def test_what_makes_white_noise_white_makes_a_wandering_bias_white_too() -> None:
    rows = planned(plan_of(Static(duration_s=400.0), Static(duration_s=400.0)), bench())
    noise = SampleNoise(white_v=1e-3, walk_v_per_sqrt_s=2e-4)
    chance = np.random.default_rng(3)
    frame, counting = rows.frame, rows.stands_for > 0.0
    whiten = noise.whitening(rows)
    per_row = 1e-3 / np.sqrt(rows.stands_for[counting].min())
    squares, degrees = 0.0, 0
    for _ in range(30):
        walk = np.cumsum(2e-4 * np.sqrt(frame.interval_s) * chance.standard_normal(frame.rows))
        white = whiten(walk + per_row * chance.standard_normal(frame.rows))
        squares += float(white @ white)
        degrees += int(counting.sum()) - len(frame.stretches)
    assert squares / degrees == pytest.approx(1.0, rel=0.06)
    assert whiten(np.ones(frame.rows)) == pytest.approx(0.0, abs=1e-9)
