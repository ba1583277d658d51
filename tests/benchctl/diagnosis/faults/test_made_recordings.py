"""Data faults in whole recordings of another lab, and none in those that have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.diagnosis.diagnose import diagnose
from benchctl.diagnosis.faults import Fault, faults_in, spikes_in
from benchctl.diagnosis.gyro.problem import gyro_problem
from tests.benchctl.diagnosis.foreign import Truth, make, to_recording
from tests.benchctl.diagnosis.foreign.truth import Effects

CASES: tuple[tuple[int, Effects], ...] = (
    (0, {"timing_offset": {"offset_s": 6e-3}, "noise_rate_dependent": {"factor_at_full_rate": 3.5}}),
    (1, {"dropouts": {"count": 9, "hold_s": 0.7}, "outliers": {"fraction": 4e-4, "scale_v": 0.05}}),
    (2, {"adc_coarse": {"bits_lost": 5}, "thermal_lag": {"tau_s": 500.0}}),
    (0, {"saturation": {"limit_v": 2.0}, "flicker_noise": {"v_rms_per_decade": 2e-4}}),
)


@pytest.mark.parametrize(("bench", "effects"), CASES)
def test_the_faults_of_a_recording_are_found_with_their_numbers_and_nothing_else(bench: int, effects: Effects) -> None:
    found = _found(replace(Truth(kind="made", bench=bench, plan=bench), effects=effects))
    wanted = effects.keys() & {"dropouts", "outliers", "adc_coarse", "saturation"}
    assert found.keys() == wanted
    for name in wanted:
        for parameter, true in effects[name].items():
            estimate = found[name].parameters[parameter]
            assert estimate.value == pytest.approx(true, rel=0.2), (name, parameter)
            assert found[name].gain > 100.0


@pytest.mark.slow
def test_a_recorder_that_is_faster_than_the_gyro_adds_no_delay() -> None:
    truth = replace(Truth(kind="made", bench=0, plan=0), effects={"timing_offset": {"offset_s": 6e-3}})
    description, table = make(truth, 5)
    table[:, 2] = table[np.arange(len(table)) // 3 * 3, 2]
    diagnosis = diagnose(to_recording(description, table))
    (delay,) = diagnosis.findings
    assert delay.effect == "timing_offset"
    assert delay.parameters["offset_s"].value == pytest.approx(6e-3, rel=0.1)
    assert not diagnosis.unexplained.significant
    assert any("is repeated in 3 rows" in note for note in diagnosis.notes)


def _found(truth: Truth) -> dict[str, Fault]:
    problem = gyro_problem(to_recording(*make(truth, 5)))
    predicted = problem.predict(problem.baseline_start, ())
    before = faults_in(
        volts=problem.measured,
        predicted=predicted,
        foretold=problem.usable,
        stretches=problem.stretches,
        interval_s=problem.interval_s,
        adc_step_v=problem.adc_step_v,
        limit_v=problem.simulation["output_limit_v"],
    )
    kept = problem.usable & ~before.masked
    columns = np.column_stack([predicted, np.ones_like(predicted)])
    provisional, *_ = np.linalg.lstsq(columns[kept], problem.measured[kept], rcond=None)
    after = spikes_in(
        residual=problem.measured - columns @ provisional,
        usable=problem.usable & ~before.standing,
        step_v=before.step_v,
        sudden=(problem.frame.sudden > 0.0,),
    )
    return {one.effect: one for one in (*before.found, *after.found)}
