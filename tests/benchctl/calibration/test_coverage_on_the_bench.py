"""The simulated bench's truth inside the stated intervals, over many seeds: physics, runner and fit together."""

import pytest

from tests.benchmarks.coverage import coverage


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_each_simulated_coefficient_lies_inside_its_95_percent_interval_in_90_to_99_of_100_seeds() -> None:
    counts, trials = coverage(range(1, 101))
    assert len(trials) == 100
    assert {name: count for name, count in counts.items() if not 90 <= count <= 99} == {}
    for trial in trials:
        assert 8.0 <= trial.error_percent["raw"] <= 10.0
        assert trial.error_percent["stage_2"] <= 0.7
        assert trial.error_percent["joint"] <= 0.1
