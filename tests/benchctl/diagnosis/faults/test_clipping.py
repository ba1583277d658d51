from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.benchctl.diagnosis.faults.made import FULL_V, STEP_V, made, motion


@pytest.mark.parametrize("below", [0.004, 0.02, 0.25])
@pytest.mark.parametrize("bits", [0, 3])
def test_an_exact_plateau_below_the_rated_limit_is_a_rail(below: float, bits: int) -> None:
    limit_v = FULL_V * (1.0 - below)
    faults = made(clipped_v=limit_v, step_v=STEP_V * 2**bits).faults()
    fault = next(one for one in faults.found if one.effect == "saturation")
    assert "dropouts" not in {one.effect for one in faults.found}
    limit = fault.parameters["limit_v"]
    assert limit.low <= limit_v <= limit.high
    assert limit.high - limit.low < 1.1 * STEP_V * 2**bits
    beyond = np.abs(motion()) > limit_v + 3e-3
    assert not (beyond & ~faults.standing).any()


def test_a_rail_on_one_side_is_found_and_the_other_side_left() -> None:
    free = made()
    railed = replace(free, volts=np.minimum(free.volts, np.round(np.rint(1.5 / STEP_V) * STEP_V, 6)))
    (fault,) = railed.faults().found
    assert fault.effect == "saturation"
    assert fault.parameters["limit_v"].value == pytest.approx(1.5, abs=STEP_V)
    assert not fault.rows[railed.predicted < -1.6].any()


def test_limits_of_different_size_are_two_rails() -> None:
    free = made()
    lower, upper = (np.round(np.rint(volts / STEP_V) * STEP_V, 6) for volts in (-1.2, 1.5))
    (fault,) = replace(free, volts=np.clip(free.volts, lower, upper)).faults().found
    assert fault.effect == "two_rails"
    for name, volts in (("lower_v", lower), ("upper_v", upper)):
        rail = fault.parameters[name]
        assert rail.low <= volts <= rail.high
        assert rail.high - rail.low < 1.1 * STEP_V


def test_a_plateau_with_noise_on_it_is_left_to_the_fit() -> None:
    chance = np.random.default_rng(3)
    clean = np.clip(motion(), -1.6, 1.6)
    volts = np.round(np.rint((clean + 5e-4 * chance.standard_normal(clean.size)) / STEP_V) * STEP_V, 6)
    assert replace(made(), volts=volts).faults().found == ()


def test_spikes_beyond_the_rail_do_not_hide_it_and_holds_elsewhere_are_held() -> None:
    railed = made(clipped_v=1.6)
    volts = railed.volts.copy()
    volts[2345::977] += 0.3
    faults = replace(railed, volts=volts).held([300, 9000, 20_000], 80).faults()
    assert {one.effect for one in faults.found} == {"saturation", "dropouts"}
    holds = next(one for one in faults.found if one.effect == "dropouts")
    assert holds.parameters["count"].low == 3
