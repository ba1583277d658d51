"""Campaigns that real runs left, a server before them, and a browser, one of each for the tests of a file."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import h5py
import pytest
from playwright.sync_api import Browser

from tests.benchctl.dashboard.page.browsing import Served, a_browser, serving

TURNS, REST = "turns_SN-1", "rest_SN-1"
EVIL = """<img src=x onerror="document.title='owned'">"""
"""As a name this shows as text; taken for markup it would run."""
_REST = ("static", "-p", "soak_s=300", "-p", "duration_s=60")
_TURNS = """
from benchctl.plan import ConstantRate, Sine, Soak, Static, procedure

@procedure()
def turns():
    '''Both directions, and a swing.'''
    yield Soak(setpoint_c=20.0, hold_s=300.0, drift_c_per_min=1.0)
    yield Static(duration_s=20.0)
    for rate in (42.5, -42.5, 85.0, -85.0):
        yield ConstantRate(rate_dps=rate, duration_s=30.0)
    yield Sine(amplitude_dps=60.0, frequency_hz=0.5, cycles=10)
"""


def run(out: Path, *procedure: str) -> subprocess.Popen[bytes]:
    """A campaign on the simulated bench, as its users run it; its end is not waited for."""
    command = [
        sys.executable,
        "-m",
        "benchctl",
        "run",
        *procedure,
        "--bench",
        "simulated",
        "--out",
        str(out),
        "--quiet",
    ]
    return subprocess.Popen([*command, "--seed", "7"], stdout=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with turns, a rest, a copy of the rest that is full of markup, and half a file."""
    root = tmp_path_factory.mktemp("campaigns")
    procedure = tmp_path_factory.mktemp("procedures") / "turns.py"
    procedure.write_text(_TURNS)
    runs = [run(root / TURNS, str(procedure)), run(root / REST, *_REST)]
    assert [one.wait(timeout=150) for one in runs] == [0, 0]
    name_with_markup(root / REST, root / EVIL.replace("/", ""))
    (root / "torn.h5").write_bytes((root / REST / "recording.h5").read_bytes()[:20_000])
    return root


@pytest.fixture(scope="module")
def served(campaigns: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server on a port of its own."""
    with serving(campaigns, tmp_path_factory.mktemp("cache")) as server:
        yield server


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A browser; the tests are skipped where there is none."""
    with a_browser() as browser:
        yield browser


def name_with_markup(folder: Path, copy: Path) -> None:
    """A copy of a campaign whose unit, operator and steps are named with markup."""
    copy.mkdir()
    shutil.copy(folder / "recording.h5", copy)
    with h5py.File(copy / "recording.h5", "r+") as file:
        for name in ("unit_serial", "unit_model", "provenance_operator", "provenance_procedure"):
            file.attrs[name] = EVIL
        for step in file["steps"].values():
            step.attrs["name"] = EVIL
