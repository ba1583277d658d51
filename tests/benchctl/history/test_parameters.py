"""Runs of one procedure with other parameters are not compared, unless somebody asks."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.benchctl.history.made_history import campaign, figure, read


def history_by_cli(folder: Path, *more: str) -> tuple[str, dict[str, object]]:
    """What the command says, and its JSON."""
    asked = [sys.executable, "-m", "benchctl", "history", folder, "--out", folder, "--json", "found.json", *more]
    done = subprocess.run(asked, check=True, capture_output=True, text=True, cwd=folder)
    return done.stdout, json.loads((folder / "found.json").read_text())


def values(folder: Path) -> list[float]:
    return [point.value for point in figure(read(folder)).series.points]


def test_a_short_soak_is_no_drift_beside_a_long_one(tmp_path: Path) -> None:
    campaign(tmp_path, number=0, K0=0.05, soak_s=4800.0, points=3)
    campaign(tmp_path, number=1, K0=0.06, soak_s=600.0, points=3)
    campaign(tmp_path, number=2, K0=0.05, soak_s=4800.0, points=3)
    assert values(tmp_path) == [0.05, 0.05]
    assert figure(read(tmp_path)).flags == ()


@pytest.mark.slow
def test_it_says_how_many_it_left_out_and_why_and_how_to_ask(tmp_path: Path) -> None:
    for number, soak_s in enumerate((600.0, 600.0, 4800.0)):
        campaign(tmp_path, number=number, K0=0.05 + 0.001 * soak_s, soak_s=soak_s, points=3)
    says = (
        "SN-1: 2 of 3 runs of two_stage have other parameters than the latest (soak_s) and are not compared with it; "
        "--all-parameters compares them"
    )
    said, found = history_by_cli(tmp_path)
    assert says in said
    assert "drift" not in said
    assert "--all-parameters compares them" in (tmp_path / "history.html").read_text()
    assert says in [f"{one['where']}: {one['says']}" for one in found["problems"]]  # type: ignore[attr-defined, index]
    said, _ = history_by_cli(tmp_path, "--all-parameters")
    assert "drifted since" in said
    assert "--all-parameters" not in said


def test_each_unit_is_held_to_its_own_latest_parameters(tmp_path: Path) -> None:
    campaign(tmp_path, "SN-1", 0, 0.05, soak_s=4800.0)
    campaign(tmp_path, "SN-2", 1, 0.05, soak_s=600.0)
    history = read(tmp_path)
    assert [len(figure(history, serial=serial).series.points) for serial in ("SN-1", "SN-2")] == [1, 1]
    assert history.problems == ()


def test_campaigns_whose_parameters_are_not_known_are_compared_with_all(tmp_path: Path) -> None:
    campaign(tmp_path, number=0, K0=0.05)
    campaign(tmp_path, number=1, K0=0.05, soak_s=600.0)
    assert len(values(tmp_path)) == 2


def test_a_run_of_which_nothing_is_stated_sets_no_parameters_for_the_others(tmp_path: Path) -> None:
    campaign(tmp_path, number=0, soak_s=4800.0)
    campaign(tmp_path, number=1, K0=None, soak_s=600.0)
    assert len(values(tmp_path)) == 1
    assert read(tmp_path).problems == ()
