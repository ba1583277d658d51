"""The whole calibration on campaigns whose truth is known, and on recordings that cannot support all of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from benchctl.calibration.calibrate import calibrate
from benchctl.calibration.result import CalibrationOptions
from benchctl.recordings.model import Step
from benchctl_instruments.errors import UsageError
from tests.benchctl.calibration.campaigns import TRUTH, calibrated, recorded
from tests.benchctl.calibration.synthetic import Ask, meta_of, steps

META = meta_of(TRUTH)


def only(kept: Iterable[Step], **wanted: object) -> list[Step]:
    return [step for step in kept if all(getattr(step.info, name) == value for name, value in wanted.items())]


def test_every_parameter_of_the_truth_is_found() -> None:
    fit, truth = calibrated().best, TRUTH.named()
    assert fit.law == "sine"
    assert {parameter.name for parameter in fit.parameters} == set(truth)
    for parameter in fit.parameters:
        assert abs(parameter.value - truth[parameter.name]) < 4 * parameter.standard, parameter.name
    assert fit.noise.white_v == pytest.approx(TRUTH.white, rel=0.3)
    assert fit.noise.random_walk_v_per_sqrt_s == pytest.approx(TRUTH.walk, rel=0.7)


def test_the_error_goes_down_from_level_to_level() -> None:
    error = calibrated().error_percent
    assert 7 < error["raw"] < 10
    assert error["stage_1"] < 1.0
    assert error["stage_2"] <= 0.7
    assert error["joint"] == error["joint_sine"] <= 0.1
    assert error["raw"] > error["stage_1"] > error["stage_2"] > error["joint_sine"]


def test_the_first_stage_finds_an_inverse_sine() -> None:
    first = calibrated().stages[0]
    assert first.k_omega.coefficients[0] == pytest.approx(TRUTH.S**2 / 6, rel=0.3)
    assert first.k_t.coefficients[0] == pytest.approx(-TRUTH.g[0], rel=0.1)
    assert first.u0_t[0] == pytest.approx(TRUTH.c[0], rel=0.1)
    assert first.K0_v_per_dps == pytest.approx(0.050 * (1 - 0.0049), rel=1e-3)


def test_the_second_stage_finds_the_delay_and_says_that_it_did_the_work() -> None:
    second = calibrated().stages[1]
    assert second.delay_s == pytest.approx(TRUTH.delay, abs=3e-6)
    shares = {share.part: share.share for share in second.shares}
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-6)
    assert shares["delay"] > 0.7
    assert second.error_percent.before == calibrated().error_percent["stage_1"]
    assert second.error_percent.after == calibrated().error_percent["stage_2"]


def test_no_fit_sees_the_runs_that_were_kept_aside() -> None:
    spoiled = [
        Step(step.info, {**step.channels, "gyro_v": step["gyro_v"] * 1.5}) if step.info.role == "verify" else step
        for step in recorded()
    ]
    result = calibrate(spoiled, META)
    assert [p.value for p in result.best.parameters] == [p.value for p in calibrated().best.parameters]
    assert result.stages[1].K0_v_per_dps == calibrated().stages[1].K0_v_per_dps
    assert result.error_percent["joint"] > 40


def test_outliers_hardly_move_a_robust_fit() -> None:
    rng = np.random.default_rng(9)
    spiked = []
    for step in recorded():
        volts = step["gyro_v"].copy()
        if step.info.kind == "sine":
            volts[rng.integers(0, volts.size, 12)] += rng.choice([-2.0, 2.0], 12)
        spiked.append(Step(step.info, {**step.channels, "gyro_v": volts}))
    robust = calibrate(spiked, META, CalibrationOptions(law="sine")).best
    plain = calibrate(spiked, META, CalibrationOptions(law="sine", robust=False)).best
    assert abs(robust.value("delay_s") - TRUTH.delay) < 4 * robust.parameter("delay_s").standard
    assert robust.parameter("delay_s").standard < 0.2 * plain.parameter("delay_s").standard


def test_without_marked_runs_some_are_kept_aside_and_it_says_so() -> None:
    unmarked = [Step(replace(step.info, role="fit"), step.channels) for step in recorded()]
    result = calibrate(unmarked, META)
    assert any("kept aside by the calibration" in note for note in result.notes)
    assert result.error_percent["joint"] <= 0.1
    assert any(run.role == "verify" for run in result.runs)


def test_without_runs_kept_aside_no_error_is_reported() -> None:
    result = calibrate(only(recorded(), role="fit"), META, CalibrationOptions(hold_out=False))
    assert result.error_percent == {}
    assert result.stages[0].error_percent.after is None
    assert any("would flatter" in warning for warning in result.warnings)


def test_one_temperature_gives_a_reduced_fit_and_plain_sentences() -> None:
    result = calibrate(only(recorded(), chamber_setpoint_c=20.0), META)
    assert result.stages[0].k_t.coefficients == ()
    assert any("k(T) is left out" in warning for warning in result.warnings)
    assert result.best.value("S_rad_per_dps") == pytest.approx(TRUTH.S, rel=1e-4)


def test_without_motion_runs_stage_two_and_delay_are_left_out() -> None:
    result = calibrate([step for step in recorded() if step.info.kind != "sine"], META)
    assert len(result.stages) == 1
    assert any("Stage 2 is left out" in warning for warning in result.warnings)
    assert "delay_s" not in [parameter.name for parameter in result.best.parameters]
    assert result.best.value("S_rad_per_dps") == pytest.approx(TRUTH.S, rel=1e-3)


def test_slow_rates_alone_give_no_curvature() -> None:
    asks = [Ask(kind="constant_rate", temperature=20, rate=rate, seconds=20) for rate in (-40, -20, 20, 40)]
    result = calibrate(steps(TRUTH, asks, 3), META)
    assert result.stages[0].k_omega.coefficients == ()
    assert any("k(ω) is left out" in warning for warning in result.warnings)
    assert result.best.value("K0_v_per_dps") == pytest.approx(TRUTH.K0, rel=0.01)


def test_sines_without_constant_rates_are_calibrated_too() -> None:
    result = calibrate(only(recorded(), kind="sine"), META)
    assert any("no two constant rates" in warning for warning in result.warnings)
    assert result.best.value("S_rad_per_dps") == pytest.approx(TRUTH.S, rel=1e-4)


@pytest.mark.parametrize("gyro_v", [0.0, 0.25])
def test_an_output_that_is_the_same_at_every_rate_is_refused(gyro_v: float) -> None:
    dead = [
        Step(step.info, {**step.channels, "gyro_v": np.full_like(step["gyro_v"], gyro_v)})
        for step in only(recorded(), kind="sine")
    ]
    with pytest.raises(UsageError, match=rf"gyro_v is {gyro_v:g} at every rate; check that the gyro is powered"):
        calibrate(dead, META)


@pytest.mark.parametrize(
    ("asks", "says"),
    [
        ([Ask(kind="static", temperature=20, seconds=20)], "no motion"),
        ([], "no step that can be used"),
        ([Ask(kind="constant_rate", temperature=20, rate=30, seconds=20)], "record a rate sweep"),
    ],
)
def test_nothing_to_be_fitted_is_said_in_one_line(asks: list[Ask], says: str) -> None:
    with pytest.raises(UsageError, match=says) as caught:
        calibrate(steps(TRUTH, asks, 1), META)
    assert "\n" not in str(caught.value)


def test_an_unknown_latitude_is_a_warning_and_part_of_the_bias() -> None:
    blind = replace(META, bench=replace(META.bench, latitude_deg=None))
    result = calibrate(recorded(), blind, CalibrationOptions(law="sine"))
    assert any("latitude" in warning for warning in result.warnings)
    moved = result.best.value("U0_v") - calibrated().best.value("U0_v")
    assert moved == pytest.approx(TRUTH.K0 * TRUTH.earth, rel=0.1)


def test_a_gyro_of_the_other_sign_calibrates_alike() -> None:
    turned = [Step(step.info, {**step.channels, "gyro_v": -step["gyro_v"]}) for step in recorded()]
    result = calibrate(turned, META)
    assert result.best.value("K0_v_per_dps") == pytest.approx(-TRUTH.K0, rel=1e-5)
    assert result.error_percent["joint"] <= 0.1


@pytest.mark.slow
def test_chosen_orders_are_named_and_do_no_harm() -> None:
    result = calibrate(recorded(), META, CalibrationOptions(law="polynomial", orders_1=(1, 2), choose_orders=True))
    assert any("Orders chosen on runs left out" in warning for warning in result.warnings)
    assert result.error_percent["joint"] <= 0.5


def test_an_order_out_of_range_is_refused() -> None:
    with pytest.raises(UsageError, match="expected orders from 0 to 4"):
        CalibrationOptions(orders_1=(2, 9))
