"""Excerpts show where models differ, in steps that were held out, and mark what is spoilt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.diagnosis.drive.problem import DriveProblem, drive_problem
from benchctl.diagnosis.faults import Fault
from benchctl.diagnosis.findings.located import left_of, slices_of, step_figures, where_of
from benchctl.diagnosis.findings.traces import traces_of
from benchctl.diagnosis.search.select import select
from benchctl.diagnosis.search.selection import Selection
from tests.benchctl.diagnosis.made_drive import Truth, drive_channels
from tests.benchctl.diagnosis.made_recording import recording_of

Chosen = tuple[DriveProblem, Selection]


def chosen(truth: Truth) -> Chosen:
    problem = drive_problem(recording_of(drive_channels(truth, 1)))
    return problem, select(problem, seed=0, progress=lambda _name, _share: None)


@pytest.fixture(scope="module")
def rubbing() -> Chosen:
    return chosen(Truth(coulomb=0.03))


@pytest.fixture(scope="module")
def clean() -> Chosen:
    return chosen(Truth())


def test_excerpts_are_of_held_out_steps_and_show_both_predictions(rubbing: Chosen) -> None:
    problem, selection = rubbing
    told = traces_of(problem, selection)
    assert 2 <= len(told) <= 3
    held = {name for name, out in zip(problem.step_names, selection.heldout, strict=True) if out}
    assert {one.step for one in told} <= held
    for one in told:
        assert one.heldout
        assert one.time_s.size <= 600
        assert 2.0 <= np.ptp(one.time_s) <= 4.0
        assert not one.spoilt.any()
        left = np.std(one.measured - one.after)
        assert left < 0.3 * np.sqrt(np.mean((one.measured - one.before) ** 2))


def test_where_nothing_was_found_excerpts_show_what_is_left(clean: Chosen) -> None:
    problem, selection = clean
    told = traces_of(problem, selection)
    assert told
    for one in told:
        rows = np.searchsorted(problem.time_s, one.time_s)
        assert one.after == pytest.approx(selection.after.predicted[rows])


def test_a_fault_of_the_data_has_an_excerpt_with_rows_before_and_after_it(rubbing: Chosen) -> None:
    problem, selection = rubbing
    rows = np.zeros(problem.time_s.size, np.bool_)
    first = np.searchsorted(problem.step, 5) + 20
    rows[first : first + 12] = True
    cleaned = replace(problem, rows=replace(problem.rows, moving=problem.rows.moving & ~rows))
    fault = Fault(effect="dropouts", parameters={}, rows=rows, gain=99.0, says="held")
    told = traces_of(cleaned, selection, (fault,))
    assert len(told) <= 3
    assert told[0].step == problem.step_names[5]
    assert told[0].spoilt.sum() == 12
    assert not told[0].spoilt.all()
    assert not any(one.spoilt.any() for one in told[1:])


def test_an_excerpt_has_no_gap_in_it(rubbing: Chosen) -> None:
    problem, selection = rubbing
    late = np.where(np.arange(problem.time_s.size) % 30 == 0, 10.0, 0.0).cumsum()
    gapped = replace(problem, rows=replace(problem.rows, time_s=problem.time_s + late))
    assert traces_of(gapped, selection) == ()


def test_the_map_blames_no_coordinate_where_nothing_is_left(rubbing: Chosen) -> None:
    before_beyond = set()
    for one in slices_of(*rubbing):
        held = one.count > 0
        assert np.abs(one.after[held] / one.standard_error[held]).max() < one.threshold, one.coordinate
        if np.abs(one.before[held] / one.standard_error[held]).max() > one.threshold:
            before_beyond.add(one.coordinate)
    assert {"rate", "rate_sign"} <= before_beyond


def test_the_threshold_of_the_map_is_that_of_all_its_bins_together(clean: Chosen) -> None:
    slices = slices_of(*clean)
    bins = sum(int((one.count > 0).sum()) for one in slices)
    # 1 in 100 over some 250 bins: two-sided normal tails from a table
    assert 200 < bins < 320
    assert slices[0].threshold == pytest.approx(4.10, abs=0.05)


def test_whole_numbers_have_a_bin_each(clean: Chosen) -> None:
    edges = {one.coordinate: one.edges for one in slices_of(*clean)}
    assert edges["rate_sign"].tolist() == [-1.5, -0.5, 0.5, 1.5]
    assert edges["step"].size == len(clean[0].step_names) + 1


def test_neighbouring_ranges_are_one(clean: Chosen) -> None:
    problem, _ = clean
    rate = problem.coordinates["rate"]
    where = where_of(problem, (rate > 0.0).astype(np.float32), "rate")
    ends = [end for pair in where.ranges for end in pair]
    assert len(ends) == len(set(ends))
    assert min(ends) > 0.1 * rate.min()
    assert 1.0 >= where.share_of_excess >= 0.8


def test_of_noise_that_wanders_what_is_left_is_what_a_prediction_from_before_leaves(clean: Chosen) -> None:
    from benchctl.estimation.noise import walk

    problem, selection = clean
    walking = selection.whitener.with_slow(walk(3.0, problem.interval_s))
    drift = 0.05 * np.sin(problem.time_s / 15.0)
    wandering = replace(selection.after, residual=selection.after.residual + drift)
    wandering = replace(wandering, white=walking(wandering.residual))
    left = left_of(problem, wandering, walking)
    counted = walking.weight > 0.0
    assert np.std(left[counted]) < 0.3 * np.std(wandering.residual[counted])
    assert left_of(problem, selection.after, selection.whitener) is selection.after.residual


def test_steps_come_to_the_noise_after_and_not_before(rubbing: Chosen) -> None:
    problem, selection = rubbing
    figures = step_figures(problem, selection)
    assert [one.name for one in figures] == list(problem.step_names)
    level = selection.after.deviation
    assert [one.after for one in figures] == pytest.approx([level] * len(figures), rel=0.3)
    assert all(one.before > 2.0 * one.after for one in figures)
