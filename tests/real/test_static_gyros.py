"""Static points of real gyros on a rate table, by step305/MEMS_Gyro_Tests: what a diagnosis must say of each."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from benchctl.diagnosis import diagnose
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import open_recording
from tests.shared import SHARED, needs_shared

FOLDER = "data/vg910"
pytestmark = needs_shared(FOLDER)


def diagnosed(name: str, folder: Path) -> tuple[Mapping[str, Mapping[str, Any]], Mapping[str, Any]]:
    """The findings by effect, and the whole answer, as its JSON states them; no model file."""
    recording = folder / f"{name}.h5"
    import_recording(SHARED / FOLDER / f"{name}.csv", None, recording)
    with open_recording(recording) as opened:
        said = diagnose(opened).as_json()
    return {one["effect"]: one for one in said["findings"]}, said


def test_a_gyro_on_a_single_supply_has_two_rails_and_nothing_else(tmp_path: Path) -> None:
    found, said = diagnosed("crs03_static_points", tmp_path)
    assert list(found) == ["two_rails"]
    rails = found["two_rails"]["parameters"]
    assert rails["lower_v"]["value"] == pytest.approx(0.136, abs=2e-3)
    assert rails["upper_v"]["value"] == pytest.approx(5.135, abs=2e-3)
    for rail, value in (("lower_v", 0.1363), ("upper_v", 5.1354)):
        low, high = rails[rail]["ci95"]
        assert low < value < high
        assert high - low < 5e-3
    assert not said["unexplained"]["significant"]
    assert said["fit"]["heldout_after"] <= 2.5e-3
    assert said["baseline"]["parameters"]["K0_v_per_dps"]["value"] == pytest.approx(-0.02, rel=0.01)
    assert any("stated deviation collapses at -200, -160, 160, 200 °/s" in note for note in said["notes"])


def test_beyond_240_degrees_a_second_an_interferometer_is_overloaded(tmp_path: Path) -> None:
    found, said = diagnosed("unit1_static_points_to_400", tmp_path)
    assert "rate_nonlinearity" in found
    S = found["rate_nonlinearity"]["parameters"]["S_rad_per_dps"]
    assert 0.0042 <= S["value"] <= 0.0044
    assert S["ci95"][0] < 0.00428 < S["ci95"][1]
    where = found["overload"]["where"]
    assert where["coordinate"] == "abs_rate"
    assert where["ranges"] == [[240.0, 400.0]]
    low, high = found["overload"]["parameters"]["onset_dps"]["ci95"]
    assert (low, high) == (200.0, 240.0)
    assert not said["unexplained"]["significant"]
    assert said["fit"]["heldout_after"] <= 0.2


def test_up_to_200_degrees_a_second_it_is_a_sine_and_no_end_is_seen(tmp_path: Path) -> None:
    found, said = diagnosed("unit1_static_points", tmp_path)
    assert set(found) == {"rate_nonlinearity", "scale_asymmetry"}
    assert 0.0042 <= found["rate_nonlinearity"]["parameters"]["S_rad_per_dps"]["value"] <= 0.0044
    assert said["fit"]["heldout_after"] == pytest.approx(0.011, abs=0.001)
    assert not said["unexplained"]["significant"]
