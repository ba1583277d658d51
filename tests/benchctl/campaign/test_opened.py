from benchctl.bench import load_bench
from benchctl.campaign.opened import world_settings


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
