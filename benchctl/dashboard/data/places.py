"""Where the live page keeps what it can make anew: in the user's cache, never beside the recordings."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def cache_folder() -> Path:
    """The folder of benchctl's caches, which need not be there yet; `BENCHCTL_CACHE` names another."""
    if told := os.environ.get("BENCHCTL_CACHE"):
        return Path(told)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "benchctl" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "benchctl"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "benchctl"
