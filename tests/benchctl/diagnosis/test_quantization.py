"""A converter whose steps stand out of the noise: they are taken off, and are no wave of the converter's."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from benchctl.diagnosis.gyro.problem import GyroProblem, gyro_problem
from benchctl.diagnosis.quantization import unrounded, without_the_steps_own
from benchctl.diagnosis.search.select import select
from benchctl.diagnosis.search.selection import Selection
from benchctl_instruments.physics.effects.adc_nonlinearity import AdcNonlinearity
from benchctl_instruments.physics.effects.registry import effects as vocabulary
from tests.benchctl.diagnosis.foreign import draw, make, to_recording

NOISE_V = 1e-3
STEP_V = 0.015
WAVE = AdcNonlinearity(inl_v=2e-3, period_v=1.3)
TRIED = {"adc_nonlinearity", "dead_zone", "rate_squared", "scale_asymmetry"}


@lru_cache
def sound() -> GyroProblem:
    """A recording in which nothing is missing, and few hypotheses to try."""
    return gyro_problem(to_recording(*make(draw("null", 1), 1)), without=set(vocabulary()) - TRIED)


def converted(step_v: float, *effects: AdcNonlinearity) -> GyroProblem:
    """A sound gyro's recording through a converter of such steps."""
    problem = sound()
    volts = problem.predict(problem.baseline_start, effects)
    volts = volts + NOISE_V * np.random.default_rng(3).standard_normal(volts.size)
    frame = replace(problem.frame, volts=step_v * np.rint(volts / step_v))
    return replace(problem, frame=frame, chain=replace(problem.chain, frame=frame, _volts={}, _kept={}))


def chosen(problem: GyroProblem, rounding_v2: float = 0.0) -> Selection:
    return select(problem, seed=0, progress=lambda _name, _share: None, rounding_v2=rounding_v2)


@pytest.mark.slow
def test_steps_that_stand_out_of_the_noise_are_taken_off_and_nothing_is_found_in_what_is_left() -> None:
    problem = converted(STEP_V)
    first = chosen(problem, STEP_V**2 / 12.0)
    smooth = unrounded(problem, first, STEP_V)
    assert smooth is not None
    left = without_the_steps_own(smooth, chosen(smooth), STEP_V)
    assert left.after.point.effects == ()
    assert left.after.deviation < 0.7 * first.after.deviation


@pytest.mark.slow
def test_a_wave_that_the_converter_does_have_is_found_all_the_same() -> None:
    problem = converted(STEP_V, WAVE)
    found = chosen(problem, STEP_V**2 / 12.0)
    for _ in range(2):
        smooth = unrounded(problem, found, STEP_V)
        assert smooth is not None
        problem, found = smooth, chosen(smooth)
    (wave,) = found.after.point.effects
    assert isinstance(wave, AdcNonlinearity)
    assert (wave.inl_v, wave.period_v) == pytest.approx((WAVE.inl_v, WAVE.period_v), rel=0.05)


@pytest.mark.slow
def test_of_steps_that_dwarf_the_noise_nothing_is_found() -> None:
    step_v = 30.0 * NOISE_V
    problem = converted(step_v)
    smooth = unrounded(problem, chosen(problem, step_v**2 / 12.0), step_v)
    assert smooth is not None
    assert chosen(smooth).after.point.effects == ()


@pytest.mark.slow
def test_a_wave_whose_period_divides_the_step_is_not_said_to_be_one() -> None:
    problem = converted(1e-5, WAVE)
    found = chosen(problem)
    assert [one.identifier for one in found.after.point.effects] == ["adc_nonlinearity"]
    for order in (1, 2):
        assert without_the_steps_own(problem, found, order * WAVE.period_v).after.point.effects == ()
    assert without_the_steps_own(problem, found, 1.5 * WAVE.period_v) is found


def test_where_no_bits_are_lost_nothing_is_taken_off() -> None:
    problem = converted(1e-5)
    found = chosen(problem)
    assert unrounded(problem, found, 0.0) is None
    assert unrounded(problem, found, 1e-5) is None
