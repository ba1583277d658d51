"""Installed packages as a test needs them: their folders on Python's path, with the metadata that pip would leave."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from benchctl_instruments.entry_points import leave_out, offers
from benchctl_instruments.physics import effect_modules
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.registry import effects


def install(folder: Path, name: str, points: Mapping[str, Mapping[str, str]], modules: Mapping[str, str]) -> None:
    """Put a package's modules (name -> text) and its entry points (group -> name -> value) into a folder."""
    info = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8")
    with (info / "entry_points.txt").open("w", encoding="utf-8") as file:
        for group, told in points.items():
            file.write("\n".join([f"[{group}]", *(f"{key} = {value}" for key, value in told.items()), ""]))
    for module, text in modules.items():
        (folder / f"{module}.py").write_text(text, encoding="utf-8")


def forget() -> None:
    """Let everything that is found by entry points be looked for anew."""
    for found in (offers, leave_out, effects, drive_effects, chamber_effects, effect_modules._theirs):
        found.cache_clear()


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder whose packages count as installed, until the test is over."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    forget()
    yield folder
    forget()
