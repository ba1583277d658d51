"""Cores, memory and open files."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

from benchctl.doctor.finding import MACHINE, Finding, look, ok
from benchctl.side_by_side import cores

_LITTLE_MEMORY = 2e9
"""A diagnosis takes 1 GB in the median."""

_FEW_FILES = 256


def resource_findings(root: Path = Path("/")) -> Iterator[Finding]:
    """What the system lets this process have; `root` is where its `proc` and `sys` lie."""
    yield ok(MACHINE, "processors", f"{cores()} of {os.cpu_count() or 1} for this process")
    yield from _memory(root)
    if sys.platform != "win32":
        yield _files()


def _memory(root: Path) -> Iterator[Finding]:
    try:
        lines = (root / "proc/meminfo").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return
    kilobytes = {name: int(rest.split()[0]) for name, _, rest in (line.partition(":") for line in lines) if rest}
    total, free = (1024.0 * kilobytes.get(name, 0) for name in ("MemTotal", "MemAvailable"))
    group = _group_limit(root)
    says = f"{free / 1e9:.1f} GB of {total / 1e9:.1f} GB are free"
    if group is not None and group < total:
        free = min(free, group)
        says += f", and this container may have {group / 1e9:.1f} GB"
    if free < _LITTLE_MEMORY:
        yield look(MACHINE, "memory", says, "end other programs: a diagnosis of a long recording takes 1 to 2 GB")
    else:
        yield ok(MACHINE, "memory", says)


def _group_limit(root: Path) -> float | None:
    """What the control group (version 2) of a container allows, in bytes."""
    try:
        return float((root / "sys/fs/cgroup/memory.max").read_text(encoding="ascii"))
    except (OSError, ValueError):  # ValueError: "max"
        return None


def _files() -> Finding:
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != resource.RLIM_INFINITY and soft < _FEW_FILES:
        return look(
            MACHINE,
            "open files",
            f"{soft} may be open at once",
            f"ulimit -n {4 * _FEW_FILES if hard in (-1, resource.RLIM_INFINITY) else min(hard, 4 * _FEW_FILES)} "
            "before benchctl",
        )
    return ok(MACHINE, "open files", f"{soft} may be open at once")
