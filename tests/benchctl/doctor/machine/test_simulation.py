import shutil
import subprocess
import sys

import pytest

from benchctl.doctor.machine.simulation import simulation_findings


def test_what_the_simulated_bench_needs_is_tried_and_works_here() -> None:
    found = list(simulation_findings())
    assert [finding.what for finding in found] == ["loopback", "pseudo-terminals", "shared locks"]
    assert {finding.verdict for finding in found} == {"ok"}


@pytest.mark.skipif(
    shutil.which("unshare") is None or subprocess.run(["unshare", "-n", "true"], capture_output=True).returncode != 0,
    reason="this user may not make a network namespace, in which the loopback is down",
)
def test_a_loopback_that_is_down_is_bad() -> None:
    code = "from benchctl.doctor.machine.simulation import simulation_findings as s; print(next(s()))"
    ran = subprocess.run(["unshare", "-n", sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "verdict='bad'" in ran.stdout
    assert "sudo ip link set lo up" in ran.stdout
