"""The unit's supply and its mounting on the simulated bench, at the terminals."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Effect
from benchctl_instruments.physics.effects.scale_warm_up import ScaleWarmUp
from benchctl_instruments.physics.effects.timing_offset import TimingOffset
from benchctl_instruments.physics.effects.warm_up import WarmUp
from benchctl_instruments.physics.gyro import horizontal_earth_rate_dps
from benchctl_instruments.simulated.bench import SimulatedBench
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.faults.machines import ClockDrift
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World
from tests.instruments.simulated.quiet import QUIET, quiet

U0, K0 = 0.012, 0.05


def bench(settings: WorldSettings, effects: Sequence[Effect] = ()) -> tuple[VirtualClock, World]:
    clock = VirtualClock()
    world = World(clock, settings, effects)
    world.table.close_loop()
    return clock, world


def over(clock: VirtualClock, world: World, seconds: float, rate_hz: float = 100.0) -> FloatArray:
    """The volts of so many seconds from now on, shape (n,)."""
    first_s = clock.now()
    world.inputs.hold_history(first_s)
    clock.sleep(seconds)
    volts = world.inputs.sample(first_s, 1.0 / rate_hz, round(seconds * rate_hz))[1]
    world.inputs.hold_history(None)
    return volts


def with_gyro(**changed: float) -> WorldSettings:
    return quiet(gyro={**QUIET["gyro"], **changed})


def test_without_its_supply_the_output_is_zero_and_the_thermistor_goes_on() -> None:
    clock, world = bench(WorldSettings())
    world.table.demand_rate(40.0)
    assert over(clock, world, 5.0)[-1] > 1.0
    world.power(False)
    clock.sleep(0.01)
    first_s = clock.now()
    clock.sleep(1.0)
    counts, volts, thermistor = world.inputs.sample(first_s, 0.01, 100)
    assert not volts.any()
    assert counts[-1] > counts[0]
    assert thermistor.mean() == pytest.approx(0.05 * 23.0, rel=0.02)
    world.power(True)
    clock.sleep(0.01)
    assert over(clock, world, 1.0).min() > 1.0


def test_samples_that_are_asked_for_later_know_when_the_supply_was_off() -> None:
    clock, world = bench(quiet())
    world.inputs.hold_history(0.0)
    clock.sleep(2.0)
    world.power(False)
    clock.sleep(3.0)
    world.power(True)
    clock.sleep(2.0)
    volts = world.inputs.sample(0.0, 0.01, 701)[1]
    dead = volts == 0.0
    assert np.flatnonzero(dead).tolist() == list(range(201, 501))
    np.testing.assert_allclose(volts[~dead], U0, atol=1e-9)


def test_each_switching_on_draws_a_bias_and_a_scale_factor_that_then_stay() -> None:
    settings = with_gyro(turn_on_bias_v=3e-4, turn_on_scale_ppm=400.0)
    clock, world = bench(settings)
    biases, scales = [], []
    for _ in range(60):
        levels = []
        for rate in (0.0, 5.0):
            world.table.demand_rate(rate)
            clock.sleep(5.0)
            levels.append(over(clock, world, 0.5))
            assert np.ptp(levels[-1]) < 1e-9
        biases.append(levels[0].mean())
        scales.append((levels[1].mean() - levels[0].mean()) / 5.0)
        world.power(False)
        clock.sleep(10.0)
        world.power(True)
    bias, scale_ppm = np.array(biases) - U0, 1e6 * (np.array(scales) / K0 - 1.0)
    assert len(set(biases)) == 60
    assert bias.std() == pytest.approx(3e-4, rel=0.3)
    assert scale_ppm.std() == pytest.approx(400.0, rel=0.3)


def test_who_switches_on_what_is_on_changes_nothing() -> None:
    settings = with_gyro(turn_on_bias_v=3e-4)
    volts = []
    for touched in (False, True):
        clock, world = bench(settings)
        clock.sleep(1.0)
        if touched:
            world.power(True)
            world.mount("along")
        clock.sleep(1.0)
        volts.append(over(clock, world, 1.0))
    np.testing.assert_array_equal(*volts)


def test_a_warm_up_restarts_when_the_supply_comes_on_again() -> None:
    warming = (WarmUp(amplitude_v=2e-3, tau_s=30.0), ScaleWarmUp(fraction=1e-2, tau_s=10.0))
    clock, world = bench(quiet(), warming)
    rate = 5.0
    world.table.demand_rate(rate)
    clock.sleep(400.0)
    swing = K0 / 0.0045 * math.sin(0.0045 * rate)
    np.testing.assert_allclose(over(clock, world, 1.0), U0 + swing, rtol=1e-5)
    world.power(False)
    clock.sleep(20.0)
    world.power(True)
    on_s = clock.now()
    clock.sleep(0.1)
    first_s = clock.now()
    volts = over(clock, world, 60.0)
    after = first_s + np.arange(volts.size) / 100.0 - on_s
    expected = U0 + 2e-3 * np.exp(-after / 30.0) + swing * (1.0 + 1e-2 * np.exp(-after / 10.0))
    np.testing.assert_allclose(volts, expected, atol=2e-6)


def test_a_misalignment_of_two_milliradians_gives_its_sine_of_the_rate_across_and_the_cosine_along() -> None:
    clock, world = bench(with_gyro(misalignment_mrad=2.0))
    means = {}
    for position in ("across", "along"):
        world.mount(position)  # type: ignore[arg-type]
        for rate in (100.0, -100.0):
            world.table.demand_rate(rate)
            clock.sleep(5.0)
            means[position, rate] = over(clock, world, 3.6).mean() - U0
    half = (means["across", 100.0] - means["across", -100.0]) / (2.0 * K0 * 100.0)
    assert half == pytest.approx(math.sin(2e-3), rel=1e-6)
    assert means["across", 100.0] == pytest.approx(-means["across", -100.0], rel=1e-9)
    felt_dps = 100.0 * math.cos(2e-3)
    assert means["along", 100.0] == pytest.approx(K0 / 0.0045 * math.sin(0.0045 * felt_dps), rel=1e-9)


def test_across_the_earths_horizontal_rate_goes_round_with_the_table_and_is_gone_over_a_whole_turn() -> None:
    clock, world = bench(quiet(latitude_deg=58.5))
    world.mount("across")
    clock.sleep(1.0)
    angle_deg = world.table.motion().angle_deg
    north = horizontal_earth_rate_dps(58.5)
    at_rest = over(clock, world, 1.0)
    np.testing.assert_allclose(at_rest, U0 + K0 * north * math.cos(math.radians(angle_deg)), atol=1e-9)
    world.table.demand_rate(90.0)
    clock.sleep(5.0)
    turn = over(clock, world, 4.0) - U0
    assert turn.mean() == pytest.approx(0.0, abs=1e-9)
    assert turn.max() == pytest.approx(K0 * north, rel=1e-3)
    assert turn.min() == pytest.approx(-K0 * north, rel=1e-3)


def test_what_is_done_to_the_unit_is_the_same_however_it_is_looked_at() -> None:
    settings = with_gyro(misalignment_mrad=3.0, turn_on_bias_v=1e-3)
    found = []
    for looks in (False, True):
        clock, world = bench(settings, (WarmUp(amplitude_v=1e-3, tau_s=20.0),))
        world.table.demand_rate(50.0)
        world.inputs.hold_history(0.0)
        for act in (lambda w: w.mount("across"), lambda w: w.power(False), lambda w: w.power(True)):
            clock.sleep(2.0)
            if looks:
                world.inputs.sample(clock.now(), 0.001, 1)
            act(world)
        clock.sleep(2.0)
        found.append(world.inputs.sample(6.5, 0.002, 700)[1])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12, atol=1e-12)


def test_the_second_gyro_is_in_the_same_hands() -> None:
    clock, world = bench(quiet())
    second = world.second_gyro()
    clock.sleep(1.0)
    world.power(False)
    clock.sleep(1.0)
    assert second.sample(clock.now(), 0.01, 1)[1][0] == 0.0


def test_the_second_gyro_is_as_old_at_its_stamps_as_the_first() -> None:
    clock, world = bench(quiet(), [TimingOffset(offset_s=0.2)])
    second = world.second_gyro()
    world.table.demand_rate(40.0)
    first_s = clock.now()
    for inputs in (world.inputs, second):
        inputs.hold_history(first_s)
    clock.sleep(1.0)
    first, other = (inputs.sample(first_s, 0.01, 100)[1] for inputs in (world.inputs, second))
    assert np.ptp(first) > 1.0
    np.testing.assert_allclose(other, first, rtol=0.0, atol=1e-9)
    assert np.ptp(first[:20]) < 1e-3 < np.ptp(first[20:40])


def test_faults_of_the_machines_are_not_in_the_way() -> None:
    clock = VirtualClock()
    drift = ClockDrift(kind="clock_drift", on="digitizer", ppm=50.0)
    made = SimulatedBench(
        quiet(), clock, rate_table="acutrol3000", chamber="watlow_f4t", digitizer="labjack_t7", faults=(drift,)
    )
    clock.sleep(1.0)
    made.world.power(False)
    clock.sleep(1.0)
    assert made.world.inputs.sample(clock.now(), 0.01, 1)[1][0] == 0.0
