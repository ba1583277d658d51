from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from benchctl.diagnosis.earth_rate import other_answer, plainly_better
from benchctl.diagnosis.gyro.problem import GyroProblem, gyro_problem
from benchctl.diagnosis.search.select import select, select_between
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import Fit, Point, fit
from benchctl.estimation.noise import Whitener
from benchctl.estimation.noise_model import NoiseModel
from benchctl_instruments.physics.effects.dead_zone import DeadZone
from benchctl_instruments.physics.effects.rate_squared import RateSquared
from tests.benchctl.diagnosis.foreign import draw, make, to_recording

NOISE_V = 2e-5
"""Low enough for the Earth's rate to show in the bend of the scale factor."""

BEND = -0.1
"""What the scale factor loses at the rated range."""

EARTH_DPS = 0.0036


@lru_cache
def felt() -> GyroProblem:
    """A gyro that feels the Earth's rate and bends; nothing is missing, and no noise is in it yet."""
    problem = gyro_problem(to_recording(*make(draw("null", 1), 1)))
    law = replace(problem.chain.law, temperature_terms=0, rate_terms=1)
    simulation = {**problem.simulation, "k_T": [], "k_omega": [BEND / problem.range_dps**2]}
    chain = replace(problem.chain, law=law, earth_dps=EARTH_DPS, _volts={}, _kept={})
    return replace(problem, chain=chain, simulation=simulation, earth_dps=EARTH_DPS)


def put_out(*, earth: bool, effects: tuple[RateSquared | DeadZone, ...] = ()) -> GyroProblem:
    """The problem of a recording that does hold the Earth's rate, or does not."""
    problem = felt()
    source = problem if earth else problem.otherwise()
    assert source is not None
    volts = source.predict(problem.baseline_start, effects)
    volts = volts + NOISE_V * np.random.default_rng(3).standard_normal(volts.size)
    frame = replace(problem.frame, volts=volts)
    return replace(problem, frame=frame, chain=replace(problem.chain, frame=frame, _volts={}, _kept={}))


def chosen(problem: GyroProblem) -> Selection:
    return select(problem, seed=0, progress=lambda _name, _share: None)


@pytest.mark.slow
def test_a_recording_that_holds_the_earths_rate_keeps_it_and_nothing_is_found() -> None:
    problem = put_out(earth=True)
    found = chosen(problem)
    assert found.after.point.effects == ()
    assert other_answer(problem, found) is None


@pytest.mark.slow
def test_a_recording_without_the_earths_rate_is_told_from_one_with_it() -> None:
    problem = put_out(earth=False)
    found = chosen(problem)
    other = other_answer(problem, found)
    assert isinstance(other, GyroProblem)
    assert other.chain.earth_dps == 0.0
    assert chosen(other).after.point.effects == ()
    assert "shows no Earth rate" in " ".join(other.remarks(*[np.zeros(0)] * 3))


@pytest.mark.slow
def test_an_effect_that_looks_like_the_earths_rate_but_is_larger_is_no_reason_to_leave_it_out() -> None:
    problem = put_out(earth=True, effects=(RateSquared(v_per_dps2=1e-7),))
    found = chosen(problem)
    (effect,) = found.after.point.effects
    assert isinstance(effect, RateSquared)
    assert effect.v_per_dps2 == pytest.approx(1e-7, rel=0.05)
    assert other_answer(problem, found) is None


def test_where_the_place_is_not_stated_there_is_no_question() -> None:
    problem = replace(put_out(earth=False), earth_dps=0.0)
    assert problem.otherwise() is None


def bare(problem: GyroProblem) -> Fit:
    """The fit of the baseline to all steps but one in four."""
    steps = np.arange(len(problem.step_names)) % 4 > 0
    return fit(problem, NoiseModel.of(problem).plain, Point(baseline=problem.baseline_start), steps)


@pytest.mark.parametrize(("holds", "is_better"), [(True, False), (False, True)])
def test_a_model_as_it_is_tells_whether_the_other_answer_is_better(holds: bool, is_better: bool) -> None:
    problem = put_out(earth=holds)
    fitted = bare(problem)
    other = plainly_better(problem, fitted, fitted.whitener)
    assert (other is not None) == is_better
    if other is not None:
        assert isinstance(other, GyroProblem)
        assert other.chain.earth_dps == 0.0


def test_one_step_tells_what_a_fit_of_the_other_answer_gains() -> None:
    """Just beyond chance it is better, and just not beyond it is not."""
    problem = put_out(earth=False)
    fitted, other = bare(problem), problem.otherwise()
    assert other is not None
    everything = np.ones(len(problem.step_names), np.bool_)
    one, two = (fit(each, fitted.whitener, fitted.point, everything) for each in (problem, other))
    gained = (one.squares - two.squares) / fitted.deviation**2
    for beyond, expected in ((gained * 1.01, False), (gained * 0.99, True)):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("benchctl.diagnosis.earth_rate.BEYOND_CHANCE", beyond)
            assert (plainly_better(problem, fitted, fitted.whitener) is not None) == expected


def test_where_there_is_no_question_nothing_is_better() -> None:
    problem = replace(put_out(earth=False), earth_dps=0.0)
    fitted = bare(problem)
    assert plainly_better(problem, fitted, fitted.whitener) is None


@pytest.mark.slow
def test_a_search_that_learns_the_other_answer_ends_as_one_that_knew_it() -> None:
    """What had been found by then stood for the Earth's rate, and goes; with what is left it is asked once more."""
    problem = put_out(earth=False)
    other = problem.otherwise()
    assert other is not None
    asked: list[int] = []

    def learns(one: PartProblem, fitted: Fit, _white: Whitener) -> PartProblem | None:
        asked.append(len(fitted.point.effects))
        return other if one is problem else None

    ends_with, found = select_between(problem, learns, seed=0, progress=lambda _name, _share: None)
    assert asked == [1, 0]
    assert isinstance(ends_with, GyroProblem)
    assert ends_with.chain.earth_dps == 0.0
    known = chosen(other)
    assert found.after.point.effects == known.after.point.effects == ()
    np.testing.assert_allclose(found.full.point.baseline, known.full.point.baseline, rtol=1e-6)
