"""`benchctl simulate --model` and a bench.toml with `[effects]`: what the recording then holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import template
from benchctl.cli.app import run_verb
from benchctl.model_file import Model, write_model
from benchctl.recordings.model import Meta
from benchctl.recordings.reader import open_recording
from benchctl_instruments.arrays import FloatArray

LAB = {
    "K0_v_per_dps": 0.016,
    "U0_v": 0.012,
    "T0_c": 23.0,
    "k_T": [0.0001315],
    "k_omega": [3.0e-06],
    "noise_v_rms": 1e-5,
    "output_limit_v": 4.0,
}


def turning(folder: Path) -> Path:
    """A procedure that turns at 100 deg/s for two seconds."""
    path = folder / "turning.py"
    path.write_text(
        '"""Turn."""\n\n'
        "from collections.abc import Iterator\n\n"
        "from benchctl.plan import ConstantRate, Step, procedure\n\n\n"
        "@procedure()\n"
        "def turning() -> Iterator[Step]:\n"
        '    """Turn."""\n'
        "    yield ConstantRate(rate_dps=100.0, duration_s=2.0, settle_s=1.0)\n",
        encoding="utf-8",
    )
    return path


def simulated(folder: Path, *more: str | Path) -> tuple[Meta, Mapping[str, FloatArray]]:
    """What the recording says of itself, and its one step."""
    arguments = ["simulate", turning(folder), "-o", folder / "run.h5", "--quiet", *more]
    assert run_verb([str(argument) for argument in arguments]) == 0
    with open_recording(folder / "run.h5") as recording:
        (step,) = recording.steps()
        return recording.meta, step.channels


def test_the_recording_obeys_the_models_response_and_its_effects(tmp_path: Path) -> None:
    effects = {"scale_asymmetry": {"fraction": 0.02}, "bias_drift": {"v_per_hour": 0.0}}
    write_model(tmp_path / "model.toml", Model(simulation=LAB, effects=effects))
    meta, data = simulated(tmp_path, "--model", tmp_path / "model.toml")
    celsius = float(data["gyro_temp_c"].mean())
    expected = 0.012 + 0.016 * (1.0 + 1.315e-4 * (celsius - 23.0)) * (1.0 + 3e-6 * 1e4) * 100.0 * 1.01
    assert data["gyro_v"].mean() == pytest.approx(expected, abs=1e-4)
    assert meta.simulation == LAB
    assert json.loads(meta.provenance["bench_effects"]) == effects


def test_a_bench_toml_plays_its_effects(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    runs = []
    for amplitude_v in (0.0, 0.5):
        late = f"[effects.warm_up]\namplitude_v = {amplitude_v}\ntau_s = 36000.0\n"
        bench.write_text(template().replace("[physics]", f"{late}[physics]"), encoding="utf-8")
        runs.append(simulated(tmp_path, "--bench", bench)[1]["gyro_v"])
        (tmp_path / "run.h5").unlink()
    np.testing.assert_allclose(runs[1] - runs[0], 0.5, atol=1e-3)


def test_two_effects_of_one_kind_are_both_played(tmp_path: Path) -> None:
    effects = {
        "heading_dependent_bias": {"amplitude_v": 0.2, "phase_deg": 30.0, "order": 1.0},
        "heading_dependent_bias_2": {"amplitude_v": 0.1, "phase_deg": 70.0, "order": 2.0},
    }
    runs = []
    for found in ({}, effects):
        write_model(tmp_path / "model.toml", Model(simulation=LAB, effects=found))
        runs.append(simulated(tmp_path, "--model", tmp_path / "model.toml")[1])
        (tmp_path / "run.h5").unlink()
    angle = np.radians(runs[0]["encoder_deg"])
    expected = 0.2 * np.cos(angle - np.radians(30.0)) + 0.1 * np.cos(2.0 * (angle - np.radians(70.0)))
    np.testing.assert_allclose(runs[1]["gyro_v"] - runs[0]["gyro_v"], expected, atol=2e-3)


def test_a_model_with_a_wrong_field_is_one_line_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "model.toml").write_text("[effects.thermal_lag]\ntau = 3.0\n", encoding="utf-8")
    arguments = ["simulate", "static", "-o", tmp_path / "run.h5", "--model", tmp_path / "model.toml"]
    assert run_verb([str(argument) for argument in arguments]) == 2
    line = capsys.readouterr().err
    assert (
        line
        == f"benchctl: model {tmp_path / 'model.toml'}: [effects.thermal_lag] tau: no such field; there are tau_s\n"
    )
    assert not (tmp_path / "run.h5").exists()
