"""Structures that were put into simulated recordings are modelled where they act, and no name is stated for them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from benchctl.diagnosis import diagnose
from benchctl.diagnosis.result import Diagnosis
from benchctl.proof.seal import record
from benchctl.proof.truth import Effects, Truth
from benchctl.proof.unit import draw_unit
from benchctl.recordings.reader import open_recording

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def diagnosed(folder: Path, seed: int, effects: Effects) -> Diagnosis:
    """The diagnosis of a unit that was drawn with a seed, recorded with effects through the simulated bench's wires."""
    unit = draw_unit(np.random.default_rng(seed), moved=False, lacking=frozenset(), warm=False)
    truth = Truth(index=0, kind="structure", unit=unit, seed=seed, effects=effects, nonce="")
    with open_recording(record(truth, folder / "campaign").recording) as recording:
        return diagnose(recording)


def models_of(told: Diagnosis) -> Mapping[str, tuple[str, tuple[str, ...]]]:
    return {one.identifier: (one.stage, one.coordinates) for one in told.unexplained.models}


def test_a_bias_that_differs_between_heating_and_cooling_is_a_hysteresis_over_temperature(tmp_path: Path) -> None:
    told = diagnosed(tmp_path, 9203, {"hysteresis_of_bias_over_gyro_temp": {"c1": 1.5e-3, "width": 4.0}})
    assert models_of(told) == {"hysteresis_of_bias_over_gyro_temp": ("bias", ("gyro_temp",))}
    assert told.findings == ()
    (model,) = told.unexplained.models
    assert model.parameters["width"].value == pytest.approx(4.0, rel=0.03)
    assert model.parameters["c1"].low < 1.5e-3 < model.parameters["c1"].high
    assert "between rising and falling" in told.unexplained.says
    assert told.fit.heldout_after < 1.05 * told.fit.noise


def test_a_bias_that_depends_on_temperature_and_direction_together_is_modelled_over_both(tmp_path: Path) -> None:
    kink = {"at": 20.0, "above": 4e-4}
    told = diagnosed(tmp_path, 9207, {"kink_of_bias_over_gyro_temp_times_rate_sign": kink})
    assert {stage for stage, _ in models_of(told).values()} == {"bias"}
    assert {words for _, words in models_of(told).values()} == {("gyro_temp*rate_sign",)}
    assert told.findings == ()
    assert told.fit.heldout_after < 1.05 * told.fit.noise


def test_a_strong_bump_over_temperature_and_direction_is_modelled_with_its_values(tmp_path: Path) -> None:
    bump = {"at": 27.0, "width": 7.0, "change": 0.03}  # far above the noise: what follows it promises much, too
    told = diagnosed(tmp_path, 9207, {"bump_of_bias_over_gyro_temp_times_rate_sign": bump})
    assert models_of(told) == {"bump_of_bias_over_gyro_temp_times_rate_sign": ("bias", ("gyro_temp*rate_sign",))}
    assert told.findings == ()
    (model,) = told.unexplained.models
    assert {name: one.value for name, one in model.parameters.items()} == pytest.approx(bump, rel=0.02)
    assert told.fit.heldout_after < 1.05 * told.fit.noise


def test_a_bias_of_the_last_direction_is_found_where_the_table_stopped_out_of_sight(tmp_path: Path) -> None:
    told = diagnosed(tmp_path, 9211, {"positive_of_bias_over_last_sign": {"change": 4e-3}})
    (model,) = told.unexplained.models
    assert (model.stage, model.coordinates) == ("bias", ("rate_sign",))
    assert model.identifier.endswith("over_last_sign")
    assert told.findings == ()
    assert abs(model.parameters["change"].value) == pytest.approx(4e-3, rel=0.02)
    assert told.fit.heldout_after < 1.05 * told.fit.noise
    assert any("which way the table turned last" in note for note in told.notes)


@pytest.mark.long
def test_beside_an_exponential_of_the_temperature_rate_nothing_is_told_that_the_error_of_this_rate_leaves(
    tmp_path: Path,
) -> None:
    growth = {"change": 0.025, "at": 0.032, "width": 0.014}
    told = diagnosed(tmp_path, 9212, {"growth_of_bias_over_gyro_temp_rate": growth})
    assert told.findings == ()
    assert models_of(told) == {"rise_of_bias_over_gyro_temp_rate": ("bias", ("gyro_temp_rate",))}
    assert told.unexplained.models[0].parameters["tau"].value == pytest.approx(growth["width"], rel=0.01)
    assert told.fit.heldout_after < 0.1 * told.fit.heldout_before
