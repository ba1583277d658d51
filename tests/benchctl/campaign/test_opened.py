import numpy as np
import pytest

from benchctl.bench import load_bench
from benchctl.campaign.opened import effects_of, open_bench, world_settings
from benchctl_instruments.physics.effects.adc_coarse import AdcCoarse
from benchctl_instruments.physics.effects.bias_temperature import BiasTemperature
from benchctl_instruments.physics.effects.noise_rate_dependent import NoiseRateDependent


def test_a_seed_draws_the_mounting_of_the_encoder_and_the_bench_says_its_counts() -> None:
    bench = load_bench("simulated")
    first, again, other = (world_settings(bench.with_seed(seed)).encoder for seed in (1, 1, 2))
    assert first == again
    assert first.eccentricity_phase_deg != other.eccentricity_phase_deg
    assert first.ellipticity_phase_deg != other.ellipticity_phase_deg
    assert other.counts_per_rev == bench.digitizer.encoder_counts_per_rev


def test_a_mounting_of_the_encoder_that_bench_toml_states_is_not_drawn() -> None:
    bench = load_bench("simulated")
    stated = bench.model_copy(update={"physics": {"seed": 3, "encoder": {"eccentricity_phase_deg": 77.0}}})
    encoder = world_settings(stated).encoder
    assert encoder.eccentricity_phase_deg == 77.0
    assert encoder.ellipticity_phase_deg == world_settings(bench.with_seed(3)).encoder.ellipticity_phase_deg


def test_what_the_thermistor_gives_is_what_the_digitizer_makes_of_it() -> None:
    bench = load_bench("simulated")
    settings = world_settings(bench)
    volts = settings.thermistor_v_per_c * 37.0 + settings.thermistor_offset_v
    assert bench.digitizer.gyro_celsius(volts) == 37.0


def test_effects_meet_the_circumstances_of_their_bench() -> None:
    bench = load_bench("simulated").with_seed(9)
    tables = {
        "bias_temperature": {"c1_v_per_c": 1e-3, "c2_v_per_c2": 0.0},
        "noise_rate_dependent": {"factor_at_full_rate": 2.0},
        "adc_coarse": {"bits_lost": 1},
    }
    bias, noise, coarse = effects_of(bench.model_copy(update={"effects": tables}), world_settings(bench))
    assert isinstance(bias, BiasTemperature)
    assert isinstance(noise, NoiseRateDependent)
    assert isinstance(coarse, AdcCoarse)
    assert bias.T0_c == 20.0
    assert (noise.range_dps, noise.seed) == (175.0, 9)
    # a gyro of 0.03 deg/√h and 0.05 V per deg/s at 500 Hz
    assert noise.noise_v_rms == pytest.approx(0.05 * 0.03 / 60.0 * 500.0**0.5)
    assert coarse.adc_step_v == 20.0 / 65536


@pytest.mark.parametrize("wires", [True, False])
def test_a_bench_plays_its_effects_on_its_wires_and_without_them(wires: bool) -> None:
    line = {"mains_pickup": {"amplitude_v": 0.5, "frequency_hz": 50.0}}
    bench = load_bench("simulated").model_copy(update={"effects": line})
    with open_bench(bench, wires=wires) as opened:
        start = opened.digitizer.start_stream(500.0)
        opened.clock.sleep(2.0)
        volts = opened.digitizer.read_stream(500, 5.0).gyro_v[:500]
        opened.digitizer.stop_stream()
    at_50_hz = 2.0 * np.mean(volts * np.exp(-2j * np.pi * 50.0 * np.arange(500) / start.rate_hz))
    assert abs(at_50_hz) == pytest.approx(0.5, rel=1e-3)
