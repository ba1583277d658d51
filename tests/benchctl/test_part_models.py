"""Models of a drive and a chamber in model files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchctl.diagnosis.parts import problem_of
from benchctl.model_file import Model, read_model, write_model
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import UsageError

MODEL = Model(
    parts={
        "drive": {
            "inertia_kg_m2": 0.05,
            "viscous_nm_s": 0.03,
            "effects": {
                "coulomb_friction": {"coulomb_nm": 0.02},
                "cogging_torque": {"amplitude_nm": 0.01, "phase_deg": 3.0, "order": 12.0},
                "cogging_torque_2": {"amplitude_nm": 0.004, "phase_deg": 9.0, "order": 36.0},
            },
        }
    },
    recording="runs/monday.h5",
)


def test_a_model_of_a_drive_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    write_model(tmp_path / "model.toml", MODEL)
    assert read_model(tmp_path / "model.toml") == MODEL
    assert not MODEL.bench_physics


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[parts.engine]\npower_w = 3.0\n", r"\[parts\] engine: no such part; there are drive, chamber"),
        ("[parts]\ndrive = 3.0\n", r"\[parts\] drive: expected a table, got 3.0"),
        ("[parts.drive]\neffects = 3.0\n", r"\[parts.drive\] effects: expected a table, got 3.0"),
        ("[parts.drive.effects.rust]\nx = 1\n", r"\[parts.drive.effects\] rust: no such effect; there are cogging"),
        (
            "[parts.drive.effects.coulomb_friction_2]\ncoulomb_nm = 1.0\n",
            r"\[parts.drive.effects\] coulomb_friction_2: no such effect; there are cogging",
        ),
        ("[parts.chamber.effects]\ndead_time = 1\n", r"\[parts.chamber.effects\] dead_time: expected a table"),
        (
            "[parts.chamber.effects.dead_time]\nseconds = 1\n",
            r"\[parts.chamber.effects.dead_time\] seconds: no such field; there are delay_s",
        ),
    ],
)
def test_what_is_wrong_in_a_model_of_a_part_is_named(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=says):
        read_model(path)


MAP = """
[unit]
serial = "table 1"
[time]
column = "t"
[channels.table_rate_dps]
column = "rate"
unit = "deg/s"
[channels.torque_nm]
column = "torque"
unit = "N m"
[drive]
inertia_kg_m2 = 0.05
viscous_nm_s = 0.03
"""


def test_a_map_can_say_what_the_lab_believes_of_its_drive(tmp_path: Path) -> None:
    time_s = np.arange(4000) / 100.0
    rate = 100.0 * np.sin(0.5 * time_s)
    torque = np.radians(0.05 * 50.0 * np.cos(0.5 * time_s) + 0.03 * rate)
    lines = [f"{t:.2f},{dps:.6f},{nm:.8f}" for t, dps, nm in zip(time_s, rate, torque, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["t,rate,torque", *lines]), encoding="utf-8")
    (tmp_path / "map.toml").write_text(MAP, encoding="utf-8")
    import_recording(tmp_path / "log.csv", tmp_path / "map.toml", tmp_path / "log.h5")
    with open_recording(tmp_path / "log.h5") as recording:
        problem = problem_of(recording, "drive")
    assert problem.believed
    assert problem.baseline_start.tolist() == [0.05, 0.03]
    left = problem.measured - problem.predict(problem.baseline_start, ())
    assert np.abs(left[problem.usable]).max() < 1e-5
