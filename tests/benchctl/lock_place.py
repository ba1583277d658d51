"""A place of the tests' own for the locks of instruments, which no environment variable moves."""

from pathlib import Path

import pytest


def own_lock_place(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let the locks lie in `folder`, as they lie in /run/lock; returns the folder of the locks."""
    folder.mkdir(exist_ok=True)
    folder.chmod(0o1777)
    monkeypatch.setattr("benchctl.campaign.reserved.LOCK_PLACES", (folder,))
    return folder / "benchctl"
