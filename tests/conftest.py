"""What every run of the tests shares: how many processes share the work, and what they need not do again and again."""

from __future__ import annotations

import gc
import os
from collections.abc import Generator

import pytest
from hypothesis import HealthCheck, settings

# There is a worker for each core: threads of BLAS on top of that only wait for each other. Processes inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A shared machine may be slow at any moment: how long an example takes says nothing of what is tested.
settings.register_profile("shared machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("shared machine")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Thousands of collected tests live to the end: the garbage collector need not look at them at every turn."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.collect()
        gc.freeze()
        gc.set_threshold(10_000)  # what a test leaves goes with its last reference; few things go in circles


@pytest.hookimpl(optionalhook=True, wrapper=True)
def pytest_xdist_auto_num_workers() -> Generator[None, int, int]:
    """One process more than cores with `-n auto`: somewhere a test always waits for a silent line to time out."""
    workers = yield
    return workers if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ else workers + 1
