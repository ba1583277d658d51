"""The caches of the live page, for each test its own."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache that no other test sees; it is that of the user, too."""
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setenv("BENCHCTL_CACHE", str(folder))
    return folder
