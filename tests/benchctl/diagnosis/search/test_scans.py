"""The scans on recordings of a generator that shares no code with them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchctl.diagnosis.gyro.problem import GyroProblem, gyro_problem
from benchctl.diagnosis.search.probes import probes_of
from benchctl.diagnosis.search.pull import pull_of
from benchctl.diagnosis.search.scan_lines import line_places
from benchctl.diagnosis.search.scans import proposals
from benchctl.diagnosis.search.screen import Scored, screen
from benchctl.estimation.fit import Fit, Point, fit
from benchctl.estimation.noise import Whitener
from tests.benchctl.diagnosis.foreign import draw, make, to_recording
from tests.benchctl.diagnosis.foreign.draw import EFFECTS

SHAPES = {"mains_pickup": "frequency_hz", "adc_nonlinearity": "period_v", "encoder_interpolation": "lines_per_rev"}


def _fitted(kind: str, seed: int) -> tuple[GyroProblem, Whitener, Fit]:
    problem = gyro_problem(to_recording(*make(draw(kind, seed), seed)))
    whitener = Whitener(interval_s=problem.interval_s, weight=problem.usable.astype(np.float64))
    steps = np.ones(len(problem.step_names), np.bool_)
    return problem, whitener, fit(problem, whitener, Point(baseline=problem.baseline_start), steps)


def _promise(one: Scored) -> float:
    return one.gain - 2.0 * math.log(one.probe.places)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.slow
def test_what_is_hidden_is_proposed_at_its_place_and_promises_most(name: str) -> None:
    seed = EFFECTS.index(name)
    problem, whitener, fitted = _fitted("quarter", seed)
    scored = screen(problem, whitener, fitted, proposals(problem, whitener, fitted), seed=0).scored
    best = max(scored, key=_promise)
    assert best.probe.identifier == name
    assert _promise(best) > 100.0
    found, true = best.probe.columns[0].values[SHAPES[name]], draw("quarter", seed).effects[name][SHAPES[name]]
    assert found == pytest.approx(true, rel={"mains_pickup": 5e-7, "adc_nonlinearity": 0.02}.get(name, 0.0))
    if name == "encoder_interpolation":
        exact = {one.probe.columns[0].values.get("lines_per_rev"): one.gain for one in scored}
        for place in line_places(problem, pull_of(problem, whitener, fitted), 100_000, 3):
            assert place.gain == pytest.approx(exact[place.value], rel=0.15)


@pytest.mark.slow
def test_where_nothing_is_hidden_no_place_promises_more_than_chance() -> None:
    problem, whitener, fitted = _fitted("null", 2)
    scored = screen(problem, whitener, fitted, proposals(problem, whitener, fitted), seed=0).scored
    assert {one.probe.identifier for one in scored} <= set(SHAPES)
    assert all(_promise(one) < 14.0 for one in scored)
    for name in SHAPES:
        assert list(probes_of(problem, problem.effects[name])) == []
