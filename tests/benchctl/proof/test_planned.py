"""What an effect is worth on a planned run."""

from dataclasses import replace

import numpy as np
import pytest

from benchctl.plan import ConstantRate, Plan, Static
from benchctl.proof.planned import Planned, planned
from benchctl.proof.unit import TrialUnit, draw_unit
from benchctl_instruments.physics.effects.making import make_effects


@pytest.fixture
def unit() -> TrialUnit:
    drawn = draw_unit(np.random.default_rng(3), moved=False, lacking=frozenset({"k_T", "k_omega"}), warm=False)
    return replace(drawn, noise_v=1e-3, sample_rate_hz=100.0)


@pytest.fixture
def run(unit: TrialUnit) -> Planned:
    steps = (Static(duration_s=20.0), ConstantRate(rate_dps=50.0, duration_s=30.0), Static(duration_s=20.0))
    return planned(Plan(procedure="mine", parameters={}, steps=steps, calibrates=False), unit)


def test_a_drift_is_worth_its_square_over_the_noise_beside_bias_and_scale(run: Planned, unit: TrialUnit) -> None:
    volts_per_hour = 0.05
    later = np.ones(run.signals.time_s.size, bool)
    for start in run.starts:
        later[start : start + 50] = False  # half a second, in which a step settles
    time_s, rate = run.signals.time_s[later], run.signals.rate_dps[later]
    drift = volts_per_hour * time_s / 3600.0
    columns = np.column_stack([np.ones_like(rate), rate])
    left = drift - columns @ np.linalg.lstsq(columns, drift, rcond=None)[0]
    worth = np.sum(left**2) / (unit.noise_v**2 + (20.0 / 65536) ** 2 / 12)
    assert run.gain(make_effects({"bias_drift": {"v_per_hour": volts_per_hour}})) == pytest.approx(worth, rel=1e-6)


def test_twice_the_size_is_worth_four_times_as_much(run: Planned) -> None:
    once, twice = (run.gain(make_effects({"bias_drift": {"v_per_hour": size}})) for size in (0.01, 0.02))
    assert twice == pytest.approx(4 * once, rel=1e-6)


def test_what_the_run_does_not_bring_out_is_worth_nothing(run: Planned) -> None:
    assert run.gain(make_effects({"timing_offset": {"offset_s": 0.01}})) < 1e-12
    assert run.gain(make_effects({"bias_temperature": {"c1_v_per_c": 1e-3, "c2_v_per_c2": 0.0}})) < 1e-12
    assert run.gain(()) == 0.0


def test_beside_a_walk_an_effect_is_worth_what_the_whole_covariance_lets_it(unit: TrialUnit) -> None:
    slow = replace(unit, sample_rate_hz=10.0)
    steps = (Static(duration_s=20.0), ConstantRate(rate_dps=50.0, duration_s=30.0), Static(duration_s=20.0))
    run = planned(Plan(procedure="mine", parameters={}, steps=steps, calibrates=False), slow)
    later = np.ones(run.signals.time_s.size, bool)
    for start in run.starts:
        later[start : start + 5] = False
    time_s, rate = run.signals.time_s[later], run.signals.rate_dps[later]
    per_root_s = 2e-4
    since_s = time_s - time_s[0]
    covariance = per_root_s**2 * np.minimum.outer(since_s, since_s)
    covariance += (slow.noise_v**2 + (20.0 / 65536) ** 2 / 12) * np.eye(time_s.size)
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    # where the walk begins is not known: the bias takes that up
    columns = root @ np.column_stack([np.ones_like(rate), rate])
    change = root @ (0.5 * time_s / 3600.0)
    left = change - columns @ np.linalg.lstsq(columns, change, rcond=None)[0]
    drift = make_effects({"bias_drift": {"v_per_hour": 0.5}})
    walking = {"bias_random_walk": {"v_per_sqrt_s": per_root_s}}
    assert run.gain(drift, walking) == pytest.approx(float(left @ left), rel=0.03)
    assert run.gain(drift, walking) < 0.2 * run.gain(drift)


def test_beside_flicker_what_is_slow_is_worth_less_and_a_line_what_the_density_there_leaves(
    run: Planned, unit: TrialUnit
) -> None:
    flickering = {"flicker_noise": {"v_rms_per_decade": 5e-4}}
    slow = make_effects({"bias_drift": {"v_per_hour": 0.05}})
    line = make_effects({"mains_pickup": {"amplitude_v": 1e-3, "frequency_hz": 40.0, "phase_deg": 0.0}})
    white = (unit.noise_v**2 + (20.0 / 65536) ** 2 / 12) * 2.0 / unit.sample_rate_hz  # V²/Hz
    flicker = 5e-4**2 / np.log(10.0) / 40.0
    assert run.gain(slow, flickering) < 0.1 * run.gain(slow)
    assert run.gain(line, flickering) == pytest.approx(run.gain(line) / (1.0 + flicker / white), rel=0.03)
