"""Tables of static points: laws of a steady rate, from means alone."""

from pathlib import Path

import numpy as np
import pytest

from benchctl.diagnosis.gyro.points import has_points, points_problem
from benchctl.diagnosis.search.held_out import held_out_steps
from benchctl.diagnosis.search.select import select
from benchctl.estimation.fit import Point, fit
from benchctl.estimation.noise import Whitener
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effects.rate_nonlinearity import RateNonlinearity
from tests.shared import SHARED, needs_shared

RATES = np.array([-200, -160, -120, -80, -40, 0, 40, 80, 120, 160, 200, -100, -60, -20, 0, 20, 60, 100] * 2, float)
K0, U0, SCATTER_V = -0.057, 0.15, 0.008


def table(path: Path, volts, rates=RATES) -> Path:
    rows = [f"{rate:g},{value:.6f}" for rate, value in zip(rates, volts, strict=True)]
    path.write_text("rate_dps,gyro_v_mean\n" + "\n".join(rows) + "\n", encoding="utf-8")
    recording = path.with_suffix(".h5")
    import_recording(path, None, recording)
    return recording


def scattered(seed):
    return SCATTER_V * np.random.default_rng(seed).standard_normal(RATES.size)


def found(problem):
    chosen = select(problem, seed=0, progress=lambda _name, _share: None)
    return {effect.identifier: effect.values for effect in chosen.after.point.effects}, chosen


def test_an_interferometers_sine_is_found_in_a_table_of_means(tmp_path):
    S = 0.0045
    with open_recording(table(tmp_path / "sine.csv", U0 + K0 / S * np.sin(S * RATES) + scattered(1))) as recording:
        assert has_points(recording)
        problem = points_problem(recording)
    effects, chosen = found(problem)
    assert list(effects) == ["rate_nonlinearity"]
    law = effects["rate_nonlinearity"]
    at = np.array([100.0, 200.0])
    np.testing.assert_allclose(1 + law["c2"] * at**2 + law["c4"] * at**4, np.sin(S * at) / (S * at), atol=3e-3)
    assert not problem.believed
    assert chosen.after.deviation == pytest.approx(SCATTER_V, rel=0.4)


@pytest.mark.parametrize("seed", range(8))
def test_in_a_straight_line_nothing_is_found(seed, tmp_path):
    with open_recording(table(tmp_path / "line.csv", U0 + K0 * RATES + scattered(seed))) as recording:
        effects, _ = found(points_problem(recording))
    assert effects == {}


def test_points_at_rest_that_lie_apart_are_said_to_be_unexplained(tmp_path):
    volts = U0 + K0 * RATES + scattered(3)
    with open_recording(table(tmp_path / "rest.csv", np.where(RATES == 0.0, volts - 0.05, volts))) as recording:
        problem = points_problem(recording)
    whitener = Whitener(interval_s=1.0, weight=problem.usable.astype(float))
    everything = np.ones(len(problem.steps), np.bool_)
    fitted = fit(problem, whitener, Point(baseline=problem.baseline_start), everything)
    *_, said = problem.remarks(fitted.residual, fitted.residual, ~everything)
    assert "points at rest lie" in said
    assert "is left unexplained" in said


def test_of_temperature_and_time_nothing_is_tried_where_nothing_is_known(tmp_path):
    with open_recording(table(tmp_path / "line.csv", U0 + K0 * RATES)) as recording:
        problem = points_problem(recording)
    assert set(problem.effects) == {
        "dead_zone",
        "fringe_ambiguity",
        "rate_nonlinearity",
        "rate_squared",
        "saturation",
        "scale_asymmetry",
        "two_rails",
    }
    whole = problem.predict(problem.baseline_start, (RateNonlinearity(c2=0.0, c4=0.0, range_dps=200.0),))
    np.testing.assert_allclose(whole, problem.measured, atol=1e-6)


def test_a_model_of_another_form_is_refused(tmp_path):
    with (
        open_recording(table(tmp_path / "line.csv", U0 + K0 * RATES)) as recording,
        pytest.raises(UsageError, match="T0_c is missing"),
    ):
        points_problem(recording, model={"K0_v_per_dps": K0, "U0_v": U0, "k_T": [], "k_omega": []})


@needs_shared("data/vg910/unit1_static_points.csv")
def test_the_points_of_a_real_gyro_are_a_sine_and_rest_is_left_over(tmp_path):
    recording = tmp_path / "unit1.h5"
    import_recording(SHARED / "data" / "vg910" / "unit1_static_points.csv", None, recording)
    with open_recording(recording) as opened:
        problem = points_problem(opened)
    effects, chosen = found(problem)
    held = held_out_steps(problem)
    law = effects["rate_nonlinearity"]
    assert 1 + law["c2"] * 200.0**2 + law["c4"] * 200.0**4 == pytest.approx(0.884, abs=0.004)
    scale = abs(problem.simulation["K0_v_per_dps"])
    before, after = (np.sqrt(np.mean(one.residual[held] ** 2)) / scale for one in (chosen.before, chosen.after))
    assert before > 2.0
    assert after < 0.35
    remarks = problem.remarks(chosen.before.residual, chosen.after.residual, held)
    assert any("points at rest lie" in said and "unexplained" in said for said in remarks)
