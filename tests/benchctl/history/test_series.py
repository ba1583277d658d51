"""Drift between campaigns, and what is flagged."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.benchctl.history.made_history import (
    accepted,
    campaign,
    digest_in,
    figure,
    one_test,
    only,
    read,
    recorded,
    started,
)


def test_drift_uncertainty_and_e_n_by_hand(tmp_path: Path) -> None:
    for number, (value, expanded) in enumerate([(10.0, 0.4), (10.2, 0.3), (10.9, 0.4)]):
        campaign(tmp_path, number=number, K0=value, U=expanded)
    found = figure(read(tmp_path))
    assert found.drift is not None
    assert found.drift_since_first is not None
    assert found.drift.difference == pytest.approx(0.7)
    assert found.drift.uncertainty == pytest.approx(0.5)
    assert found.drift.e_n == pytest.approx(1.4)
    assert found.drift.since.started_utc == started(1)
    assert found.drift_since_first.difference == pytest.approx(0.9)
    assert found.drift_since_first.e_n == pytest.approx(0.9 / (0.4**2 + 0.4**2) ** 0.5)
    assert found.drift_since_first.since.campaign == "000_SN-1/recording.h5"
    assert [flag.kind for flag in found.flags] == ["drift", "drift"]
    assert found.flags[0].says == f"drifted since the last calibration, {started(1)[:10]} (E_n = 1.4)"


def test_a_difference_within_its_uncertainty_is_no_drift(tmp_path: Path) -> None:
    for number, value in enumerate([10.0, 10.49]):
        campaign(tmp_path, number=number, K0=value, U=0.5 / 2**0.5)
    found = figure(read(tmp_path))
    assert found.drift is not None
    assert found.drift.e_n == pytest.approx(0.98)
    assert found.flags == ()


def test_without_an_uncertainty_there_is_a_difference_and_no_e_n(tmp_path: Path) -> None:
    campaign(tmp_path, number=0, K0=1.0)
    campaign(tmp_path, number=1, K0=2.0, U=None)
    found = figure(read(tmp_path))
    assert found.drift is not None
    assert (found.drift.difference, found.drift.uncertainty, found.drift.e_n) == (1.0, None, None)
    assert found.flags == ()


def test_a_test_has_drifted_since_the_last_campaign_with_a_calibration(tmp_path: Path) -> None:
    for number, (bias, K0) in enumerate([(1.0, 0.05), (2.0, None), (3.0, None)]):
        place = campaign(tmp_path, number=number, K0=K0)
        (place / "acceptance.json").write_text(accepted([one_test(value=bias)], digest_in(place)))
    found = figure(read(tmp_path), "bias")
    assert found.drift is not None
    assert found.drift.since.started_utc == started(0)
    (tmp_path / "000_SN-1" / "coefficients.json").unlink()
    found = figure(read(tmp_path), "bias")  # none was calibrated: since the one before
    assert found.drift is not None
    assert found.drift.since.started_utc == started(1)
    assert found.flags[0].says.startswith("drifted since the last campaign, ")


def test_two_campaigns_of_one_second_are_in_the_order_of_their_paths(tmp_path: Path) -> None:
    for rows, name in enumerate(("b", "a", "c"), 20):
        recorded(tmp_path / name / "recording.h5", rows=rows)
    assert [one.path[0] for one in only(read(tmp_path)).campaigns] == ["a", "b", "c"]


def test_starts_are_put_in_order_as_moments_whatever_their_offset(tmp_path: Path) -> None:
    recorded(tmp_path / "late.h5", started_utc="2026-01-01T10:00:00+00:00")
    recorded(tmp_path / "early.h5", started_utc="2026-01-01T12:00:00+03:00")
    (unit,) = read(tmp_path).units
    assert [one.path for one in unit.campaigns] == ["early.h5", "late.h5"]
    assert unit.campaigns[0].started_utc == "2026-01-01T09:00:00+00:00"


def test_a_bound_is_shown_and_never_reckoned_with(tmp_path: Path) -> None:
    for number, bound in enumerate(["at most", "", "at most"]):
        place = campaign(tmp_path, number=number)
        (place / "acceptance.json").write_text(accepted([one_test(value=1.0 + number, bound=bound)], digest_in(place)))
    found = figure(read(tmp_path), "bias")
    assert [point.value for point in found.series.points] == [1.0, 2.0, 3.0]
    assert [point.value for point in found.series.known] == [2.0]
    assert found.drift is None


def test_an_outlier_a_step_and_a_failure_are_flagged(tmp_path: Path) -> None:
    outlier = [0.05, 0.0501, 0.05, 0.0501, 0.05, 0.0501, 0.05, 0.09]
    step = [0.05, 0.0501] * 4 + [0.0504, 0.0505] * 4
    for number, value in enumerate(outlier):
        campaign(tmp_path, "outlier", number, value, None)
    for number, value in enumerate(step):
        campaign(tmp_path, "step", number, value, None)
    place = campaign(tmp_path, "fails", 0)
    test = one_test(verdict="FAIL", limit={"low": None, "high": 0.5, "unit": "deg/h"})
    (place / "acceptance.json").write_text(accepted([test], digest_in(place), "FAIL"))
    history = read(tmp_path)
    flags = figure(history, serial="outlier").flags
    assert [(flag.kind, flag.campaign) for flag in flags] == [("outside_limits", "007_outlier/recording.h5")]
    flags = figure(history, serial="step").flags
    assert [flag.kind for flag in flags if flag.kind == "run_on_one_side"] == ["run_on_one_side"] * 2
    failing = figure(history, "bias", "fails")
    assert [flag.kind for flag in failing.flags] == ["fails"]
    assert (failing.series.latest.low, failing.series.latest.high) == (None, 0.5)


def test_a_unit_apart_from_its_siblings_is_flagged_and_another_model_is_none(tmp_path: Path) -> None:
    for number, value in enumerate([0.05, 0.0501, 0.0502, 0.0503, 0.06]):
        campaign(tmp_path, f"SN-{number}", number, value)
    digest = recorded(tmp_path / "other" / "recording.h5", "other", started(0), model="OTHER")
    (tmp_path / "other" / "coefficients.json").write_text(
        (tmp_path / "000_SN-0" / "coefficients.json").read_text().replace(digest_in(tmp_path / "000_SN-0"), digest)
    )
    history = read(tmp_path)
    flagged = {unit.serial for unit in history.units for one in unit.figures if one.flags}
    assert flagged == {"SN-4"}
    assert figure(history, serial="SN-4").flags[0].kind == "apart_from_siblings"
    assert figure(history, serial="other").siblings is None
