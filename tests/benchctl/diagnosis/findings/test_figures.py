"""The noise beside which residuals are stated: the recording's own, whatever the model misses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchctl.diagnosis.findings.figures import beyond_noise, figures_of, noise_of
from benchctl.diagnosis.gyro.points import points_problem
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import open_recording
from tests.benchctl.diagnosis.findings.test_not_found import selected
from tests.benchctl.diagnosis.toy_problem import NOISE_V, Squared, toy


@pytest.mark.parametrize("missed_v", [0.0, 0.3])
def test_the_noise_is_that_at_rest_however_much_a_model_misses_in_motion(missed_v: float) -> None:
    problem = toy(Squared(size_v=missed_v))
    assert noise_of(problem, selected(problem)) == pytest.approx(NOISE_V, rel=0.1)


def test_a_stop_within_a_step_at_rest_is_no_noise() -> None:
    stop_v = np.where(np.arange(toy().measured.size) % 100 < 20, 0.5 * np.arange(toy().measured.size) % 7, 0.0)
    problem = toy(added_v=stop_v)
    assert noise_of(problem, selected(problem)) == pytest.approx(NOISE_V, rel=0.15)


def test_of_points_it_is_what_replicates_of_a_rate_scatter_by(tmp_path: Path) -> None:
    rates = np.tile([-200.0, -100.0, 0.0, 100.0, 200.0], 40)
    volts = np.sin(0.004 * rates) + 0.008 * np.random.default_rng(1).standard_normal(rates.size)
    rows = "\n".join(f"{rate:g},{value:.6f}" for rate, value in zip(rates, volts, strict=True))
    (tmp_path / "points.csv").write_text(f"rate_dps,gyro_v_mean\n{rows}\n", encoding="utf-8")
    import_recording(tmp_path / "points.csv", None, tmp_path / "points.h5")
    with open_recording(tmp_path / "points.h5") as recording:
        problem = points_problem(recording)
        assert noise_of(problem, selected(problem)) == pytest.approx(0.008, rel=0.1)


def test_what_was_found_brings_held_out_residuals_down_to_the_noise() -> None:
    problem = toy(Squared(size_v=0.02))
    figures = figures_of(problem, selected(problem))
    assert figures.unit == "V"
    assert figures.heldout_before > 4.0 * NOISE_V
    assert figures.heldout_named == figures.heldout_after == pytest.approx(NOISE_V, rel=0.1)
    assert figures.after == pytest.approx(NOISE_V, rel=0.1)


def test_a_burst_that_follows_no_coordinate_is_not_said_to_agree() -> None:
    place = np.arange(toy().measured.size)
    moving = np.flatnonzero(np.array([kind != "static" for kind in toy().step_kinds])[toy().step])
    burst = (place > moving[40]) & (place < moving[80])
    problem = toy(added_v=np.where(burst, 3.0 * np.random.default_rng(2).standard_normal(place.size), 0.0))
    found = beyond_noise(problem, selected(problem))
    assert found is not None
    assert found.significant
    assert found.coordinates == ("time",)
    assert found.says.startswith("The residual is ")
    assert beyond_noise(toy(), selected(toy())) is None
