"""Repeatability over turn-ons."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from benchctl.metrology.acceptance import measured_in
from benchctl.metrology.observations import Settings
from benchctl.plan import PowerCycle, Static, Step, turn_ons
from tests.benchctl.metrology.altered import altered, results, stating
from tests.benchctl.metrology.made_unit import recorded
from tests.benchctl.metrology.short_plans import IDEAL, QUIET, soak, sweep

NAMES = ("scale_factor_repeatability", "bias_repeatability")


def cycles(count: int) -> list[Step]:
    return list(turn_ons((25.0, 50.0), count, off_s=600.0, warm_s=3000.0, at_least_s=30.0, zero_s=60.0))


def test_it_is_the_deviation_of_the_turn_ons_that_there_were() -> None:
    recording, made = recorded([soak(), *cycles(6)], QUIET, 4, errors=False)
    found = {one.name: one for one in measured_in(recording, Settings())}
    scales, biases = np.array(made.turn_ons).T
    assert found[NAMES[0]].value == pytest.approx(1e6 * np.std(1 + scales, ddof=1) / np.mean(1 + scales), rel=1e-5)
    slope = found["scale_factor"].value
    assert slope is not None
    assert found[NAMES[1]].value == pytest.approx(3600.0 * np.std(biases, ddof=1) / (1e-3 * slope), rel=1e-4)
    turned_on = next(column for column in found[NAMES[0]].table if column.name == "turn_on")
    assert turned_on.values == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


def test_what_other_cycles_may_show_is_said() -> None:
    found = results([soak(), *cycles(5)], QUIET)[NAMES[0]]
    (note,) = found.notes
    value = found.value
    assert value is not None
    expected = [value * np.sqrt(4 / chi2.ppf(share, 4)) for share in (0.975, 0.025)]
    assert note.values == {"cycles": 5, "low": pytest.approx(expected[0]), "high": pytest.approx(expected[1])}


def test_the_sweep_before_the_first_power_cycle_is_a_turn_on_too() -> None:
    found = results([soak(), *sweep(50.0, 2), *cycles(2)], QUIET)[NAMES[0]]
    assert found.notes[0].values["cycles"] == 3


@pytest.mark.slow
def test_an_ideal_unit_cannot_be_told_from_a_perfect_one() -> None:
    found = results([soak(), *cycles(6)], IDEAL)
    for name in NAMES:
        assert found[name].uncertainty is not None
        assert found[name].uncertainty.says.key == "not_told_from_zero"  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("steps", "refused"),
    [
        ([soak(), *cycles(2)], dict.fromkeys(NAMES, "needs_power_cycles")),
        ([soak(), *sweep(), soak(60.0), *cycles(6)], dict.fromkeys(NAMES, "needs_power_cycles")),  # elsewhere
        (
            [soak(), *sweep(50.0, 5), *[*(PowerCycle(off_s=9.0), Static(duration_s=9.0), *sweep(44.0, 3))] * 3],
            {NAMES[0]: "needs_rates"},
        ),
        ([soak(), *[*(PowerCycle(off_s=9.0), *sweep(50.0, 2)[1:-1])] * 3], {NAMES[1]: "needs_rest"}),
    ],
    ids=["too-few", "other-temperature", "no-common-rates", "no-rest"],
)
def test_what_is_lacking_is_said(steps: list, refused: dict[str, str]) -> None:
    found = results(steps, QUIET)
    for name, why in refused.items():
        assert found[name].refused is not None
        assert found[name].refused.key == why  # type: ignore[union-attr]


def test_set_points_that_nobody_states_are_one_temperature() -> None:
    recording, _ = recorded(cycles(4), QUIET, 4, errors=False)
    nowhere = altered(recording, stating(chamber_setpoint_c=float("nan")))
    found = {one.name: one for one in measured_in(nowhere, Settings())}
    assert all(found[name].value is not None for name in NAMES)
