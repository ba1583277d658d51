"""Real chambers, by others: what is in them, and how far the free-running temperature may miss on pieces held out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from benchctl.diagnosis.diagnose import diagnose
from benchctl.diagnosis.result import Diagnosis, Finding
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import join, open_recording
from tests.shared import SHARED, needs_shared

MAPS = Path(__file__).parents[1] / "benchctl" / "recordings" / "maps"
DATA = SHARED / "data" / "thermal"

pytestmark = [needs_shared("data/thermal"), pytest.mark.long, pytest.mark.timeout(600)]


def _diagnosis(name: str, map_name: str, folder: Path) -> tuple[Diagnosis, Mapping[str, Finding]]:
    import_recording(DATA / name, MAPS / f"{map_name}.toml", folder / "imported.h5")
    with open_recording(folder / "imported.h5") as recording:
        told = diagnose(recording, part="chamber")
    return told, {one.effect: one for one in told.findings}


def test_an_oven_at_full_power_answers_late_and_through_a_lag(tmp_path: Path) -> None:
    told, found = _diagnosis("2024-08-03__signals_step_100_percent_door_closed.log", "oven_step", tmp_path)
    assert set(found) == {"dead_time", "second_lag"}
    assert found["dead_time"].parameters["delay_s"].value == pytest.approx(16.0, abs=4.0)
    assert found["second_lag"].parameters["tau_s"].value == pytest.approx(28.0, abs=7.0)
    assert told.fit.heldout_after <= 3.5


def test_the_spikes_of_an_oven_are_faults_of_its_data_and_its_door_opens_at_the_peak(tmp_path: Path) -> None:
    told, found = _diagnosis("2024-12-08__signals_controlled_adjusted_profile.log", "oven_profile", tmp_path)
    assert "1536 °C" in found["outliers"].says
    door = found["loss_step"]
    assert door.parameters["fraction"].value < -0.5  # until then a fraction of the loss
    assert 720.0 * door.parameters["moment"].value == pytest.approx(600.0, abs=30.0)
    assert told.fit.heldout_after <= 6.5


def test_a_cold_finger_that_cools_shares_its_heat_with_another_body(tmp_path: Path) -> None:
    told, found = _diagnosis("cooldown_20130419_13.24.44.csv", "cold_finger", tmp_path)
    # an independent fit to the temperature has 179 s; one to its increments had 150
    assert found["heat_store"].parameters["tau_s"].value == pytest.approx(179.0, rel=0.15)
    assert told.fit.heldout_after <= 0.25


def test_a_cold_finger_that_warms_exchanges_heat_with_another_body(tmp_path: Path) -> None:
    told, found = _diagnosis("warmup_20130419_13.58.50.csv", "cold_finger", tmp_path)
    assert "exchange" in found
    assert told.fit.heldout_after <= 0.25


def test_both_runs_of_a_cold_finger_together_tell_its_exchange_from_its_store_of_heat(tmp_path: Path) -> None:
    recordings = []
    for name in ("cooldown_20130419_13.24.44", "warmup_20130419_13.58.50"):
        import_recording(DATA / f"{name}.csv", MAPS / "cold_finger.toml", tmp_path / f"{name}.h5")
        recordings.append(open_recording(tmp_path / f"{name}.h5"))
    told = diagnose(join(recordings), part="chamber")
    for one in recordings:
        one.close()
    found = {one.effect: one for one in told.findings}
    assert {"exchange", "heat_store"} <= set(found) <= {"exchange", "heat_store", "second_lag"}  # the thermometer's own
    assert found["exchange"].parameters["rate_per_s"].low > 0.0
    assert found["heat_store"].parameters["capacity"].low > 0.0
    assert told.fit.heldout_after <= 0.25


def test_a_transistor_heats_through_a_second_lag(tmp_path: Path) -> None:
    told, found = _diagnosis("tclab_step.csv", "tclab", tmp_path)
    assert set(found) == {"second_lag"}
    assert 25.0 <= found["second_lag"].parameters["tau_s"].value <= 32.0
    assert told.fit.heldout_after <= 0.25
