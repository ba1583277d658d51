"""A package of somebody else's, installed for real into a fresh environment; nothing of ours is edited for it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

import pytest
import tomli_w

from tests.benchctl.believed import BELIEVED, NO_ENCODER_ERRORS
from tests.third_party.environments import fresh_environment

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

EXAMPLE = Path(__file__).with_name("example_lab")
HIDDEN_V = 2.0e-8

MODEL = f"{BELIEVED}{NO_ENCODER_ERRORS}[effects.vibration_rectification]\nv_per_dps2_squared = {HIDDEN_V}\n"


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of a fresh environment that sees what this one has, and the example besides."""
    place = tmp_path_factory.mktemp("environment")
    python = fresh_environment(place / "venv") / f"python{sysconfig.get_config_var('EXE') or ''}"
    source = place / "example_lab"
    shutil.copytree(EXAMPLE, source)
    install = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-index"]
    ran = subprocess.run([*install, "--no-deps", "--no-build-isolation", str(source)], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    return python


def benchctl(python: Path, folder: Path, *arguments: str) -> str:
    """What a verb says, run in the fresh environment; it must succeed."""
    command = [str(python), "-m", "benchctl", *arguments]
    ran = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert "warning" not in ran.stderr
    return ran.stdout


def change(path: Path, **tables: dict[str, object]) -> None:
    """Fields of a bench.toml in the place of its own."""
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    for table, fields in tables.items():
        document[table] |= fields
    path.write_text(tomli_w.dumps(document), encoding="utf-8")


def test_its_procedure_is_listed_and_runs_on_its_chamber_over_the_wire(python: Path, tmp_path: Path) -> None:
    assert "rectification: Vibration rectification: the bias while" in benchctl(python, tmp_path, "procedures")
    benchctl(python, tmp_path, "init", "lab")
    change(tmp_path / "lab" / "bench.toml", chamber={"model": "frostline_fl20"})
    quick = ("-p", "soak_s=120", "-p", "run_s=2", "--out", "campaign", "--json", "run.json")
    said = benchctl(python, tmp_path, "run", "rectification", "--bench", "lab/bench.toml", *quick)
    assert "complete: 8 of 8 steps complete" in said
    shown = json.loads(benchctl(python, tmp_path, "show", "campaign", "--json", "-"))
    assert json.loads(shown["provenance"]["instruments"])["chamber"]["manufacturer"] == "Frostline"
    assert shown["provenance"]["instruments_reached"] == "simulated, over their wires"


def test_its_effect_is_simulated_and_a_diagnosis_finds_it_by_its_name_with_its_parameter(
    python: Path, tmp_path: Path
) -> None:
    (tmp_path / "hidden.toml").write_text(MODEL, encoding="utf-8")
    benchctl(python, tmp_path, "init", "lab")
    fine = {"sample_rate_hz": 125.0, "encoder_counts_per_rev": 3_600_000}
    change(tmp_path / "lab" / "bench.toml", digitizer=fine)
    simulated = (
        "--bench",
        "lab/bench.toml",
        "--model",
        "hidden.toml",
        "-p",
        "set_points_c=23,50,23",
        "--seed",
        "7",
    )
    benchctl(python, tmp_path, "simulate", "diagnostic", *simulated, "-o", "hidden.h5")
    found = json.loads(benchctl(python, tmp_path, "diagnose", "hidden.h5", "--out", "found", "--json", "-"))
    assert found["verdict"] == "missing-physics"
    (finding,) = found["findings"]
    assert finding["effect"] == "vibration_rectification"
    value = finding["parameters"]["v_per_dps2_squared"]
    low, high = value["ci95"] if "ci95" in value else (value["low"], value["high"])
    assert low < HIDDEN_V < high
    assert value["value"] == pytest.approx(HIDDEN_V, rel=0.05)
    assert finding["probability"] > 0.99
    assert "vibration_rectification" in (tmp_path / "found" / "diagnosis.html").read_text(encoding="utf-8")
    benchctl(python, tmp_path, "compare", "hidden.h5", "--model", "found/model.toml")
    assert "the bias is another than at rest" in benchctl(python, tmp_path, "explain", "vibration_rectification")


def test_its_own_tests_pass_there(python: Path, tmp_path: Path) -> None:
    shutil.copytree(EXAMPLE / "tests", tmp_path / "tests")
    (tmp_path / "pytest.ini").write_text("[pytest]\n")  # not what somebody left in a folder above
    environment = os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [str(python), "-m", "pytest", "-q", "-p", "benchctl.pytest_plugin", "-W", "error", "tests"]
    ran = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout
    assert "3 passed" in ran.stdout
