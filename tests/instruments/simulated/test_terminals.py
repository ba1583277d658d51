from __future__ import annotations

import itertools
import math
import time
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.gyro import earth_rate_dps
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World
from tests.instruments.simulated.quiet import QUIET, quiet

FloatArray = npt.NDArray[np.float64]


def turning(settings: WorldSettings, rate_dps: float, wait_s: float = 5.0) -> tuple[VirtualClock, World]:
    """A bench whose table has been turning for a while."""
    clock = VirtualClock()
    world = World(clock, settings)
    world.table.close_loop()
    world.table.demand_rate(rate_dps)
    clock.sleep(wait_s)
    return clock, world


def oscillating(settings: WorldSettings, rate_dps: float, frequency_hz: float) -> tuple[VirtualClock, World]:
    clock = VirtualClock()
    world = World(clock, settings)
    world.table.close_loop()
    amplitude = rate_dps / (2.0 * math.pi * frequency_hz)
    world.table.demand_sine(amplitude, frequency_hz, 0.0, amplitude * frequency_hz)
    return clock, world


@pytest.mark.parametrize("rate", [-150.0, -10.0, 0.0, 60.0, 150.0])
def test_a_constant_rate_gives_the_volts_of_the_sine_law_and_counts_of_the_angle(rate: float) -> None:
    clock, world = turning(quiet(), rate)
    counts, volts, thermistor = world.inputs.sample(clock.now() - 1.0, 0.002, 501)
    np.testing.assert_allclose(volts, 0.012 + 0.05 / 0.0045 * math.sin(0.0045 * rate), atol=1e-9)
    assert abs((counts[-1] - counts[0]) / 1000.0 - rate) <= 0.0011
    assert counts[-1] == math.floor(world.table.motion().angle_deg * 1000.0)
    np.testing.assert_allclose(thermistor, 0.05 * 20.0)


def test_the_gyro_at_rest_feels_the_earth() -> None:
    clock, world = turning(quiet(latitude_deg=58.5), 0.0)
    _, volts, _ = world.inputs.sample(clock.now(), 0.002, 1)
    assert volts[0] - 0.012 == pytest.approx(0.05 * earth_rate_dps(58.5), rel=1e-6)


def test_volts_lag_behind_the_true_rate_by_the_delay_of_the_low_pass() -> None:
    # at low frequency √2/(2π·200 Hz); a small amplitude keeps the sine law straight
    frequency = 1.0
    clock, world = oscillating(quiet(), 5.0, frequency)
    clock.sleep(10.0)
    first, interval, scans = 5.0, 0.002, 2000
    _, volts, _ = world.inputs.sample(first, interval, scans)
    times = first + np.arange(scans) * interval
    rates = world.table.at(times).rate_dps  # type: ignore[attr-defined]
    turn = np.exp(-2j * math.pi * frequency * times)
    lag = np.angle(np.sum(rates * turn) / np.sum(volts * turn))
    assert lag / (2.0 * math.pi * frequency) == pytest.approx(math.sqrt(2.0) / (2.0 * math.pi * 200.0), rel=0.01)


def test_sixteen_times_the_internal_rate_gives_the_same_scans() -> None:
    def scanned(grid_hz: float) -> tuple[npt.NDArray[np.int64], FloatArray]:
        clock, world = oscillating(quiet(grid_hz=grid_hz), 150.0, 1.0)
        world.inputs.hold_history(0.0)
        clock.sleep(4.0)
        world.table.demand_rate(-120.0)
        clock.sleep(2.0)
        counts, volts, _ = world.inputs.sample(0.0, 1.0 / 700.0, 4200)
        return counts, volts

    coarse, fine = scanned(2000.0), scanned(32_000.0)
    assert np.abs(coarse[0] - fine[0]).max() <= 1
    # straight pieces miss a curve by up to h²/8, and what the triangle hold makes of it by h²/12, of its second
    # derivative; the greatest is that of a servo which meets a step of acceleration,
    # 0.05 V per deg/s · 2000 deg/s² · 2ζωₙ
    curvature = 0.05 * 2000.0 * 2.0 * 0.7 * 2.0 * math.pi * 15.0
    difference = np.abs(coarse[1] - fine[1])
    assert difference.max() <= (1 / 8 + 1 / 12) * 0.0005**2 * curvature
    # in the steady sine, less than a tenth of a step of 16 bits over ±10 V
    assert difference[2100:2799].max() < 3e-5


