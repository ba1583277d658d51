"""The most memory that this process has held."""

from __future__ import annotations

from pathlib import Path

STATUS = Path("/proc/self/status")


def peak_bytes() -> int | None:
    """None where the system does not say. Not `getrusage`'s, which in a new process begins with the old one's."""
    if not STATUS.exists():
        return None
    (line,) = (line for line in STATUS.read_text(encoding="utf-8").splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) * 1024
