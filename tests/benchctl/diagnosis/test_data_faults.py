"""Faults of the data taken out of a problem before anything is chosen, and stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.diagnosis.data_faults import fault_findings, without_data_faults
from benchctl.diagnosis.gyro.problem import GyroProblem, gyro_problem
from benchctl.recordings.reader import open_recording
from benchctl_instruments.physics.effects.registry import effect
from tests.benchctl.diagnosis.following import fitted
from tests.benchctl.diagnosis.moving import NOISE_V, write_moving
from tests.benchctl.diagnosis.toy_problem import FloatArray, toy


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> GyroProblem:
    kinds = ("static", "constant_rate", "sine") * 2
    with open_recording(write_moving(tmp_path_factory.mktemp("sound") / "moving.h5", kinds=kinds)) as recording:
        return gyro_problem(recording)


def with_volts(problem: GyroProblem, volts: FloatArray) -> GyroProblem:
    return replace(problem, frame=replace(problem.frame, volts=volts))


def spiky(problem: GyroProblem) -> tuple[GyroProblem, FloatArray]:
    """Single samples thrown out by a hundred times the noise, either way, amid rows that count."""
    chance = np.random.default_rng(4)
    amid = np.convolve(problem.usable, np.ones(101), mode="same") > 100.5
    rows = np.array([row for row in range(60, problem.frame.rows, 130) if amid[row]])
    volts = problem.frame.volts.copy()
    volts[rows] += 100.0 * NOISE_V * chance.choice([-1.0, 1.0], rows.size)
    thrown = np.zeros(volts.size)
    thrown[rows] = 1.0
    return with_volts(problem, volts), thrown


def held(problem: GyroProblem) -> GyroProblem:
    """The output stands still now and then for some samples."""
    volts = problem.frame.volts.copy()
    for start in range(400, volts.size - 100, 700):
        volts[start : start + 25] = volts[start]
    return with_volts(problem, volts)


def test_sound_data_stay_as_they_are(sound: GyroProblem) -> None:
    clean, faults = without_data_faults(sound)
    assert faults == ()
    assert np.array_equal(clean.usable, sound.usable)


def test_spikes_are_masked_and_stated_and_no_longer_pull_the_fit(sound: GyroProblem) -> None:
    problem, thrown = spiky(sound)
    clean, faults = without_data_faults(problem)
    assert [one.effect for one in faults] == ["outliers"]
    assert not clean.usable[thrown > 0.0].any()
    assert clean.usable[thrown == 0.0].mean() > 0.99 * sound.usable[thrown == 0.0].mean()
    assert isinstance(clean, GyroProblem)
    assert fitted(problem).deviation > 2.0 * NOISE_V
    assert fitted(clean).deviation == pytest.approx(NOISE_V, rel=0.05)
    assert np.array_equal(problem.usable, sound.usable)


def test_held_samples_are_masked_and_stated(sound: GyroProblem) -> None:
    clean, faults = without_data_faults(held(sound))
    assert [one.effect for one in faults] == ["dropouts"]
    assert not clean.usable[faults[0].rows].any()
    assert faults[0].rows.sum() > 0.5 * 25 * len(range(400, sound.frame.rows - 100, 700))


def test_a_rail_is_found_where_the_output_stands_at_it(sound: GyroProblem) -> None:
    rail = 1.0
    clean, faults = without_data_faults(with_volts(sound, np.minimum(sound.frame.volts, rail)))
    assert [one.effect for one in faults] == ["saturation"]
    assert not clean.usable[sound.frame.volts > rail + 5.0 * NOISE_V].any()


def test_what_is_withheld_is_neither_stated_nor_taken_out(sound: GyroProblem) -> None:
    for problem, name in ((spiky(sound)[0], "outliers"), (held(sound), "dropouts")):
        withheld = replace(problem, without=frozenset({name}))
        clean, faults = without_data_faults(withheld)
        assert [one.effect for one in faults] == []
        assert clean.usable.sum() > without_data_faults(problem)[0].usable.sum()


def test_of_a_part_other_than_the_gyro_nothing_is_known() -> None:
    problem = toy(added_v=np.where(np.arange(2400) % 100 == 0, 1.0, 0.0))
    clean, faults = without_data_faults(problem)
    assert clean is problem
    assert faults == ()


def test_a_fault_is_a_finding_with_what_was_found_of_it(sound: GyroProblem) -> None:
    problem, thrown = spiky(sound)
    clean, faults = without_data_faults(problem)
    (one,) = fault_findings(clean, faults)
    assert one.effect == "outliers"
    assert one.parameters == faults[0].parameters
    assert one.says == faults[0].says
    assert one.gain == faults[0].gain > 100.0
    assert one.explains == pytest.approx(thrown.mean(), rel=0.3)
    assert one.where.coordinate == effect("outliers").coordinate
    assert one.probability == 1.0


def test_a_fault_without_rows_lives_in_its_coordinate_alone(sound: GyroProblem) -> None:
    _, faults = without_data_faults(spiky(sound)[0])
    bare = replace(faults[0], rows=np.zeros(sound.frame.rows, np.bool_))
    (one,) = fault_findings(sound, (bare,))
    assert one.where.ranges == ()
    assert one.where.steps == ()
    assert one.explains == 0.0
