from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.signal

from benchctl.diagnosis.gyro.problem import gyro_problem
from benchctl.diagnosis.residual.residual_structure import (
    ResidualStructure,
    imperfect,
    instead_of,
    is_plain,
    lack_of_fit,
    of_the_motion,
    residual_structure_of,
    threshold_of,
    withdrawn,
)
from benchctl.diagnosis.result import COORDINATES
from benchctl.diagnosis.search.held_out import held_out_steps
from benchctl.estimation.fit import Point, fit
from benchctl.estimation.noise import Whitener
from benchctl_instruments.arrays import BoolArray, FloatArray
from tests.benchctl.diagnosis.foreign import draw, make, to_recording

N = 40000
DT = 0.01


@dataclass(frozen=True, kw_only=True, eq=False)
class Line:
    """A fit of offset and scale factor."""

    predicted: FloatArray
    residual: FloatArray
    white: FloatArray
    raw_derivatives: FloatArray
    derivatives: FloatArray
    fitted: BoolArray


@dataclass(frozen=True)
class Filtered:
    """A whitener for white noise with a random walk of so much of it a sample; 0 for none."""

    gain: float = 0.0

    @property
    def weight(self) -> FloatArray:
        return np.ones(N)

    def __call__(self, column: FloatArray) -> FloatArray:
        return np.asarray(scipy.signal.lfilter([1.0, -1.0], [1.0, self.gain - 1.0], column)) if self.gain else column


