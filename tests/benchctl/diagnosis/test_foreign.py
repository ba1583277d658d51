"""The other lab's bench makes recordings like the shared ones, and each effect does what the vocabulary says."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.recordings.reader import open_recording
from tests.benchctl.diagnosis.foreign import KINDS, Truth, draw, make, to_recording, write
from tests.benchctl.diagnosis.foreign import electronics as parts
from tests.benchctl.diagnosis.foreign.benches import BENCHES
from tests.benchctl.diagnosis.foreign.climate import backlash, weather
from tests.benchctl.diagnosis.foreign.draw import EFFECTS
from tests.benchctl.diagnosis.foreign.encoder import angle_error
from tests.benchctl.diagnosis.foreign.faint import gained
from tests.benchctl.diagnosis.foreign.felt import Felt
from tests.benchctl.diagnosis.foreign.linear import FloatArray, base_excited, low_pass
from tests.benchctl.diagnosis.foreign.motion import PAD_S, POINTS_PER_SAMPLE, Cogging, move
from tests.benchctl.diagnosis.foreign.plans import plan
from tests.benchctl.diagnosis.foreign.response import answer
from tests.benchctl.diagnosis.foreign.truth import Effects
from tests.benchctl.diagnosis.foreign.unit import nominal
from tests.shared import SHARED, needs_shared

NOTHING = Truth(kind="null", bench=0, plan=0)
SHORT = plan(145.0, (25.0,))


@needs_shared("recordings/examples")
@pytest.mark.parametrize(("example", "bench", "where"), [("null", 0, 0), ("pair", 0, 1), ("single", 1, 2)])
def test_the_descriptions_are_those_of_the_shared_recordings(example: str, bench: int, where: int) -> None:
    theirs = json.loads((SHARED / "recordings/examples" / example / "recording.json").read_text())
    ours = BENCHES[bench].described(theirs["unit"]["serial"], frozenset())
    truth = Truth(kind="null", bench=bench, plan=where)
    assert {**ours, "steps": plan(ours["unit"]["range_dps"], truth.set_points)} == theirs


@pytest.fixture(scope="module")
def empty() -> tuple[dict[str, Any], FloatArray]:
    """A recording that conceals nothing."""
    return make(NOTHING, 4)


def test_where_nothing_is_concealed_the_simulation_with_refitted_coefficients_leaves_white_noise(
    empty: tuple[dict[str, Any], FloatArray],
) -> None:
    description, table = empty
    simulation = description["simulation"]
    angle = np.unwrap(table[:, 1], period=360.0)
    rate = np.convolve(angle, np.array([-1.0, 8.0, 0.0, -8.0, 1.0]) / 12.0 * 125.0, mode="same")
    warmer = table[:, 3] - simulation["T0_c"]
    (a1, a2), (b2, b4) = simulation["k_T"], simulation["k_omega"]
    k0 = simulation["K0_v_per_dps"]
    expected = k0 * (1 + a1 * warmer + a2 * warmer**2) * (1 + b2 * rate**2 + b4 * rate**4) * rate
    basis = np.column_stack([np.ones_like(rate), expected, np.gradient(rate)])[10:-10]
    kept, *_ = np.linalg.lstsq(basis, table[10:-10, 2], rcond=None)
    left = table[10:-10, 2] - basis @ kept
    assert abs(kept[0] - simulation["U0_v"]) < 2e-3
    assert abs(kept[1] - 1.0) < 4e-3
    assert abs(kept[2] / k0) / 125.0 < 1e-5  # s of delay
    seconds = left[: left.size // 125 * 125].reshape(-1, 125).mean(axis=1)
    assert np.std(seconds) == pytest.approx(np.std(table[: 40 * 125, 2]) / np.sqrt(125.0), rel=0.1)
    assert abs(np.corrcoef(seconds[1:], seconds[:-1])[0, 1]) < 0.08


def test_angle_rate_and_acceleration_of_the_motion_agree() -> None:
    cogging = Cogging(order=36, size=4e-4, phase_rad=1.0)
    moved = move(SHORT, 125.0, start_deg=77.0, cogging=cogging, rng=np.random.default_rng(1))
    slope = np.gradient(moved.angle_deg, moved.dt_s)
    assert np.max(np.abs(slope - moved.rate_dps)[2:-2]) < 0.01
    assert np.sqrt(np.mean((np.gradient(moved.rate_dps, moved.dt_s) - moved.accel_dps2) ** 2)) < 0.3
    assert moved.rate_dps.max() == pytest.approx(145.0, abs=0.2)


def test_a_recording_is_known_by_its_truth_and_seed(empty: tuple[dict[str, Any], FloatArray]) -> None:
    again = make(NOTHING, 4)
    assert again[0] == empty[0]
    np.testing.assert_array_equal(again[1], empty[1])
    assert make(NOTHING, 5)[0]["unit"] != empty[0]["unit"]
    lagging = make(replace(NOTHING, effects={"thermal_lag": {"tau_s": 500.0}}), 4)[1]
    np.testing.assert_array_equal(np.delete(lagging, 2, axis=1), np.delete(empty[1], 2, axis=1))
    assert np.std(lagging[:, 2] - empty[1][:, 2]) > 5e-4


def test_a_written_recording_is_read_as_the_one_in_memory(tmp_path: Path) -> None:
    truth = Truth(
        kind="single", bench=2, plan=0, effects={"supply_sensitivity": {"fraction_per_v": 0.01, "v_per_v": 0.0}}
    )
    description, table = make(truth, 1)
    short = {**description, "steps": description["steps"][:3]}
    table = table[: round(short["steps"][-1]["t_end"] * 100.0)]
    write(tmp_path / "made", short, table, truth)
    made = to_recording(short, table)
    with open_recording(tmp_path / "made") as read:
        assert read.infos == made.infos
        assert read.meta.simulation == made.meta.simulation
        assert read.meta.extra["csv_decimals"] == made.meta.extra["csv_decimals"]
        for theirs, ours in zip(read.steps(), made.steps(), strict=True):
            assert theirs.channels.keys() == ours.channels.keys()
            for name, values in ours.channels.items():
                np.testing.assert_allclose(theirs[name], values, rtol=0, atol=1e-12)
    assert json.loads((tmp_path / "made/truth.json").read_text()) == truth.as_json()


def test_singles_go_through_the_whole_vocabulary_and_every_kind_can_be_drawn() -> None:
    assert [next(iter(draw("single", seed).effects)) for seed in range(len(EFFECTS))] == list(EFFECTS)
    counts = {kind: len(draw(kind, 3).effects) for kind in KINDS if kind != "faint"}
    assert [counts[kind] for kind in ("null", "moved", "pair", "triple", "wander+one")] == [0, 0, 2, 3, 2]
    assert draw("outsider", 3).outsiders
    assert draw("null", 3).coefficients_moved is False


@needs_shared("spec/effects.md")
def test_the_vocabulary_is_that_of_the_specification() -> None:
    lines = (SHARED / "spec/effects.md").read_text().splitlines()
    assert {line.split("`")[1] for line in lines if line.startswith("| `")} == set(EFFECTS)


@pytest.mark.slow
def test_a_faint_effect_is_worth_what_was_asked() -> None:
    truth = draw("faint", 3)
    assert gained(truth) == pytest.approx(200.0, rel=0.02)


W = np.array([-145.0, -20.0, -0.1, 0.1, 60.0, 145.0])
FELT = Felt(
    time_s=np.linspace(0.0, 3600.0, 6),
    rate_dps=W,
    accel_dps2=np.linspace(-50.0, 60.0, 6),
    angle_deg=np.linspace(10.0, 700.0, 6),
    warmer_c=np.linspace(-40.0, 30.0, 6),
    warms_c_per_s=np.linspace(-0.1, 0.1, 6),
    slack_c=np.linspace(-2.0, 2.0, 6),
    supply_v=np.linspace(-0.1, 0.2, 6),
)
SCALES: list[tuple[Effects, Callable[[], Any]]] = [
    ({"rate_nonlinearity": {"c2": 1e-6, "c4": 1e-11}}, lambda: 1 + 1e-6 * W**2 + 1e-11 * W**4),
    ({"scale_temperature": {"a1": 1e-4, "a2": 1e-6}}, lambda: 1 + 1e-4 * FELT.warmer_c + 1e-6 * FELT.warmer_c**2),
    ({"scale_asymmetry": {"fraction": 0.002}}, lambda: np.where(W > 0, 1.001, 0.999)),
    ({"scale_rate_temperature_coupling": {"coefficient": 1e-9}}, lambda: 1 + 1e-9 * FELT.warmer_c * W**2),
    ({"scale_warm_up": {"fraction": 0.01, "tau_s": 600.0}}, lambda: 1 + 0.01 * np.exp(-FELT.time_s / 600.0)),
    ({"scale_ageing": {"per_hour": 0.01}}, lambda: 1 + 0.01 * np.linspace(0.0, 1.0, 6)),
    ({"thermal_hysteresis": {"width_c": 2.0, "fraction_per_c": 1e-3}}, lambda: 1 + 1e-3 * np.linspace(-2.0, 2.0, 6)),
    ({"dead_zone": {"half_width_dps": 0.2}}, lambda: np.where(np.abs(W) < 0.2, 0.0, 1.0 - 0.2 / np.abs(W))),
    ({"fringe_ambiguity": {"fold_dps": 100.0}}, lambda: np.where(np.abs(W) > 100.0, (200.0 - 145.0) / 145.0, 1.0)),
]
BIASES: list[tuple[Effects, Callable[[], Any]]] = [
    ({"rate_squared": {"v_per_dps2": 1e-7}}, lambda: 1e-7 * W**2),
    (
        {"bias_temperature": {"c1_v_per_c": 1e-4, "c2_v_per_c2": 1e-6}},
        lambda: 1e-4 * FELT.warmer_c + 1e-6 * FELT.warmer_c**2,
    ),
    ({"bias_temperature_rate": {"v_per_c_per_s": 0.03}}, lambda: 0.03 * FELT.warms_c_per_s),
    ({"warm_up": {"amplitude_v": 0.004, "tau_s": 600.0}}, lambda: 0.004 * np.exp(-FELT.time_s / 600.0)),
    ({"bias_drift": {"v_per_hour": 0.003}}, lambda: 0.003 * np.linspace(0.0, 1.0, 6)),
    ({"angular_acceleration": {"v_per_dps2": 2e-5}}, lambda: 2e-5 * FELT.accel_dps2),
    (
        {"heading_dependent_bias": {"amplitude_v": 0.001, "phase_deg": 40.0, "order": 2}},
        lambda: 0.001 * np.cos(2.0 * (FELT.angle_deg - 40.0) * np.pi / 180.0),
    ),
]


@pytest.mark.parametrize(("effect", "scale"), SCALES, ids=lambda x: next(iter(x)) if isinstance(x, dict) else "")
def test_an_effect_on_the_scale_is_the_vocabularys(effect: Effects, scale: Callable[[], Any]) -> None:
    unit = nominal(NOTHING)
    without = answer({}, unit, FELT) - unit.u0_v
    linear = replace(unit, k_omega=())
    if effect.keys() & {"dead_zone", "fringe_ambiguity"}:
        without, unit = answer({}, linear, FELT) - unit.u0_v, linear
    np.testing.assert_allclose(answer(effect, unit, FELT) - unit.u0_v, without * scale(), atol=1e-12)


@pytest.mark.parametrize(("effect", "bias"), BIASES, ids=lambda x: next(iter(x)) if isinstance(x, dict) else "")
def test_an_effect_on_the_bias_is_the_vocabularys(effect: Effects, bias: Callable[[], Any]) -> None:
    unit = nominal(NOTHING)
    np.testing.assert_allclose(answer(effect, unit, FELT) - answer({}, unit, FELT), bias(), atol=1e-12)


def test_filters_and_clocks_do_to_a_sine_what_their_formulas_say() -> None:
    fs, hz = 125.0, 9.0
    dt = 1.0 / (fs * POINTS_PER_SAMPLE)
    fine: FloatArray = np.arange(-round(PAD_S / dt), round((4.0 + PAD_S) / dt), dtype=np.float64) * dt
    stamps = np.arange(round(4.0 * fs)) / fs
    s = 2j * np.pi * hz

    def seen(values: FloatArray, time: FloatArray, settled: int) -> complex:
        turning = np.column_stack([np.sin(2 * np.pi * hz * time), np.cos(2 * np.pi * hz * time)])[settled:]
        (a, b), *_ = np.linalg.lstsq(turning, values[settled:], rcond=None)
        return complex(a, b)

    sine = np.sin(2 * np.pi * hz * fine)
    w = 2 * np.pi * 22.0
    assert seen(low_pass(sine, 22.0, 1, dt), fine, 2000) == pytest.approx(1 / (1 + s / w), abs=1e-3)
    assert seen(low_pass(sine, 22.0, 2, dt), fine, 2000) == pytest.approx(
        w**2 / (s**2 + np.sqrt(2) * w * s + w**2), abs=1e-3
    )
    assert seen(base_excited(sine, 22.0, 0.1, dt), fine, 2000) == pytest.approx(
        (0.2 * w * s + w**2) / (s**2 + 0.2 * w * s + w**2), abs=2e-3
    )
    late = parts.sampled({"timing_offset": {"offset_s": 0.003}}, sine, stamps, fs)
    np.testing.assert_allclose(late, np.sin(2 * np.pi * hz * (stamps - 0.003)), atol=1e-4)
    away = parts.sampled({"clock_drift": {"ppm": 500.0}}, sine, stamps, fs)
    np.testing.assert_allclose(away, np.sin(2 * np.pi * hz * stamps * 1.0005), atol=1e-4)


def test_noises_have_the_size_and_the_shape_that_is_said() -> None:
    bench, rng = BENCHES[0], np.random.default_rng(2)
    still = np.zeros(400_000)
    walk = parts.noise({"bias_random_walk": {"v_per_sqrt_s": 1e-4}}, 0.0, still, bench, rng)
    assert np.std(np.diff(walk[::125])) == pytest.approx(1e-4, rel=0.05)
    pink = parts.noise({"flicker_noise": {"v_rms_per_decade": 1e-4}}, 0.0, still, bench, rng)
    power = np.abs(np.fft.rfft(pink)) ** 2 * 2.0 / pink.size**2
    hz = np.fft.rfftfreq(pink.size, 1.0 / 125.0)
    for low in (0.05, 0.5, 5.0):
        assert np.sqrt(power[(hz >= low) & (hz < 10 * low)].sum()) == pytest.approx(1e-4, rel=0.15)
    full = parts.noise({"noise_rate_dependent": {"factor_at_full_rate": 3.0}}, 1e-3, still + 145.0, bench, rng)
    assert np.std(full) == pytest.approx(3e-3, rel=0.01)


def test_what_happens_to_data_is_what_is_said() -> None:
    rng, bench = np.random.default_rng(3), BENCHES[0]
    ramp = np.linspace(-3.0, 3.0, 50_000)
    assert np.abs(parts.bent({"saturation": {"limit_v": 2.5}}, ramp)).max() == 2.5
    bent = parts.bent({"adc_nonlinearity": {"inl_v": 0.002, "period_v": 0.5}}, ramp) - ramp
    np.testing.assert_allclose(bent, 0.002 * np.sin(4 * np.pi * ramp), atol=1e-12)
    steps = np.diff(np.unique(parts.converted({"adc_coarse": {"bits_lost": 4}}, ramp, bench)))
    np.testing.assert_allclose(steps, 16 * 10.0 / 2**18, rtol=1e-9)
    spikes = parts.spiked({"outliers": {"fraction": 0.01, "scale_v": 0.2}}, ramp, rng) - ramp
    assert np.count_nonzero(spikes) == 500
    assert np.std(spikes[spikes != 0]) == pytest.approx(0.2, rel=0.1)
    held = parts.held({"dropouts": {"count": 5, "hold_s": 0.8}}, ramp, 125.0, rng)
    assert np.count_nonzero(np.diff(held) == 0.0) == 5 * 100


def test_the_encoder_and_the_thermal_operators_are_the_vocabularys() -> None:
    angle = np.linspace(0.0, 720.0, 50)
    off = angle_error({"encoder_eccentricity": {"amplitude_arcsec": 36.0, "phase_deg": 30.0, "order": 1}}, angle, 0.0)
    np.testing.assert_allclose(off, 0.01 * np.sin(np.radians(angle - 30.0)), atol=1e-12)
    np.testing.assert_array_equal(
        backlash(np.array([0.0, 1.0, 3.0, 5.0, 4.0, 0.0]), 2.0), [0.0, 0.0, 1.0, 3.0, 3.0, 2.0]
    )
    climate = weather(plan(145.0, (25.0, 50.0)))
    lag = climate.housing_c - climate.coil_c(300.0)
    at = int(np.searchsorted(climate.time_s, 400.0))
    slope = (climate.coil_c(300.0)[at + 10] - climate.coil_c(300.0)[at - 10]) / 2.0
    assert lag[at] == pytest.approx(300.0 * slope, rel=1e-3)
    assert climate.coil_rate_c_per_s(300.0)[at] == pytest.approx(slope, rel=1e-3)
    assert climate.coil_rate_c_per_s(0.0)[at] == pytest.approx(np.gradient(climate.housing_c, 0.1)[at], rel=1e-2)
