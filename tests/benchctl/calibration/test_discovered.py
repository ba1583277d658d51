"""Structures without a name beside a law: taken off where it is fitted, applied and exported."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.calibration.coefficients import applied_law, checked
from benchctl.cli.app import run_verb
from benchctl.model_file import Model, write_model
from benchctl.recordings.model import Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from tests.benchctl.calibration.campaigns import TRUTH, recorded
from tests.benchctl.calibration.made_coefficients import RATE_DPS, TEMPERATURE_C, asked, compiled, made, written
from tests.benchctl.calibration.synthetic import meta_of

STRUCTURES: Mapping[str, Mapping[str, float]] = {
    "step_of_scale_over_gyro_temp": {"change": -0.0074, "at": 34.6, "width": 0.2},
    "step_below_of_scale_over_gyro_temp": {"change": 0.004, "at": -12.0, "width": 1.0},
    "steps_of_bias_over_gyro_temp": {"change": 2e-3, "change_2": -1e-3, "at": 3.0, "at_2": 41.0, "width": 0.5},
    "plateau_of_scale_over_gyro_temp": {"change": 0.003, "at": 10.0, "length": 12.0},
    "kink_of_scale_over_abs_rate": {"above": -4e-5, "at": 60.0},
    "kink_below_of_bias_over_rate": {"below": 2e-5, "at": -30.0},
    "power_of_scale_over_abs_rate": {"change": 0.01, "at": 20.0, "exponent": 1.7, "high": 150.0},
    "power_below_of_bias_over_gyro_temp": {"change": 0.01, "at": 0.0, "exponent": 2.5, "low": -40.0},
    "bend_of_scale_over_gyro_temp": {"below": 1e-4, "above": -1e-4, "at": 12.0},
    "bump_of_bias_over_gyro_temp": {"change": 0.02, "at": 27.0, "width": 2.0},
    "resonance_of_scale_over_gyro_temp": {"change": 0.02, "at": 27.0, "width": 2.0},
    "wave_of_bias_over_rate": {"cosine": 1e-3, "sine": -2e-3, "period": 40.0},
    "wave_of_bias_over_output": {"cosine": 1e-3, "sine": -2e-3, "period": 1.7},
    "line_of_scale_over_abs_rate": {"c1": 3e-5},
    "parabola_of_bias_over_gyro_temp": {"c1": 1e-4, "c2": -2e-6},
    "cubic_of_bias_over_output": {"c1": 1e-3, "c2": -2e-4, "c3": 1e-5},
    "rise_of_scale_over_gyro_temp": {"change": 0.01, "tau": 12.0, "high": 60.0},
    "fall_of_bias_over_gyro_temp": {"change": 0.01, "tau": 12.0, "low": -40.0},
    "positive_of_bias_over_rate_sign": {"change": 4e-3},
    "negative_of_bias_over_rate_sign": {"change": 4e-3},
    "either_of_scale_over_rate_sign": {"change": 4e-3},
    "spline6_of_scale_over_gyro_temp": {
        **{f"v{i}": 0.004 * (-1) ** i for i in range(6)},
        "low": -40.0,
        "high": 60.0,
    },
    "step_of_scale_over_gyro_temp_times_abs_rate": {"change": 3.5e-5, "at": 20.0, "width": 26.0},
    "wave_of_bias_over_gyro_temp_times_rate_sign": {"cosine": 1e-3, "sine": 0.0, "period": 30.0},
}


def _content(structures: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    return {"discovered": {"U0_v": 0.012, "structures": structures}}


@pytest.mark.parametrize("name", STRUCTURES)
def test_an_output_with_a_structure_leads_back_to_its_rate(name: str) -> None:
    law = applied_law(checked(made(**_content({name: STRUCTURES[name]})), "here"), "joint")
    chance = np.random.default_rng(1)
    rate_dps, celsius = chance.uniform(-RATE_DPS, RATE_DPS, 3000), chance.uniform(*TEMPERATURE_C, 3000)
    rate_dps[0] = 0.0
    slow = np.abs(rate_dps) < 1.0  # where the direction is about to be none, an output may belong to two rates
    volts = law.volts(rate_dps, celsius)
    bare = replace(law, discovered=type(law.discovered)())
    assert np.abs(bare.rate_dps(volts, celsius) - rate_dps).max() > 0.01
    np.testing.assert_allclose(law.rate_dps(volts, celsius)[~slow], rate_dps[~slow], atol=1e-8)


@pytest.mark.parametrize("names", [[name] for name in STRUCTURES] + [list(STRUCTURES)[:8]], ids=lambda one: one[0])
def test_the_header_takes_a_structure_off_as_python_does(names: list[str], tmp_path: Path) -> None:
    structures = {name: STRUCTURES[name] for name in names}
    compensation, program = compiled(written(tmp_path, **_content(structures)), tmp_path)
    chance = np.random.default_rng(2)
    rate_dps, celsius = chance.uniform(-RATE_DPS, RATE_DPS, 2000), chance.uniform(*TEMPERATURE_C, 2000)
    volts = compensation.law.volts(rate_dps, celsius)
    answer = asked(program, volts, celsius)
    assert answer.missed == 0
    clear = np.abs(rate_dps) > 1.0
    np.testing.assert_allclose(answer.rate_dps[clear], compensation.law.rate_dps(volts, celsius)[clear], atol=1e-9)


def _with_structures(step: Step) -> Step:
    """The step of a gyro whose scale factor is 1 % lower above 30 °C, and whose bias has a bump at −20 °C."""
    celsius = step["gyro_temp_c"]
    volts = TRUTH.U0 + (step["gyro_v"] - TRUTH.U0) * np.where(celsius > 30.0, 0.99, 1.0)
    volts = volts + 0.03 * np.exp(-0.5 * ((celsius + 20.0) / 3.0) ** 2)
    return Step(step.info, {**step.channels, "gyro_v": volts})


SIMULATION = {
    "K0_v_per_dps": 0.05,
    "U0_v": TRUTH.U0,
    "T0_c": 20.0,
    "k_T": [],
    "k_omega": [],
    "noise_v_rms": 5e-4,
    "output_limit_v": 10.0,
}
FOUND = {
    "step_of_scale_over_gyro_temp": {"change": -0.01, "at": 30.0, "width": 0.2},
    "bump_of_bias_over_gyro_temp": {"change": 0.03, "at": -20.0, "width": 3.0},
}


@pytest.mark.slow
def test_what_a_diagnosis_found_is_taken_off_where_a_gyro_is_fitted_and_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_recording(Path("a.h5"), meta_of(TRUTH), map(_with_structures, recorded()))
    drift = {"line_of_bias_over_time": {"c1": 1e-9}}
    write_model(Path("model.toml"), Model(simulation=SIMULATION, effects={**FOUND, **drift}))
    assert run_verb(["fit", "a.h5", "--out", "bare"]) == 0
    assert run_verb(["fit", "a.h5", "--out", "whole", "--model", "model.toml"]) == 0
    said = capsys.readouterr().out
    assert "taken off the output before the fit: Where the coil's temperature is above 30 °C" in said
    assert "note: line_of_bias_over_time is not taken off the output: only a structure" in said
    bare, whole = (json.loads(Path(one, "coefficients.json").read_text()) for one in ("bare", "whole"))
    assert whole["error_percent"]["joint"] < 0.1 * bare["error_percent"]["joint"]
    assert whole["discovered"] == {"U0_v": TRUTH.U0, "structures": FOUND}
    true = TRUTH.named()
    for name in ("K0_v_per_dps", "S_rad_per_dps", "g1"):
        told = whole["uncertainty"]["parameters"][name]
        assert abs(told["value"] - true[name]) < 2.0 * told["expanded"]
    assert run_verb(["apply", "a.h5", "--coefficients", "whole/coefficients.json", "-o", "c.h5"]) == 0
    with open_recording(Path("c.h5")) as new:
        steps = list(new.steps(kinds=["constant_rate"]))
    asked_dps = np.array([step.info.rate_dps for step in steps], dtype=float) + TRUTH.earth
    found = np.array([step["compensated_dps"].mean() for step in steps])
    assert np.abs(found - asked_dps).max() < 0.02
    for to in ("c-header", "json"):
        assert run_verb(["export", "whole/coefficients.json", "--to", to]) == 0


@pytest.mark.parametrize(
    ("effects", "says"),
    [
        ({}, "has no table [discovered.…]"),
        ({"line_of_bias_over_time": {"c1": 1e-9}}, "line_of_bias_over_time: only a structure of the scale factor"),
        ({"memory_of_bias_over_gyro_temp": {"c1": 1e-4, "tau": 60.0}}, "without memory"),
        ({"line_of_sampling_over_gyro_temp": {"c1": 1e-6}}, "only a structure of the scale factor"),
    ],
)
def test_a_model_with_nothing_to_take_off_is_refused_in_a_line_and_nothing_is_written(
    effects: dict[str, dict[str, float]], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_recording(tmp_path / "a.h5", meta_of(TRUTH), recorded())
    write_model(tmp_path / "model.toml", Model(simulation=SIMULATION, effects=effects))
    arguments = ["fit", tmp_path / "a.h5", "--out", tmp_path / "out", "--model", tmp_path / "model.toml"]
    assert run_verb([str(one) for one in arguments]) != 0
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert says in said
    assert not (tmp_path / "out").exists()
