"""Benchmarks one after the other, whatever becomes of one of them."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Sequence

from benchctl_instruments.errors import BenchError
from tests.benchmarks.comparison import Comparison


def run(names: Sequence[str], package: str) -> tuple[list[Comparison], list[str]]:
    """What the modules of a package measured, in their order, and which of them failed; says so on stderr."""
    found: list[Comparison] = []
    failed: list[str] = []
    for name in names:
        _say(f"{name}: measuring")
        began_s = time.perf_counter()
        try:
            figures = importlib.import_module(f"{package}.{name}").measured()
        except Exception as err:
            failed.append(name)
            _say(f"{name}: failed: {_in_words(err)}")
        else:
            found += figures
            _say(f"{name}: {len(figures)} figures after {time.perf_counter() - began_s:.1f} s")
    return found, failed


def _in_words(err: Exception) -> str:
    """In one line; what is no error of ours with its class."""
    said = " ".join(str(err).split())
    return said if isinstance(err, BenchError) else f"{type(err).__name__}: {said}"


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)  # noqa: T201
