"""Each verb on fixed seeds gives the results that are stored here."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from benchctl.bench import template
from benchctl.cli.app import run_verb
from tests.benchctl.cli.test_accept import SMALL
from tests.golden.stored import compare

LIMITS = """
[limits.scale_factor]
low = 49
high = 51
unit = "mV/(deg/s)"

[limits.bias_stability]
high = 3
unit = "deg/h"
"""
TWO_STAGE = ("points=3", "soak_s=600", "rates=3", "sweep_rates=5", "run_s=10", "zero_s=10")


def verb(folder: Path, *arguments: str) -> dict[str, Any]:
    """Run a verb in a folder; its JSON, with the exit code."""
    before = Path.cwd()
    (folder / "result.json").unlink(missing_ok=True)
    os.chdir(folder)
    try:
        code = run_verb([*arguments, "--json", "result.json", "--quiet"])
    finally:
        os.chdir(before)
    return {"exit_code": code, **json.loads((folder / "result.json").read_text())}


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with recordings of the simulated bench, each of a fixed seed."""
    folder = tmp_path_factory.mktemp("golden")
    small = [part for name, value in SMALL.items() for part in ("-p", f"{name}={value}")]
    calibration = [part for one in TWO_STAGE for part in ("-p", one)]
    (folder / "bench.toml").write_text(template().replace("sample_rate_hz = 500.0", "sample_rate_hz = 50.0"))
    (folder / "limits.toml").write_text(LIMITS)
    for name, seed, arguments in (
        ("two_stage", "7", ("two_stage", *calibration)),
        ("another_day", "8", ("two_stage", *calibration)),
        ("acceptance", "7", ("acceptance", *small, "--bench", "bench.toml")),
        ("static", "7", ("static", "-p", "duration_s=600", "-p", "soak_s=600")),
    ):
        assert verb(folder, "simulate", *arguments, "-o", f"{name}.h5", "--seed", seed)["exit_code"] == 0
    assert verb(folder, "fit", "two_stage.h5", "--out", "fitted")["exit_code"] == 0
    return folder


COMMANDS: Mapping[str, tuple[str, ...]] = {
    "check": ("check", "two_stage", "--bench", "simulated"),
    "fit": ("fit", "two_stage.h5", "--out", "fitted_again"),
    "apply": ("apply", "two_stage.h5", "--coefficients", "fitted/coefficients.json", "-o", "compensated.h5"),
    "compare": ("compare", "two_stage.h5", "another_day.h5", "--out", "compared"),
    "accept": ("accept", "acceptance.h5", "--limits", "limits.toml", "--out", "accepted"),
    "allan": ("allan", "static.h5", "--out", "allan"),
    "verify": ("verify", "two_stage.h5"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_a_verb_gives_the_stored_result(name: str, bench: Path) -> None:
    compare(name, verb(bench, *COMMANDS[name]), bench)
