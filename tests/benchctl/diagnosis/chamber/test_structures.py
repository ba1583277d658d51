"""Heat without a name: found over its coordinate, in its shape, alone and beside what has a name."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchctl.diagnosis.diagnose import diagnose
from benchctl.model_file import Model, read_model, write_model
from benchctl.proof.part_trials import drawn
from benchctl.recordings.reader import open_recording
from benchctl.reports.diagnosis_page import diagnosis_page
from tests.benchctl.diagnosis.made_chamber import Truth, chamber_channels
from tests.benchctl.diagnosis.made_recording import recording_of

pytestmark = pytest.mark.slow


def vent(_t: float, air_c: float) -> float:
    """A vent that opens by itself above 90 °C."""
    return -20.0 if air_c > 90.0 else 0.0


def lamp(t: float, _air_c: float) -> float:
    """A lamp that is on for 300 s."""
    return 9.0 if 600.0 < t < 900.0 else 0.0


def test_a_vent_that_opens_at_a_temperature_is_modelled_carried_by_the_model_file_and_reported(tmp_path: Path) -> None:
    recording = recording_of(chamber_channels(Truth(extra=vent), 3))
    found = diagnose(recording, part="chamber")
    assert not found.findings
    (model,) = found.unexplained.models
    assert (model.identifier, model.stage) == ("step_of_heat_over_chamber_temp", "heat")
    assert model.parameters["at"].value == pytest.approx(90.0, abs=1.0)
    assert model.parameters["change"].value == pytest.approx(-20.0, rel=0.1)
    assert model.hints
    assert "the temperature to which the air settles is" in found.unexplained.says
    assert found.fit.heldout_after < 0.5 * found.fit.heldout_before

    file = tmp_path / "model.toml"
    write_model(file, Model(parts=found.model["parts"]))
    assert list(read_model(file).parts["chamber"]["effects"]) == ["step_of_heat_over_chamber_temp"]
    page = diagnosis_page(found, recording.meta, recording.infos, digest="", unit="K")
    assert "Step of the heat over the chamber" in page
    assert "T_room − T + " in page


def test_a_lamp_that_is_on_for_a_while_is_modelled_beside_a_second_lag() -> None:
    found = diagnose(recording_of(chamber_channels(Truth(extra=lamp, second_lag_s=25.0), 4)), part="chamber")
    assert [one.effect for one in found.findings] == ["second_lag"]
    (model,) = found.unexplained.models
    assert model.identifier == "plateau_of_heat_over_time"
    assert model.parameters["change"].value == pytest.approx(9.0, rel=0.1)
    assert model.parameters["at"].value == pytest.approx(600.0, abs=10.0)
    assert model.parameters["length"].value == pytest.approx(300.0, abs=20.0)


def test_a_lid_that_is_opened_twice_is_modelled_as_two_times_of_a_larger_loss() -> None:
    truth = Truth(opened_s=((420.0, 480.0), (1000.0, 1070.0)), opened=12.0, second_lag_s=25.0)
    every_2_s = {name: values[::4] for name, values in chamber_channels(truth, 5).items()}
    found = diagnose(recording_of(every_2_s), part="chamber")
    assert [one.effect for one in found.findings] == ["second_lag"]
    assert [one.identifier for one in found.unexplained.models] == [
        "plateau_of_loss_over_time",
        "plateau_of_loss_over_time_2",
    ]
    for model, (begin_s, end_s) in zip(found.unexplained.models, truth.opened_s, strict=True):
        at_s, lasts_s = (model.parameters[name].value for name in ("at", "length"))
        assert (at_s, at_s + lasts_s) == pytest.approx((begin_s, end_s), abs=10.0)
        assert model.parameters["change"].value == pytest.approx(truth.opened - 1.0, rel=0.3)
    assert "times as large" in found.unexplained.says
    assert found.fit.heldout_after < 0.2 * found.fit.heldout_before


def test_a_chamber_that_is_opened_too_often_for_the_search_is_not_said_to_agree_with_its_model() -> None:
    truth = Truth(opened_s=tuple((at, at + 50.0) for at in (150.0, 400.0, 640.0, 1000.0)), opened=15.0)
    every_4_s = {name: values[::8] for name, values in chamber_channels(truth, 6).items()}
    found = diagnose(recording_of(every_4_s), part="chamber")
    assert found.unexplained.significant
    assert found.unexplained.says


def test_a_heater_that_weakens_above_a_power_is_a_kink_and_not_a_curvature(tmp_path: Path) -> None:
    trial = drawn(104, 13, "chamber-structure")
    truth = trial.effects["kink_of_heat_over_heater"]
    recording, _ = trial.record(tmp_path)
    with open_recording(recording) as opened:
        found = diagnose(opened, part="chamber")
    assert not found.findings
    (model,) = found.unexplained.models
    assert model.identifier == "kink_of_heat_over_heater"
    at = model.parameters["at"]
    assert at.low is not None
    assert at.high is not None
    assert at.low < truth["at"] < at.high