def lab() -> Any:
    time = DT * np.arange(N)
    step = (time // 10.0).astype(np.int64)
    levels = 60.0 * np.sin(1.7 * np.arange(step[-1] + 1) ** 1.3)
    rate = np.convolve(levels[step], np.ones(100) / 100, mode="same") + 20.0 * np.sin(2.0 * time) * (step % 3 == 0)
    temp = 20.0 + 30.0 * np.sin((time + time**2 / 900.0) / 47.0)
    coordinates = {
        "time": time,
        "rate": rate,
        "abs_rate": np.abs(rate),
        "rate_sign": np.sign(rate),
        "acceleration": np.gradient(rate, DT),
        "angle": np.mod(np.cumsum(rate) * DT, 360.0),
        "gyro_temp": temp,
        "gyro_temp_rate": np.gradient(temp, DT),
        "chamber_temp": np.full(N, np.nan),
        "output": 0.02 * rate,
        "step": step.astype(np.float64),
    }
    return SimpleNamespace(
        coordinates=coordinates, step=step, time_s=time, interval_s=DT, circumstances={"T0_c": 20.0}, unit="V"
    )


def rest_with(
    structure: FloatArray | float, *, seed: int = 0, gain: float = 0.0, walk: float = 0.0
) -> ResidualStructure:
    """The rest of noise and a structure, where offset and scale factor were fitted."""
    problem = lab()
    return residual_structure_of(problem, Filtered(gain), fitted_to(problem, structure, seed, gain, walk))


def fitted_to(problem: Any, structure: FloatArray | float, seed: int, gain: float, walk: float) -> Any:
    whitener, rate = Filtered(gain), problem.coordinates["rate"]
    chance = np.random.default_rng(seed)
    measured = chance.standard_normal(N) + walk * np.cumsum(chance.standard_normal(N)) + structure
    known = np.stack([np.ones(N), rate], axis=1)
    white, derivatives = whitener(measured), np.stack([whitener(column) for column in known.T], axis=1)
    values = np.linalg.lstsq(derivatives, white, rcond=None)[0]
    return Line(
        predicted=0.02 * rate,
        residual=measured - known @ values,
        white=white - derivatives @ values,
        raw_derivatives=known,
        derivatives=derivatives,
        fitted=np.ones(problem.step[-1] + 1, np.bool_),
    )


def test_noise_is_no_rest() -> None:
    for seed in range(2):
        found = rest_with(0.0, seed=seed)
        assert not found.significant
        assert (found.coordinates, found.says, found.ranges) == ((), "", ())
        assert found.threshold == threshold_of(len(found.looked)) < np.log(2e-4)


@pytest.mark.parametrize(
    ("coordinate", "structure"),
    [
        ("acceleration", lambda c: 1e-3 * c["acceleration"] ** 2),
        ("gyro_temp*rate", lambda c: 0.02 * c["rate"] * np.exp(-(((c["gyro_temp"] - 5.0) / 6.0) ** 2))),
        ("gyro_temp", lambda c: 0.7 * np.exp(-(((c["gyro_temp"] - 5.0) / 6.0) ** 2))),
        ("gyro_temp_rate", lambda c: 2.0 * c["gyro_temp_rate"] ** 2),
        ("angle", lambda c: 0.3 * np.cos(np.deg2rad(2 * c["angle"] - 30.0))),
        ("angle*gyro_temp", lambda c: 6e-4 * c["rate"] * (c["gyro_temp"] - 20.0) * np.cos(np.deg2rad(c["angle"]))),
        ("rate", lambda c: 0.3 * np.sin(c["rate"] / 9.0)),
        ("rate_sign", lambda c: 0.3 * np.sign(c["rate"])),
        ("time", lambda c: 0.3 * (c["time"] > 222.2)),
        ("time", lambda c: 0.3 * np.sin(c["time"] / 9.0)),
        ("step", lambda c: 0.4 * np.random.default_rng(5).standard_normal(40)[c["step"].astype(int)]),
        ("frequency", lambda c: 0.1 * np.sin(2 * np.pi * 17.3 * c["time"])),
    ],
)
def test_a_structure_is_found_in_the_coordinate_where_it_lives(
    coordinate: str, structure: Callable[[dict[str, FloatArray]], FloatArray]
) -> None:
    found = rest_with(structure(lab().coordinates))
    assert found.significant
    assert coordinate in found.coordinates[:2]
    assert {word for one in found.coordinates for word in one.split("*")} <= set(COORDINATES)


def test_it_says_in_which_range_it_is_largest() -> None:
    temp = lab().coordinates["gyro_temp"]
    found = rest_with(0.9 * np.exp(-(((temp - 5.0) / 4.0) ** 2)))
    ((low, high),) = found.ranges
    assert low < 5.0 < high
    assert high - low < 20.0
    assert "it depends on the gyro's temperature, most at" in found.says
    assert "no known effect accounts for it" in found.says


def test_the_range_of_an_output_is_in_the_unit_of_what_was_measured() -> None:
    problem = lab()
    problem.unit = "K"
    output = problem.coordinates["output"]
    bump = 0.9 * np.exp(-(((output - 0.5) / 0.1) ** 2))
    fitted = fitted_to(problem, bump, 0, 0.0, 0.0)
    problem.coordinates = {name: problem.coordinates[name] for name in ("time", "output", "step")}
    found = residual_structure_of(problem, Filtered(), fitted)
    assert re.search(r"depends on the output, most at [-\d.]+ to [-\d.]+ K;", found.says)


def test_the_share_is_that_of_the_power() -> None:
    rate = lab().coordinates["rate"]
    whole, half, none = (rest_with(size * np.sin(rate / 9.0)) for size in (1.0, 0.5, 0.0))
    assert half.share_of(whole) == pytest.approx(0.25, rel=0.1)
    assert whole.share_of(half) == 1.0
    assert none.share_of(whole) == 0.0


def test_a_random_walk_that_the_whitener_has_is_no_rest() -> None:
    found = rest_with(0.0, gain=0.03, walk=0.03)
    assert found.noise_gain > 1000.0
    assert not found.significant
    assert not found.for_noise


def test_a_jump_is_not_a_random_walk() -> None:
    found = rest_with(2.0 * (lab().coordinates["time"] > 151.0), gain=0.02)
    assert found.for_noise
    assert found.coordinates[0] == "time"
    assert "a jump of the bias at 151 s" in found.says
    assert withdrawn({"bias_random_walk": 1e9, "timing_offset": 1e9}, found) == ("bias_random_walk",)


def test_what_a_random_walk_does_not_follow_is_found_beside_it() -> None:
    acceleration = lab().coordinates["acceleration"]
    found = rest_with(3e-4 * acceleration**2, gain=0.05, walk=0.05)
    assert found.significant
    assert not found.for_noise
    assert found.coordinates[0] == "acceleration"


def test_a_finding_that_leaves_much_of_what_it_explains_is_not_named() -> None:
    found = replace(rest_with(0.5 * np.sin(lab().coordinates["rate"] / 9.0)), gain=1000.0)
    gains = {"adc_nonlinearity": 3000.0, "rate_squared": 50_000.0, "scale_temperature": 1e6}
    assert withdrawn(gains, found) == ("adc_nonlinearity",)
    assert withdrawn(gains, found, {"rate_squared": 49_000.0, "scale_temperature": 2e6}) == ("adc_nonlinearity",)
    # what the rest's coordinate does not bring in its stead does not follow the rest
    assert withdrawn(gains, found, {"adc_nonlinearity": 1400.0}) == ()
    assert withdrawn(gains, found, {"adc_nonlinearity": 1600.0}) == ("adc_nonlinearity",)
    assert imperfect(gains, found)
    assert not imperfect({"adc_nonlinearity": 3000.0, "rate_squared": 50_000.0}, found)
    quiet = rest_with(0.0)
    assert withdrawn(gains, quiet) == ()
    assert not imperfect(gains, quiet)


def test_a_coordinate_takes_the_place_of_a_wrong_finding_and_not_of_a_right_one() -> None:
    problem = lab()
    rate = problem.coordinates["rate"]
    wave, dip = 0.3 * np.sin(rate / 9.0), 0.3 * np.exp(-(((rate - 20.0) / 8.0) ** 2))
    rest = rest_with(wave)
    assert rest.coordinates[0] in ("rate", "output")
    # without it both can be told by the rate, and only the rate's own is a rest of it
    alone = rest_with(dip)
    of_rate = instead_of(problem, Filtered(), fitted_to(problem, wave + dip, 0, 0.0, 0.0), rest)
    of_temp = instead_of(problem, Filtered(), fitted_to(problem, 0.3 * np.sin(problem.time_s), 0, 0.0, 0.0), rest)
    assert of_rate > 0.8 * alone.gain  # all that the dip brings the rate brings in its stead
    assert of_temp < 0.1 * rest.gain


def test_what_is_left_beside_a_finding_anyway_does_not_take_its_place() -> None:
    """A drift over the time is right, though much that depends on the rate is left with it as without."""
    problem = lab()
    rate, time_s = problem.coordinates["rate"], problem.time_s
    wave, drift = 0.3 * np.sin(rate / 9.0), 0.3 * (time_s / time_s[-1] - 0.5)
    rest = rest_with(wave)
    alone = rest_with(drift)
    assert alone.gain < rest.gain
    instead = instead_of(problem, Filtered(), fitted_to(problem, wave + drift, 0, 0.0, 0.0), rest)
    assert instead < 0.4 * alone.gain
    assert withdrawn({"bias_drift": alone.gain}, rest, {"bias_drift": instead}) == ()


def test_only_what_is_left_along_the_motion_is_a_lack_of_fit_of_the_motion() -> None:
    problem = lab()
    of_motion = rest_with(0.3 * np.sin(problem.coordinates["rate"] / 9.0))
    assert lack_of_fit(of_motion) == pytest.approx(of_motion.gain / of_motion.dof)
    assert lack_of_fit(of_motion) > 10.0
    assert lack_of_fit(rest_with(0.0)) == 1.0
    assert of_the_motion("angle*rate", "output")
    assert not of_the_motion("rate*time")


def test_another_line_than_its_own_does_not_take_the_place_of_a_finding() -> None:
    """The pickup of 21 Hz that was found is right; what is left is a line of 17 Hz."""
    problem = lab()
    left, found = (0.1 * np.sin(2.0 * np.pi * hz * problem.time_s) for hz in (17.3, 21.7))
    rest = rest_with(left)
    assert rest.coordinates[0] == "frequency"
    beside_it = instead_of(problem, Filtered(), fitted_to(problem, left + 3.0 * found, 0, 0.0, 0.0), rest)
    assert beside_it < 2.0 * rest.gain
    own = instead_of(problem, Filtered(), fitted_to(problem, 4.0 * left, 0, 0.0, 0.0), rest)
    assert own > 5.0 * rest.gain


def test_a_whitener_that_remembers_nothing_is_known() -> None:
    assert is_plain(Filtered(), 0)
    assert not is_plain(Filtered(1e-3), 0)


def of_foreign(kind: str, seed: int) -> ResidualStructure:
    """The rest of another lab's recording when only the lab's own parameters were fitted."""
    problem = gyro_problem(to_recording(*make(draw(kind, seed), seed)))
    whitener = Whitener(interval_s=problem.interval_s, weight=problem.usable.astype(np.float64))
    fitted = fit(problem, whitener, Point(baseline=problem.baseline_start), ~held_out_steps(problem))
    return residual_structure_of(problem, whitener, fitted)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_where_nothing_is_missing_nothing_is_left() -> None:
    assert not of_foreign("moved", 1).significant


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_an_effect_that_nobody_knows_is_located() -> None:
    truth = draw("outsider", 8)
    found = of_foreign("outsider", 8)
    assert found.significant
    assert found.coordinates[0] in truth.lives_in