@given(
    cuts=st.lists(st.integers(1, 1199), max_size=6, unique=True), rate_hz=st.sampled_from([37.0, 500.0, 2000.0, 9000.0])
)
@settings(max_examples=25, deadline=None)
def test_scans_do_not_depend_on_how_they_are_read(cuts: list[int], rate_hz: float) -> None:
    interval = 1.0 / rate_hz
    clock, world = oscillating(WorldSettings(), 100.0, 0.7)
    _, other = oscillating(WorldSettings(), 100.0, 0.7)
    clock.sleep(50.0)
    other.clock.sleep(50.0)
    whole = world.inputs.sample(1.0, interval, 1200)
    bounds = [0, *sorted(cuts), 1200]
    parts = [
        other.inputs.sample(1.0 + low * interval, interval, high - low) for low, high in itertools.pairwise(bounds)
    ]
    counts, volts, thermistor = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    assert np.abs(counts - whole[0]).max() <= 1
    np.testing.assert_allclose(volts, whole[1], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(thermistor, whole[2], rtol=1e-12, atol=1e-12)


def test_a_stream_read_while_the_table_is_commanded_is_the_stream_read_afterwards() -> None:
    live, late = oscillating(quiet(), 80.0, 0.5), oscillating(quiet(), 80.0, 0.5)
    late[1].inputs.hold_history(0.0)
    blocks: list[FloatArray] = []
    for k in range(30):
        for clock, world in (live, late):
            clock.sleep(0.31)
            if k % 4 == 3:
                world.table.demand_rate(40.0 * math.sin(k))
            world.chamber.set_setpoint(85.0 if k % 3 else -40.0)
            world.chamber.run(True)
        read = sum(block.shape[1] for block in blocks)
        due = math.floor(live[0].now() * 500.0 + 1e-6) + 1 - read
        blocks.append(np.stack(live[1].inputs.sample(read * 0.002, 0.002, due)[1:]))
    volts = np.concatenate(blocks, axis=1)
    afterwards = np.stack(late[1].inputs.sample(0.0, 0.002, volts.shape[1])[1:])
    np.testing.assert_allclose(volts, afterwards, rtol=1e-12, atol=1e-12)


def test_the_noise_of_a_scan_is_that_of_its_interval() -> None:
    for rate_hz in (100.0, 500.0):
        clock, world = turning(WorldSettings(), 0.0, 300.0)
        _, volts, thermistor = world.inputs.sample(100.0, 1.0 / rate_hz, 20_000)
        expected = 0.05 * 0.03 / 60.0 * math.sqrt(rate_hz)
        # differences of neighbours: free of the walk; variance 2σ², of relative deviation √(3/n)
        assert np.var(np.diff(volts)) == pytest.approx(2.0 * expected**2, rel=5.0 * math.sqrt(3.0 / 20_000))
        assert np.std(thermistor) == pytest.approx(0.05 * 0.003, rel=0.03)
        assert clock.now() >= 300.0


def test_the_bias_walks_on_between_streams() -> None:
    strength = 1e-3
    settings = quiet(gyro={"arw_deg_per_sqrt_h": 0.0, "bias_walk_v_per_sqrt_s": strength})
    steps = []
    for seed in range(150):
        clock, world = turning(replace(settings, seed=seed), 0.0)
        ends = []
        for _ in range(2):
            ends.append(world.inputs.sample(clock.now(), 0.002, 1)[1][0])
            clock.sleep(3600.0)
        steps.append(ends[1] - ends[0])
    assert np.var(steps) == pytest.approx(strength**2 * 3600.0, rel=5.0 * math.sqrt(2.0 / 150))


def test_the_same_seed_gives_the_same_volts_and_another_seed_others() -> None:
    def volts(seed: int) -> FloatArray:
        clock, world = turning(replace(WorldSettings(), seed=seed), 30.0)
        return world.inputs.sample(clock.now() - 1.0, 0.01, 100)[1]

    np.testing.assert_array_equal(volts(3), volts(3))
    assert np.abs(volts(3) - volts(4)).max() > 1e-4


def test_the_output_stops_at_its_limit() -> None:
    clock, world = turning(quiet(gyro={"U0_v": 5.0, "arw_deg_per_sqrt_h": 1.0}), 300.0)
    assert world.inputs.sample(clock.now(), 0.002, 1)[1][0] == 11.0


def test_in_a_warming_chamber_the_thermistor_reads_the_housing_and_the_gyro_obeys_its_coil() -> None:
    clock, world = turning(quiet(), 100.0)
    world.chamber.set_setpoint(80.0)
    world.chamber.run(True)
    clock.sleep(1795.0)
    _, volts, thermistor = world.inputs.sample(clock.now(), 0.002, 1)
    slope, elapsed = 2.0 / 60.0, 1795.0

    def behind(*lags: float) -> float:
        # a ramp through lags in a row: slope·(t − Σ lags) plus decays, by partial fractions
        decays = sum(
            slope * lag * math.prod(lag / (lag - other) for other in lags if other != lag) * math.exp(-elapsed / lag)
            for lag in lags
        )
        return 20.0 + slope * (elapsed - sum(lags)) + decays

    housing, coil = behind(60.0, 600.0), behind(60.0, 600.0, 300.0)
    assert housing - coil > 5.0
    assert thermistor[0] / 0.05 == pytest.approx(housing, abs=1e-6)
    warm = coil - 20.0
    gain = 1.0 - 1.315e-4 * warm + 2.066e-6 * warm**2
    expected = 0.012 + 2e-5 * warm - 1.5e-7 * warm**2 + 0.05 / 0.0045 * gain * math.sin(0.45)
    assert volts[0] == pytest.approx(expected, abs=1e-6)


@dataclass(frozen=True)
class Offset:
    """A toy effect: a constant on the output at a stage."""

    stage: Stage
    volts: float

    def apply(self, signals: Signals) -> Signals:
        return replace(signals, output_v=signals.output_v + self.volts)


@dataclass
class Witness:
    """An effect that changes nothing and notes which instants of the grid it has seen."""

    stage: Stage = "electronics"
    seen: list[int] = field(default_factory=list)

    def apply(self, signals: Signals) -> Signals:
        self.seen.extend(range(signals.first_index, signals.first_index + signals.time_s.size))
        return signals


def test_effects_see_every_instant_of_the_grid_once_however_a_stream_is_read() -> None:
    clock = VirtualClock()
    witness = Witness()
    world = World(clock, quiet(), [witness])
    clock.sleep(100.0)
    for low, high in itertools.pairwise([0, 1, 7, 300, 301, 9000]):
        world.inputs.sample(10.0 + low / 700.0, 1.0 / 700.0, high - low)
    assert witness.seen == list(range(witness.seen[0], witness.seen[0] + len(witness.seen)))


def test_between_instants_of_the_grid_the_angle_is_curved() -> None:
    fine = {"counts_per_rev": 360_000_000_000, "eccentricity_arcsec": 0.0, "ellipticity_arcsec": 0.0}
    clock, world = oscillating(quiet(encoder=fine), 150.0, 1.0)
    clock.sleep(10.0)
    times = 5.0 + np.arange(2000) / 700.0
    counts, _, _ = world.inputs.sample(5.0, 1.0 / 700.0, 2000)
    angles = world.table.at(times).angle_deg  # type: ignore[attr-defined]
    # a chord would be off by an eighth of h²·942 deg/s², 3e-5°
    np.testing.assert_allclose(counts / 1e9, angles, atol=5e-9)


@pytest.mark.parametrize("stage", ["bias", "electronics", "sampling"])
def test_an_effect_reaches_the_terminals(stage: Stage) -> None:
    clock = VirtualClock()
    world = World(clock, quiet(), [Offset(stage, 0.5)])
    clock.sleep(1.0)
    assert world.inputs.sample(0.5, 0.002, 100)[1] == pytest.approx(0.512)


def test_a_single_scan_after_hours_of_sleep_costs_milliseconds() -> None:
    clock, world = turning(WorldSettings(), 37.0)
    before = time.process_time()
    for _ in range(20):
        clock.sleep(5 * 3600.0)
        world.inputs.sample(clock.now(), 0.002, 1)
    assert time.process_time() - before < 0.5


@pytest.mark.parametrize(
    ("first", "interval", "scans", "message"),
    [
        (4.0, 0.002, 600, "cannot sample at 5.198000 s: it is 5.000000 s"),
        (1.0, 0.002, 0, "cannot sample 0 scans"),
        (1.0, 0.0, 1, "every 0.0 s"),
    ],
)
def test_what_cannot_be_sampled_is_refused(first: float, interval: float, scans: int, message: str) -> None:
    _, world = turning(WorldSettings(), 0.0)
    with pytest.raises(UsageError, match=message):
        world.inputs.sample(first, interval, scans)


def test_a_reading_that_comes_late_finds_the_bias_as_it_is() -> None:
    _, world = turning(quiet(gyro={"arw_deg_per_sqrt_h": 0.0, "bias_walk_v_per_sqrt_s": 1.0}), 0.0)
    first = world.inputs.sample(3.0, 0.002, 10)[1]
    late = world.inputs.sample(2.9, 0.002, 3)[1]
    np.testing.assert_allclose(late, first[-1], rtol=1e-12)
    assert np.abs(np.diff(first)).min() > 0.0


def test_whoever_waits_for_an_instant_is_woken_by_the_clock() -> None:
    clock, world = turning(WorldSettings(), 0.0)
    assert world.inputs.now() == clock.now()
    assert world.inputs.wait_until(clock.now(), 0.0) is True
    assert world.inputs.wait_until(clock.now() + 1.0, 0.01) is False


def test_the_slowest_electronics_that_are_allowed_find_enough_history() -> None:
    clock = VirtualClock()
    world = World(clock, quiet(gyro=QUIET["gyro"] | {"cutoff_hz": 0.2}))
    world.table.close_loop()
    for _ in range(3):
        world.inputs.sample(clock.now(), 0.001, 1)
        clock.sleep(1000.0)
        world.table.demand_rate(10.0)
        clock.sleep(100.0)
        world.table.demand_rate(0.0)
    _, gyro_v, _ = world.inputs.sample(clock.now(), 0.001, 1)
    assert gyro_v[0] == pytest.approx(0.012 + 10.0 * 0.05, rel=1e-3)  # it has turned until this very instant
