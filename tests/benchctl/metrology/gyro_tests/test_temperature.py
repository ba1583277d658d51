"""Scale factor and bias over temperature, and what they remember."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.benchctl.metrology.altered import results, stating
from tests.benchctl.metrology.short_plans import IDEAL, QUIET, soak, sweep

STRAIGHT = replace(IDEAL, white_v_per_sqrt_hz=1e-9)
TO_60 = [soak(20.0), *sweep(), soak(60.0), *sweep()]
THERE_AND_BACK = [soak(20.0), *sweep(), soak(60.0), *sweep(), soak(20.0), *sweep(), soak(-20.0), *sweep(), soak(20.0)]
NAMES = (
    "scale_factor_temperature",
    "bias_temperature",
    "hysteresis_temperature_scale",
    "hysteresis_temperature_bias",
)


def test_sensitivities_are_changes_per_degree() -> None:
    unit = replace(STRAIGHT, scale_per_c=-150e-6, bias_v_per_c=3e-5)
    found = results(TO_60, unit)
    assert found["scale_factor_temperature"].value == pytest.approx(150.0, rel=1e-3)
    assert found["bias_temperature"].value == pytest.approx(3600.0 * 3e-5 / 0.05, rel=1e-3)


def test_the_largest_change_per_degree_counts() -> None:
    unit = replace(STRAIGHT, bias_v_per_c=3e-5, bias_v_per_c2=-1e-6)
    steps = [*TO_60, soak(-20.0), *sweep()]
    found = results(steps, unit)["bias_temperature"]
    assert found.value == pytest.approx(3600.0 / 0.05 * (3e-5 + 1e-6 * 40.0), rel=1e-3)
    assert {note.key for note in found.notes} == set()


def test_the_thermometer_errs_anew_at_every_set_point() -> None:
    unit = replace(STRAIGHT, scale_per_c=-150e-6)
    found = results(TO_60, unit)["scale_factor_temperature"].uncertainty
    assert found is not None
    thermometer = {one.source: one.standard for one in found.contributors}["thermometer"]
    assert thermometer == pytest.approx(150.0 * 0.1 * 2**0.5 / 40.0, rel=0.01)


def test_set_points_that_are_near_the_reference_say_little_and_are_left_out() -> None:
    found = results([soak(20.0), *sweep(), soak(24.9), *sweep(50.0)], QUIET)
    assert found["scale_factor_temperature"].refused is not None
    assert found["scale_factor_temperature"].refused.key == "needs_set_points"


def test_hysteresis_is_the_difference_between_heating_and_cooling() -> None:
    unit = replace(STRAIGHT, thermal_scale=120e-6, thermal_bias_v=4e-4)
    found = results([*THERE_AND_BACK, *sweep()], unit)
    assert found["hysteresis_temperature_scale"].value == pytest.approx(120.0, rel=1e-3)
    assert found["hysteresis_temperature_bias"].value == pytest.approx(3600.0 * 4e-4 / 0.05, rel=1e-3)


def test_of_one_soak_the_last_stretch_counts_which_has_settled_best() -> None:
    steps = [*THERE_AND_BACK, *sweep(), soak(20.0), *sweep()]
    found = results(steps, QUIET)["hysteresis_temperature_scale"]
    assert found.steps[-1] == len(steps)


@pytest.mark.parametrize(
    ("steps", "refused"),
    [
        (
            [soak(20.0), *sweep()],
            dict.fromkeys(NAMES[:2], "needs_set_points") | dict.fromkeys(NAMES[2:], "needs_both_legs"),
        ),
        (TO_60, dict.fromkeys(NAMES[2:], "needs_both_legs")),
        ([soak(20.0), *sweep(100.0, 5), soak(60.0), *sweep(50.0, 3)], {NAMES[0]: "needs_rates"}),
        (
            [*sweep(), soak(20.0), *sweep(), soak(60.0), *sweep(), soak(20.0), *sweep(50.0, 3)],
            {NAMES[2]: "needs_both_legs", NAMES[3]: "needs_both_legs"},
        ),
    ],
    ids=["one-set-point", "one-leg", "no-common-rates", "first-soak-comes-from-nowhere"],
)
def test_what_is_lacking_is_said_and_the_rest_is_measured(steps: list, refused: dict[str, str]) -> None:
    found = results(steps, QUIET)
    for name, why in refused.items():
        assert found[name].refused is not None
        assert found[name].refused.key == why  # type: ignore[union-attr]


def test_a_bias_needs_no_common_rates() -> None:
    found = results([soak(20.0), *sweep(100.0, 5), soak(60.0), *sweep(50.0, 3)], QUIET)
    assert found["scale_factor_temperature"].value is None
    assert found["bias_temperature"].value is not None


def test_memories_of_stretches_without_common_rates_are_refused_for_the_scale_only() -> None:
    legs = [soak(0.0), *sweep(), soak(20.0), *sweep(100.0, 5), soak(60.0), *sweep(), soak(20.0), *sweep(50.0, 3)]
    found = results(legs, QUIET)
    assert found["hysteresis_temperature_scale"].refused is not None
    assert found["hysteresis_temperature_scale"].refused.key == "needs_rates"
    assert found["hysteresis_temperature_bias"].value is not None


def test_temperatures_that_nobody_knows_are_no_set_points() -> None:
    found = results(TO_60, QUIET, change=stating(chamber_setpoint_c=float("nan")))
    for name in NAMES:
        assert found[name].refused is not None or found[name].temperature_c is not None
    assert found["scale_factor"].value is not None
