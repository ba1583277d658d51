"""Memory that is kept: large arrays made again and again, in a process of their own, cost no new pages."""

from __future__ import annotations

import subprocess
import sys

import pytest

ARRAYS, MIB = 20, 64
MADE = f"""
import resource
import threading
import numpy as np
from benchctl.kept_memory import keep_memory

kept = {{kept}} and keep_memory()

def make():
    for _ in range({ARRAYS}):
        np.ones({MIB} << 17)

make()
before = resource.getrusage(resource.RUSAGE_SELF).ru_stime
make()
other = threading.Thread(target=make)
other.start()
other.join()
print(int(kept), resource.getrusage(resource.RUSAGE_SELF).ru_stime - before)
"""

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks for the C library of Linux")


def made(*, kept: bool) -> tuple[bool, float]:
    """Whether memory was kept, and the system's own seconds for forty arrays after the first twenty."""
    told = subprocess.run([sys.executable, "-c", MADE.format(kept=kept)], capture_output=True, text=True, check=True)
    held, system_s = told.stdout.split()
    return held == "1", float(system_s)


def test_arrays_in_memory_that_is_kept_cost_the_system_nothing() -> None:
    held, system_s = made(kept=True)
    if not held:
        pytest.skip("this C library has no such option")
    _, each_time_s = made(kept=False)
    assert system_s < 0.2 * each_time_s
