"""The README's first command, whole: the paper's campaign with 20 set points on the simulated bench."""

import json
import sys
from pathlib import Path

import pytest

from benchctl.calibration.coefficients import read_coefficients
from tests.benchctl.cli.processes import benchctl
from tests.documented import PAGES, blocks, handbook


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_main_job_is_whole_and_its_errors_and_memory_stay_within_what_the_readme_promises(tmp_path: Path) -> None:
    before_bytes = _largest_child_bytes()
    (job,) = [block.text for block in blocks(PAGES[0]) if block.mark == "main job"]
    assert handbook("first_campaign")[0].text.split()[1:] == job.split()[-4:]
    ran = benchctl(
        *job.split()[-4:], "--out", tmp_path / "c", "--json", tmp_path / "r.json",
        timeout_s=500.0,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["status"] == "complete"
    assert result["steps"] == {"planned": 328, "whole": 328}
    assert result["bench_time_s"] >= 30 * 3600
    assert result["samples"] >= 5_000_000
    errors = result["error_percent"]
    assert 8.0 <= errors["raw"] <= 10.0
    assert errors["stage_2"] <= 0.7
    assert errors["joint"] <= 0.1
    parameters = read_coefficients(tmp_path / "c" / "coefficients.json")["uncertainty"]["parameters"]
    for name, truth in {"K0_v_per_dps": 0.05, "S_rad_per_dps": 0.0045, "g1": -1.315e-4, "g2": 2.066e-6}.items():
        low, high = parameters[name]["ci95"]
        assert abs(parameters[name]["value"] - truth) < high - low, name
    peak_bytes = _largest_child_bytes()
    assert peak_bytes < 2**30 or peak_bytes == before_bytes  # then a child of an earlier test was the largest


def _largest_child_bytes() -> int:
    """The peak memory of the largest child process so far; 0 on Windows."""
    if sys.platform == "win32":
        return 0
    import resource

    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
