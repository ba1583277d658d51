"""The runner waits for the guard's first answer, and somebody for the guard to act: neither waits for heavy imports."""

import json
import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("module", "heavy"), [("__main__", {"numpy", "scipy", "h5py", "pydantic", "serial"}), ("rescue", {"scipy", "h5py"})]
)
def test_the_guard_imports_no_more_than_it_needs(module: str, heavy: set[str]) -> None:
    code = f"import json, sys, benchctl.campaign.guard.{module}; print(json.dumps(list(sys.modules)))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30, check=True)
    assert heavy.isdisjoint(json.loads(result.stdout))
