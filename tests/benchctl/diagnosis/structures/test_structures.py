"""What has no name is modelled: stage, coordinate and shape are those that were put into a foreign recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.app.diagnose import diagnose as app_diagnose
from benchctl.cli.diagnose import write_effect
from benchctl.diagnosis import diagnose
from benchctl.diagnosis.result import Diagnosis
from benchctl.model_file import Model, read_model, write_model
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import open_recording
from benchctl.reports.diagnosis_page import diagnosis_page
from tests.golden.stored import compare
from tests.shared import SHARED, needs_shared

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def diagnosed(name: str, folder: Path) -> Diagnosis:
    import_recording(SHARED / "recordings" / name, None, folder / "imported.h5")
    with open_recording(folder / "imported.h5") as opened:
        return diagnose(opened)


def diagnosed_as_stored(name: str) -> Diagnosis:
    folder = SHARED / "recordings" / name
    told = app_diagnose([folder]).diagnosis
    compare("diagnose_" + name.replace("/", "_"), told.as_json(), folder)
    return told


def model_in(told: Diagnosis) -> Any:
    return told.as_json()["unexplained"]["model"]


@needs_shared("recordings/unnamed/kink")
def test_a_kink_of_the_scale_factor_is_found_at_its_temperature(tmp_path: Path) -> None:
    told = diagnosed_as_stored("unnamed/kink")
    model = model_in(told)
    assert (model["stage"], model["coordinates"], model["shape"]) == ("scale", ["gyro_temp"], "kink")
    assert model["parameters"]["at"]["value"] == pytest.approx(27.665, abs=0.1)
    assert model["parameters"]["above"]["value"] == pytest.approx(-4.794e-4, rel=0.01)
    assert told.findings == ()
    assert told.fit.heldout_after < 1.05 * told.fit.noise < 0.7 * told.fit.heldout_named
    curve = told.unexplained.models[0].curve
    assert curve is not None
    assert np.std(curve.left) < 0.05 * np.std(curve.required)
    assert ((curve.low <= curve.fitted) & (curve.fitted <= curve.high)).all()
    at_place = np.interp(curve.place, curve.along, curve.fitted)
    assert np.std(curve.required - at_place) < 0.05 * np.std(curve.required)
    _is_written_and_read_back(told, tmp_path)
    assert "effect slope_change" in write_effect(tmp_path / "slope_change.py", told)
    assert "class SlopeChange(PhysicalEffect)" in (tmp_path / "slope_change.py").read_text(encoding="utf-8")


@needs_shared("recordings/sealed/d")
def test_a_mode_hop_is_a_step_of_the_scale_factor_that_takes_hardly_any_temperature(tmp_path: Path) -> None:
    told = diagnosed("sealed/d", tmp_path)
    model = model_in(told)
    assert (model["stage"], model["coordinates"], model["shape"]) == ("scale", ["gyro_temp"], "step")
    assert model["parameters"]["at"]["value"] == pytest.approx(34.589, abs=0.05)
    assert model["parameters"]["change"]["value"] == pytest.approx(-0.0096963, rel=0.01)
    assert model["parameters"]["width"]["value"] < 0.2
    assert told.unexplained.coordinates == ("gyro_temp",)
    assert told.fit.heldout_after < 1.05 * told.fit.noise
    with open_recording(tmp_path / "imported.h5") as opened:
        page = diagnosis_page(told, opened.meta, opened.infos, digest="", unit="V")
    assert "K = K0·(1 + change·clip((gyro_temp − at)/width + ½, 0, 1))" in page
    assert "a mode hop of the source" in page


@needs_shared("recordings/unnamed/slip")
def test_a_coupling_that_slips_is_a_jump_of_the_encoder_at_each_instant() -> None:
    told = diagnosed_as_stored("unnamed/slip")
    models = told.unexplained.models
    assert {(one.stage, one.coordinates, one.shape) for one in models} == {("encoder", ("time",), "jump")}
    jumps = sorted((one.parameters["at"].value, one.parameters["change"].value) for one in models)
    assert jumps == [
        (pytest.approx(989.69, abs=0.05), pytest.approx(282.9, rel=0.03)),
        (pytest.approx(1968.01, abs=0.05), pytest.approx(282.9, rel=0.03)),
    ]
    assert told.findings == ()
    assert told.unexplained.coordinates == ("time",)
    assert told.fit.heldout_after < 1.05 * told.fit.noise
    assert set(told.model["effects"]) == {
        "jump_of_encoder_over_time",
        "jump_of_encoder_over_time_2",
    }


@needs_shared("recordings/unnamed/compressor")
def test_a_bias_that_shifts_while_the_set_point_falls_is_found_beside_a_delay() -> None:
    told = diagnosed_as_stored("unnamed/compressor")
    model = model_in(told)
    assert (model["stage"], model["coordinates"], model["shape"]) == ("bias", ["setpoint"], "negative")
    assert model["parameters"]["change"]["value"] == pytest.approx(-0.0019631, rel=0.02)
    assert [one.effect for one in told.findings] == ["timing_offset"]
    assert told.unexplained.coordinates == ("setpoint",)
    assert told.fit.heldout_after < 1.05 * told.fit.noise
    assert "While the chamber's set point falls the bias is 1.96 mV lower." in told.unexplained.says


def _is_written_and_read_back(told: Diagnosis, folder: Path) -> None:
    """The model file carries the structure under `discovered`, and gives it back as an effect."""
    tables = {name: part for name, part in told.model.items() if name != "format"}
    write_model(folder / "model.toml", Model(**tables))
    assert "[discovered.kink_of_scale_over_gyro_temp]" in (folder / "model.toml").read_text(encoding="utf-8")
    assert read_model(folder / "model.toml").effects == told.model["effects"]
