"""Effects of every kind at the terminals of the simulated bench, held against closed forms."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Effect
from benchctl_instruments.physics.effects.clock_drift import ClockDrift
from benchctl_instruments.physics.effects.encoder_interpolation import EncoderInterpolation
from benchctl_instruments.physics.effects.making import make_effects
from benchctl_instruments.physics.effects.mount_resonance import MountResonance
from benchctl_instruments.physics.effects.sensor_bandwidth import SensorBandwidth
from benchctl_instruments.physics.effects.thermal_lag import ThermalLag
from benchctl_instruments.physics.effects.timing_offset import TimingOffset
from benchctl_instruments.physics.response_gyro import ResponseParameters
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World
from tests.instruments.simulated.quiet import quiet

FINE_ENCODER = {"counts_per_rev": 3_600_000_000, "eccentricity_arcsec": 0.0, "ellipticity_arcsec": 0.0}


def line(**changed: Any) -> WorldSettings:
    """A quiet bench whose gyro is a straight line of 0.02 V per deg/s that changes by 0.1 % a degree."""
    response = ResponseParameters(
        **{
            "K0_v_per_dps": 0.02,
            "U0_v": 0.1,
            "T0_c": 20.0,
            "k_T": (1e-3,),
            "k_omega": (),
            "noise_v_rms": 0.0,
            "output_limit_v": 9.0,
            **changed,
        }
    )
    return replace(quiet(encoder=FINE_ENCODER, latitude_deg=58.5), response=response)


def swinging(settings: WorldSettings, *effects: Effect, hz: float = 1.0) -> tuple[VirtualClock, World]:
    """A bench whose table swings with 100 deg/s, long since."""
    clock = VirtualClock()
    world = World(clock, settings, effects)
    world.table.close_loop()
    amplitude = 100.0 / (2.0 * math.pi * hz)
    world.table.demand_sine(amplitude, hz, 0.0, amplitude)
    clock.sleep(60.0)
    return clock, world


def phasors(world: World, first_s: float, hz: float = 1.0) -> tuple[complex, complex]:
    """The gyro's volts and the encoder's angle [deg] over eight periods, as phasors of the swing by their stamps."""
    interval, scans = 1.0 / (100.0 * hz), 800
    counts, volts, _ = world.inputs.sample(first_s, interval, scans)
    turn = np.exp(-2j * math.pi * hz * (first_s + interval * np.arange(scans)))
    angle = counts / 1e7
    return 2.0 * np.mean((volts - volts.mean()) * turn), 2.0 * np.mean((angle - angle.mean()) * turn)


def delay_s(world: World, first_s: float) -> float:
    """How much later than the encoder's the gyro's samples are of, by the swing of 1 Hz."""
    volts, angle = phasors(world, first_s)
    return float(np.angle(volts / (2j * math.pi * angle)) / (2.0 * math.pi))


def test_the_response_gyro_obeys_its_polynomials_at_the_thermistors_temperature() -> None:
    clock, world = swinging(line(k_omega=(1e-6,)))
    world.table.demand_rate(80.0)
    world.chamber.set_setpoint(80.0)
    world.chamber.run(True)
    clock.sleep(1500.0)
    _, volts, thermistor = world.inputs.sample(clock.now(), 0.002, 1)
    celsius = thermistor[0] / 0.05
    assert celsius > 30.0
    # neither the Earth nor a lag of the coil: all that is in the calibration
    assert volts[0] == pytest.approx(
        0.1 + 0.02 * (1.0 + 1e-3 * (celsius - 20.0)) * (1.0 + 1e-6 * 6400.0) * 80.0, rel=1e-9
    )


def test_the_response_gyro_is_as_noisy_as_it_says_at_every_rate_and_stops_at_its_limit() -> None:
    clock, world = swinging(line(noise_v_rms=3e-4))
    world.table.demand_rate(0.0)
    clock.sleep(100.0)
    for interval in (0.01, 0.002):
        volts = world.inputs.sample(clock.now() - 50.0, interval, 4000)[1]
        assert volts.std() == pytest.approx(3e-4, rel=0.06)
        assert volts.mean() == pytest.approx(0.1, abs=3e-5)
    _, low = swinging(line(output_limit_v=1.5))
    assert np.abs(low.inputs.sample(50.0, 0.01, 200)[1]).max() == 1.5


@pytest.mark.parametrize("offset_s", [0.05, 0.004, -0.004, -0.05])
def test_an_offset_is_what_encoder_and_gyro_are_apart(offset_s: float) -> None:
    _, world = swinging(line(), TimingOffset(offset_s=offset_s))
    # a straight line between instants of the grid is too small by (2π·1 Hz·0.5 ms)²/12, and not late
    assert delay_s(world, 40.0) == pytest.approx(-offset_s, abs=1e-7)


@pytest.mark.parametrize("ppm", [200.0, -200.0, 20.0])
def test_a_drift_goes_on_through_gaps_of_hours(ppm: float) -> None:
    clock, world = swinging(line(), ClockDrift(ppm=ppm))
    for hours in (0.0, 1.0, 4.0):
        clock.sleep(hours * 3600.0)
        first = math.floor(clock.now()) - 9.0
        found = (delay_s(world, first) + 0.5) % 1.0 - 0.5
        # whole periods cannot be told apart; the mean over eight of them is that of their middle, nearly
        expected = ((first + 4.0) * ppm * 1e-6 + 0.5) % 1.0 - 0.5
        assert found == pytest.approx(expected, abs=3e-5)


def test_a_drift_leaves_the_encoders_rate_and_with_it_the_scale_alone() -> None:
    clock, world = swinging(line(), ClockDrift(ppm=200.0))
    world.table.demand_rate(50.0)
    clock.sleep(3600.0)
    counts, volts, _ = world.inputs.sample(clock.now() - 30.0, 0.01, 3000)
    rate = (counts[-1] - counts[0]) / 1e7 / 29.99
    assert (volts.mean() - 0.1) / rate == pytest.approx(0.02, rel=1e-6)


def test_a_drift_is_that_of_the_stream_however_it_is_read() -> None:
    volts = []
    for cuts in ((0, 3000), (0, 1, 700, 701, 3000)):
        _, world = swinging(line(), ClockDrift(ppm=150.0), TimingOffset(offset_s=-0.01))
        parts = [world.inputs.sample(20.0 + 0.01 * a, 0.01, b - a)[1] for a, b in itertools.pairwise(cuts)]
        volts.append(np.concatenate(parts))
    np.testing.assert_allclose(volts[0], volts[1], rtol=1e-9, atol=1e-9)


def test_lines_of_the_encoder_are_in_its_counts_and_not_in_the_gyro() -> None:
    made = EncoderInterpolation(amplitude_arcsec=20.0, lines_per_rev=360.0)
    worlds = [swinging(line(), *effects)[1] for effects in ((), (made,))]
    plain, wrong = (world.inputs.sample(40.0, 0.01, 1000) for world in worlds)
    np.testing.assert_array_equal(plain[1], wrong[1])
    np.testing.assert_allclose((wrong[0] - plain[0]) / 1e7, made.error_deg(plain[0] / 1e7), atol=1e-6)


@pytest.mark.parametrize(
    "made", [SensorBandwidth(cutoff_hz=3.0), MountResonance(frequency_hz=4.0, damping=0.1)], ids=lambda e: e.identifier
)
def test_a_filter_has_forgotten_its_start_in_every_stream(made: SensorBandwidth | MountResonance) -> None:
    clock, world = swinging(line(), made)
    for wait_s in (0.0, 2.0, 3000.0):
        clock.sleep(wait_s)
        volts, angle = phasors(world, math.floor(clock.now()) - 9.0)
        gain = volts / (0.02 * 2j * math.pi * angle)
        assert gain == pytest.approx(complex(made.response(np.array([1.0]))[0]), rel=1e-5)


def test_a_lagging_coil_lags_through_soaks_in_which_it_is_only_looked_at() -> None:
    def volts(effects: tuple[Effect, ...], poll_s: float) -> float:
        clock = VirtualClock()
        world = World(clock, line(), effects)
        world.table.close_loop()
        world.table.demand_rate(100.0)
        world.chamber.set_setpoint(60.0)
        world.chamber.run(True)
        while clock.now() < 1200.0:
            clock.sleep(poll_s)
            found = world.inputs.sample(clock.now(), 1e-3, 1)[1][0]
        return float(found)

    closely, seldom, prompt = (
        volts((ThermalLag(tau_s=300.0),), 1.0),
        volts((ThermalLag(tau_s=300.0),), 6.0),
        volts((), 6.0),
    )
    assert prompt - closely > 2e-3  # more than a degree
    assert seldom == pytest.approx(closely, abs=2e-6)


ALL = make_effects(
    {
        "timing_offset": {"offset_s": -0.003},
        "clock_drift": {"ppm": 60.0},
        "thermal_lag": {"tau_s": 200.0},
        "bias_temperature_rate": {"v_per_c_per_s": 0.3},
        "sensor_bandwidth": {"cutoff_hz": 30.0},
        "mount_resonance": {"frequency_hz": 20.0, "damping": 0.2},
        "encoder_eccentricity": {"amplitude_arcsec": 60.0, "phase_deg": 10.0},
        "mains_pickup": {"amplitude_v": 0.01, "frequency_hz": 50.0, "phase_deg": 20.0},
        "bias_random_walk": {"v_per_sqrt_s": 1e-3},
        "flicker_noise": {"v_rms_per_decade": 1e-3},
        "noise_rate_dependent": {"factor_at_full_rate": 3.0},
        "outliers": {"fraction": 0.01, "scale_v": 1.0},
        "dropouts": {"count": 3.0, "hold_s": 0.1, "span_scans": 1000.0},
        "adc_nonlinearity": {"inl_v": 0.01, "period_v": 1.0},
        "adc_coarse": {"bits_lost": 4, "adc_step_v": 1e-5},
    }
)


def streamed(cuts: list[int]) -> list[FloatArray]:
    """Two streams of a bench with effects of every kind, an hour of warming apart, each read in pieces."""
    clock, world = swinging(WorldSettings(), *ALL, hz=0.7)
    world.chamber.set_setpoint(50.0)
    world.chamber.run(True)
    read: list[FloatArray] = []
    for _ in range(2):
        clock.sleep(1800.0)
        first = clock.now() - 10.0
        bounds = [0, *sorted(cuts), 1000]
        parts = [world.inputs.sample(first + 0.008 * a, 0.008, b - a) for a, b in itertools.pairwise(bounds)]
        read += [np.concatenate(columns).astype(np.float64) for columns in zip(*parts, strict=True)]
    return read


WHOLE = streamed([])


@given(cuts=st.lists(st.integers(1, 999), max_size=5, unique=True))
@settings(max_examples=12, deadline=None)
def test_effects_of_every_kind_do_not_depend_on_how_scans_are_read(cuts: list[int]) -> None:
    for whole, read in zip(WHOLE, streamed(cuts), strict=True):
        # a sample that sits on the edge of a step of the coarse converter may fall to either side
        differs = np.abs(read - whole) > 1e-9 * (1.0 + np.abs(whole))
        assert differs.sum() <= 2
