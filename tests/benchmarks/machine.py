"""On what machine, on which day and with which versions figures were measured: without it they say little."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass, replace
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from benchctl.side_by_side import cores

OURS = ("benchctl", "numpy", "h5py")
PEERS = (
    "allantools",
    "bluesky",
    "distributed",
    "fsspec",
    "numba",
    "openhtf",
    "pymeasure",
    "qcodes",
    "suitcase-jsonl",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Of one run; `load` is how many processes wanted a core, in the last minute, at the beginning and at the end."""

    processor: str
    cores: int
    load: tuple[float, ...]
    date: str
    versions: str

    @classmethod
    def now(cls) -> Conditions:
        """At the beginning of a run."""
        installed = [f"{name} {found}" for name in (*OURS, *PEERS) if (found := _version(name))]
        return cls(
            processor=processor(),
            cores=cores(),
            load=_load(),
            date=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M"),
            versions=", ".join([f"Python {platform.python_version()}", *installed]),
        )

    def ended(self) -> Conditions:
        """The same at the end of the run."""
        return replace(self, load=(*self.load, *_load()))

    @property
    def machine(self) -> str:
        """In words."""
        words = f"{self.processor}, {self.cores} core{'s' if self.cores != 1 else ''}"
        return f"{words}, load {' to '.join(f'{one:.1f}' for one in self.load)}" if self.load else words


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _load() -> tuple[float, ...]:
    """Nothing where the system does not say."""
    return (os.getloadavg()[0],) if hasattr(os, "getloadavg") else ()


def processor() -> str:
    """The model's name, as Linux has it, or what Python knows of it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
