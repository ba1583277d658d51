from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import load_bench
from benchctl.campaign.opened import world_settings
from benchctl.model_file import Model, read_model, write_model
from benchctl_instruments.errors import UsageError

LAB = {
    "K0_v_per_dps": 0.016,
    "U0_v": 0.012,
    "T0_c": 23.0,
    "k_T": [0.0001315, -2.066e-06],
    "k_omega": [],
    "noise_v_rms": 0.0005,
    "output_limit_v": 4.0,
}
MODEL = Model(
    simulation=LAB,
    physics={"table": {"ripple": 1e-4}, "room_c": 21.0},
    effects={"thermal_lag": {"tau_s": 312.0}, "encoder_eccentricity": {"amplitude_arcsec": 80.0, "phase_deg": 331.5}},
    recording="runs/monday.h5",
)


def _of(folder: Path, text: str) -> Model:
    path = folder / "model.toml"
    path.write_text(text, encoding="utf-8")
    return read_model(path)


@pytest.mark.parametrize("model", [MODEL, Model(), Model(effects={"clock_drift": {"ppm": 20.0}})])
def test_what_is_written_is_read_back_as_it_was(tmp_path: Path, model: Model) -> None:
    write_model(tmp_path / "model.toml", model)
    assert read_model(tmp_path / "model.toml") == model


def test_numbers_of_numpy_and_tuples_are_written_as_plain_ones(tmp_path: Path) -> None:
    numbers = {**LAB, "U0_v": np.float64(0.012), "k_T": tuple(np.array(LAB["k_T"]))}
    write_model(tmp_path / "model.toml", Model(simulation=numbers))
    assert read_model(tmp_path / "model.toml").simulation == LAB


def test_a_file_says_of_itself_what_it_is_and_how_to_play_it(tmp_path: Path) -> None:
    write_model(tmp_path / "model.toml", MODEL)
    first, second, *_ = (tmp_path / "model.toml").read_text(encoding="utf-8").splitlines()
    assert first == "# benchctl simulate PROCEDURE --model model.toml -o FILE.h5 plays it"
    assert second == 'format = "benchctl-model/1"'


def test_a_file_of_a_drive_says_what_begins_with_it(tmp_path: Path) -> None:
    drive = {"inertia_kg_m2": 0.2, "viscous_nm_s": 0.01, "torque_noise_nm": 0.001}
    write_model(tmp_path / "drive.toml", Model(parts={"drive": drive}))
    first = (tmp_path / "drive.toml").read_text(encoding="utf-8").splitlines()[0]
    assert first == "# benchctl diagnose FILE.h5 --part drive --model drive.toml begins with it"


def test_tables_of_physics_at_the_top_level_are_a_model_too(tmp_path: Path) -> None:
    model = _of(tmp_path, "room_c = 25.0\n[gyro]\nS_rad_per_dps = 0.004\n[effects.bias_drift]\nv_per_hour = 1e-3\n")
    assert model == Model(
        physics={"room_c": 25.0, "gyro": {"S_rad_per_dps": 0.004}}, effects={"bias_drift": {"v_per_hour": 1e-3}}
    )


def test_a_bench_that_obeys_a_model_has_its_gyro_and_believes_in_it() -> None:
    bench = load_bench("simulated").obeying(MODEL)
    settings = world_settings(bench)
    assert settings.response is not None
    assert settings.response.k_T == (0.0001315, -2.066e-06)
    assert (settings.room_c, settings.table.ripple) == (21.0, 1e-4)
    assert bench.simulation is not None
    assert bench.simulation.model_dump(mode="json") == LAB
    assert bench.effects == MODEL.effects


def test_a_model_of_physics_alone_leaves_the_interferometer_and_the_belief() -> None:
    stands = load_bench("simulated")
    bench = stands.obeying(Model(physics={"gyro": {"K0_v_per_dps": 0.04}}))
    settings = world_settings(bench)
    assert (settings.response, settings.gyro.K0_v_per_dps) == (None, 0.04)
    assert bench.simulation == stands.simulation


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[gyro\n", "not TOML: "),
        ('format = "benchctl-model/2"\n', "format: expected \"benchctl-model/1\", got 'benchctl-model/2'"),
        ("recording = 3\n", "recording: expected text, got 3"),
        ("effects = 3\n", "effects: expected a table [effects], got 3"),
        ("simulation = []\n", "simulation: expected a table [simulation], got []"),
        ("[simulation]\nK0 = 1.0\n", "[simulation] K0: no such field; there are K0_v_per_dps, U0_v"),
        ("[simulation]\nK0_v_per_dps = 1.0\n", "[simulation] U0_v: this field is needed and is not there"),
        ("[gyro]\nK0 = 1.0\n", "[physics.gyro] K0: no such field; there are K0_v_per_dps"),
        ("speed = 1.0\n", "[physics] speed: no such field; there are gyro, table"),
        ("[physics.table]\nripple = 'much'\n", "[physics.table] ripple: expected a finite number, got 'much'"),
        ("room_c = 20.0\n[physics]\nseed = 1\n", "room_c: goes into [physics], which this file has"),
        (
            "[effects.gremlins]\na = 1\n",
            "[effects.gremlins] effect 'gremlins': there is no such effect; there are adc_coarse",
        ),
        ("[effects.thermal_lag]\ntau = 1\n", "[effects.thermal_lag] tau: no such field; there are tau_s"),
        ("[effects.thermal_lag]\ntau_s = -3\n", "[effects.thermal_lag] tau_s: expected "),
    ],
)
def test_a_wrong_file_is_one_line_that_names_it_the_table_and_the_field(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(UsageError) as caught:
        _of(tmp_path, text)
    message = str(caught.value)
    assert message.startswith(f"model {tmp_path / 'model.toml'}: {says}")
    assert "\n" not in message


def test_a_file_that_cannot_be_read_or_written_says_so(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"^model .*none\.toml: cannot be read: no such file"):
        read_model(tmp_path / "none.toml")
    with pytest.raises(UsageError, match=r"model\.toml: cannot be written: no such file"):
        write_model(tmp_path / "none" / "model.toml", MODEL)
