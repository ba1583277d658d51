"""The five points of the paper as numbers."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.calibration.paper_audit import audit, implied_sine, indicated
from tests.benchctl.calibration.campaigns import TRUTH, recorded
from tests.benchctl.calibration.synthetic import meta_of


def test_the_five_points_have_the_published_numbers() -> None:
    one, two, three, four, five = (point.computed for point in audit().points)
    assert one["k_as_printed_percent"] == pytest.approx(1.16, abs=0.005)
    assert one["with_slope_over_40_percent"] == pytest.approx(0.86, abs=0.05)
    assert two["x_at_8_percent_dps"] == pytest.approx(139, abs=1)
    assert two["x_at_10_percent_dps"] == pytest.approx(151, abs=1)
    assert 0.00448 <= three["S_rad_per_dps"] <= 0.00452
    assert three["largest_misfit_percent"] < 0.13
    assert four["k1_at_20_c_percent"] == pytest.approx(0.180, abs=0.001)
    assert four["k1_k2_at_20_c_percent"] == pytest.approx(0.347, abs=0.001)
    assert five["at_150_and_20_c_percent"] == pytest.approx(0.398, abs=0.001)
    assert five["at_150_and_85_c_percent"] == pytest.approx(1.11, abs=0.01)


def test_the_verdicts_carry_their_numbers() -> None:
    for point in audit().points:
        assert any(character.isdigit() for character in point.verdict)
        assert "\n" not in point.verdict


def test_the_indication_of_the_paper_is_the_fixed_point_of_its_polynomial() -> None:
    x = indicated(np.array([150.0]))[0]
    assert x * (1 + 3.02e-6 * x**2 + 5.89e-11 * x**4) == pytest.approx(150)


def test_the_implied_sine_hardly_depends_on_the_range() -> None:
    assert implied_sine(181.0)[0] == pytest.approx(implied_sine(160.0)[0], rel=0.01)


def test_the_redone_experiment_stands_beside_the_paper() -> None:
    result = audit(recorded(), meta_of(TRUTH))
    ours = {row.quantity: row.ours for row in result.rows}
    assert ours["S of the sine law"] == pytest.approx(TRUTH.S, rel=1e-5)
    assert ours["error after stage 2"] is not None
    assert ours["error after stage 2"] < 0.7
    assert ours["stage 2, delay"] == pytest.approx(TRUTH.delay, rel=0.01)
    assert {row.paper for row in result.rows} >= {"8–10", "3–4", "0.7", "3.02e-6"}
