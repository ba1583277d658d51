"""Torques without a name: found over their coordinate, in their shape, alone and beside what has a name."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from benchctl.diagnosis.diagnose import diagnose
from benchctl.diagnosis.result import Diagnosis
from benchctl.model_file import Model, read_model, write_model
from benchctl.recordings.reader import join
from benchctl.reports.diagnosis_page import diagnosis_page
from benchctl.reports.mismatch_figures import curve_figure
from benchctl_instruments.errors import UsageError
from tests.benchctl.diagnosis.made_drive import INERTIA, VISCOUS, Truth, drive_channels
from tests.benchctl.diagnosis.made_recording import recording_of


def rough_place(_t: float, angle_deg: float, _rate_dps: float) -> float:
    """A bearing that is rough about 140°."""
    return 0.02 * math.exp(-0.5 * (((angle_deg - 140.0 + 180.0) % 360.0 - 180.0) / 12.0) ** 2)


def dragging_brake(t: float, _angle_deg: float, _rate_dps: float) -> float:
    """A brake that drags for 25 s."""
    return 0.015 if 30.0 < t < 55.0 else 0.0


def windage(_t: float, _angle_deg: float, rate_dps: float) -> float:
    """What begins at 90 °/s."""
    return 3e-4 * max(rate_dps - 90.0, 0.0)


def switched(t: float, _angle_deg: float, _rate_dps: float) -> float:
    """An amplifier that is off by another torque from 40 s on."""
    return 0.012 if t > 40.0 else 0.0


def seal(_t: float, _angle_deg: float, rate_dps: float) -> float:
    """A seal that drags more, and more with the rate, except in fast turns to the left."""
    return 4e-4 * max(rate_dps + 60.0, 0.0)


def dent(_t: float, angle_deg: float, _rate_dps: float) -> float:
    """A wide dent about 200°, which an offset and the harmonics 1 to 3 follow as well."""
    return -0.02 * math.exp(-0.5 * ((angle_deg % 360.0 - 200.0) / 40.0) ** 2)


ROUGH = ("bump_of_torque_over_angle", {"change": 0.02, "at": 140.0, "width": 12.0})
BRAKE = ("plateau_of_torque_over_time", {"change": 0.015, "at": 30.0, "length": 25.0})
WINDAGE = ("kink_of_torque_over_rate", {"above": 3e-4, "at": 90.0})
SEAL = ("kink_of_torque_over_rate", {"above": 4e-4, "at": -60.0})
SWITCHED = ("step_of_torque_over_time", {"change": 0.012, "at": 40.0})


def diagnosed(truth: Truth, seed: int = 4) -> Diagnosis:
    return diagnose(recording_of(drive_channels(truth, seed)), part="drive")


@pytest.mark.parametrize(
    ("truth", "names", "structure"),
    [
        (Truth(extra=windage), [], WINDAGE),
        (Truth(extra=dragging_brake, coulomb=0.02), ["coulomb_friction"], BRAKE),
        (Truth(extra=seal), [], SEAL),
        pytest.param(Truth(extra=rough_place), [], ROUGH, marks=pytest.mark.slow),
        pytest.param(
            Truth(extra=rough_place, coulomb=0.02, offset=0.01),
            ["coulomb_friction", "torque_offset"],
            ROUGH,
            marks=pytest.mark.slow,
        ),
        pytest.param(Truth(extra=dragging_brake), [], BRAKE, marks=pytest.mark.slow),
        pytest.param(Truth(extra=switched, cogging=0.01), ["cogging_torque"], SWITCHED, marks=pytest.mark.slow),
    ],
)
def test_a_torque_without_a_name_is_modelled_beside_the_names_with_its_values_in_their_intervals(
    truth: Truth, names: list[str], structure: tuple[str, dict[str, float]]
) -> None:
    found = diagnosed(truth)
    identifier, values = structure
    assert sorted(one.effect for one in found.findings) == names
    (model,) = found.unexplained.models
    assert (model.identifier, model.stage) == (identifier, "torque")
    for name, value in values.items():
        estimate = model.parameters[name]
        assert estimate.low is not None
        assert estimate.high is not None
        assert estimate.value == pytest.approx(value, rel=0.05)
        # two intervals: this is one draw of many
        half = 0.5 * (estimate.high - estimate.low)
        assert abs(estimate.value - value) < 2.0 * half
    assert model.hints
    assert found.fit.heldout_after < 1.05 * found.fit.noise < found.fit.heldout_before
    assert "N·m" in found.unexplained.says
    assert "bias" not in found.unexplained.says
    assert found.not_found == ()


@pytest.mark.slow
def test_a_wide_dent_over_the_angle_is_one_shape_and_not_an_offset_with_harmonics() -> None:
    found = diagnosed(Truth(extra=dent, cogging=0.02, order=19))
    (cogging,) = found.findings
    assert cogging.parameters["order"].value == pytest.approx(19.0, abs=0.5)
    (model,) = found.unexplained.models
    assert model.identifier == "bump_of_torque_over_angle"
    for name, value in (("change", -0.02), ("at", 200.0), ("width", 40.0)):
        assert model.parameters[name].value == pytest.approx(value, rel=0.03)


def test_report_and_model_file_carry_the_torque_which_is_refused_of_another_part(tmp_path: Path) -> None:
    recording = recording_of(drive_channels(Truth(extra=windage), 5))
    found = diagnose(recording, part="drive")
    page = diagnosis_page(found, recording.meta, recording.infos, digest="", unit="N m")
    assert "Kink of the torque over the" in page
    assert "τ = J·dω/dt + b·ω + above·max(rate − at, 0)" in page
    of_a_load = curve_figure(found.unexplained.models[0], "count")
    assert "(count)" in of_a_load.axes[0].get_ylabel()
    file = tmp_path / "model.toml"
    write_model(file, Model(parts=found.model["parts"]))
    effects = read_model(file).parts["drive"]["effects"]
    assert list(effects) == ["kink_of_torque_over_rate"]
    assert effects["kink_of_torque_over_rate"]["above"] == pytest.approx(3e-4, rel=0.02)
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("kink_of_torque_over_rate", "kink_of_bias_over_rate"), encoding="utf-8")
    with pytest.raises(UsageError, match="kink_of_bias_over_rate: no such effect"):
        read_model(file)


@pytest.mark.slow
def test_friction_that_explains_more_than_an_unknown_load_leaves_is_still_named() -> None:
    def load(t: float, _angle_deg: float, rate_dps: float) -> float:
        return 0.03 * math.sin(0.0012 * rate_dps * abs(rate_dps)) + 0.009 * math.sin(0.0004 * t * t)

    truth = Truth(coulomb=0.05, offset=0.006, extra=load)
    found = diagnose(recording_of(drive_channels(truth, 4, seconds=40.0, rate_hz=100.0)), part="drive")
    friction, offset = found.findings
    assert friction.parameters["coulomb_nm"].value == pytest.approx(0.05, rel=0.05)
    assert offset.parameters["offset_nm"].value == pytest.approx(0.006, rel=0.25)
    assert "no known effect accounts for it" in found.unexplained.says


def test_time_is_counted_in_each_of_two_joined_recordings() -> None:
    runs = [recording_of(drive_channels(Truth(extra=dragging_brake), seed)) for seed in (6, 7)]
    found = diagnose(join(runs), part="drive")
    (model,) = found.unexplained.models
    assert model.identifier == "plateau_of_torque_over_time"
    assert model.parameters["at"].value == pytest.approx(30.0, abs=0.2)
    assert model.parameters["change"].value == pytest.approx(0.015, rel=0.05)


@pytest.mark.slow
def test_a_joint_that_swings_about_zero_has_one_rough_place_there_where_its_encoder_goes_from_360_to_0() -> None:
    noise, time_s = np.random.default_rng(3), np.arange(3_000) / 100.0
    angle_deg = 40.0 * np.sin(0.9 * time_s) + 15.0 * np.sin(0.31 * time_s + 1.0)
    rate_dps = np.gradient(angle_deg, time_s)
    torque_nm = np.radians(INERTIA * np.gradient(rate_dps, time_s) + VISCOUS * rate_dps)
    torque_nm += 0.01 * np.exp(-0.5 * ((angle_deg + 2.0) / 4.0) ** 2) + noise.normal(0.0, 0.001, time_s.size)
    encoder_deg = np.mod(angle_deg + noise.normal(0.0, 0.5 / 3600.0, time_s.size), 360.0)
    found = diagnose(recording_of({"time_s": time_s, "encoder_deg": encoder_deg, "torque_nm": torque_nm}), part="drive")
    assert found.findings == ()
    (model,) = found.unexplained.models
    assert (model.identifier, model.coordinates) == ("bump_of_torque_over_swing_angle", ("angle",))
    for name, value in (("change", 0.01), ("at", -2.0), ("width", 4.0)):
        assert model.parameters[name].value == pytest.approx(value, rel=0.05)


def test_at_one_constant_rate_no_function_of_angle_or_rate_cancels_one_of_time() -> None:
    """The joint of a robot that creeps: its angle goes with time, and its torque changes with time."""
    noise, time_s = np.random.default_rng(1), np.arange(4000) / 100.0
    rate_dps = 0.2 * (1.0 - np.exp(-time_s / 0.5)) + 0.004 * np.sin(1.1 * time_s)
    angle_deg = 200.0 - np.cumsum(rate_dps) / 100.0 + noise.normal(0.0, 2e-4, time_s.size)
    torque_nm = -8.0 * (1.0 - np.exp(-time_s / 1.5)) - 3.0 * np.exp(-(((time_s - 14.0) / 6.0) ** 2)) - 0.08 * time_s
    torque_nm += noise.normal(0.0, 0.2, time_s.size)
    told = diagnose(recording_of({"time_s": time_s, "encoder_deg": angle_deg, "torque_nm": torque_nm}))
    assert (told.part, told.findings) == ("drive", ())
    assert told.unexplained.models[0].coordinates == ("time",)
    assert told.fit.heldout_after < 0.1
    for model in told.unexplained.models:
        assert all(abs(one.value) < 2.0 * np.ptp(torque_nm) for one in model.parameters.values() if one.unit == "N m")
