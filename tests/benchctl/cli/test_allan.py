"""`benchctl allan`, as its users run it."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from benchctl_instruments.physics.gyro import GyroParameters
from tests.benchctl.cli.processes import benchctl, without_a_process


@pytest.fixture
def rates(tmp_path: Path) -> Path:
    """An hour of white noise of 0.1 deg/sqrt(h) at 20 Hz."""
    noise = 0.1 / 60.0 * np.sqrt(20.0) * np.random.default_rng(1).standard_normal(72_000)
    np.savetxt(tmp_path / "rates.csv", noise, header="rate_dps", comments="")
    return tmp_path / "rates.csv"


def test_a_column_becomes_a_table_a_picture_and_coefficients_in_the_standards_units(rates: Path) -> None:
    ran = benchctl("allan", rates, "--rate-hz", "20", "--json", rates.parent / "a.json")
    assert ran.returncode == 0, ran.stderr
    told = json.loads((rates.parent / "a.json").read_text())
    assert (told["schema"], told["ok"], told["unit"]) == ("benchctl-allan/1", True, "deg/s")
    assert len(told["tau_s"]) == len(told["deviation"]) == len(told["ci95"])
    walk = told["coefficients"]["N"]
    assert walk["unit"] == "deg/sqrt(h)"
    assert walk["ci95"][0] < 0.1 < walk["ci95"][1]
    assert walk["value"] == pytest.approx(0.1, rel=0.02)
    assert [term for term in "QBKR" if told["coefficients"][term] is not None] == []
    assert "N  angle random walk: 0." in ran.stdout
    assert "K  rate random walk: none: " in ran.stdout
    page = (rates.parent / "rates.allan" / "allan.html").read_text(encoding="utf-8")
    assert "<svg" in page
    assert "angle random walk" in page
    with (rates.parent / "rates.allan" / "allan.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["tau_s"]) for row in rows] == told["tau_s"]
    assert [float(row["deviation"]) for row in rows] == told["deviation"]


def test_with_json_alone_nothing_else_is_written(rates: Path) -> None:
    ran = without_a_process("allan", rates, "--rate-hz", "20", "--json", "-", "--quiet")
    assert json.loads(ran.stdout)["samples"] == 72_000
    assert list(rates.parent.iterdir()) == [rates]


@pytest.mark.slow
def test_a_recording_of_the_bench_has_the_noise_that_its_gyro_was_given(tmp_path: Path) -> None:
    recorded = tmp_path / "static.h5"
    made = benchctl("simulate", "static", "-p", "duration_s=600", "-o", recorded, "--seed", "1")
    assert made.returncode == 0, made.stderr
    ran = benchctl("allan", recorded, "--json", "-", "--quiet")
    assert ran.returncode == 0, ran.stderr
    told = json.loads(ran.stdout)
    assert (told["unit"], told["coefficients"]["N"]["unit"]) == ("V", "V/sqrt(Hz)")
    ran = benchctl("allan", recorded, "--scale-v-per-dps", "0.05", "--json", "-", "--quiet")
    rate = json.loads(ran.stdout)
    assert rate["unit"] == "deg/s"
    assert rate["deviation"] == pytest.approx([value / 0.05 for value in told["deviation"]])
    walk = rate["coefficients"]["N"]
    assert walk["unit"] == "deg/sqrt(h)"
    assert walk["value"] == pytest.approx(GyroParameters().arw_deg_per_sqrt_h, rel=0.05)  # and the converter's rounding


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["rates.csv"], "has no column of time; say how often it was sampled with --rate-hz"),
        (["rates.csv", "--rate-hz", "0"], "--rate-hz 0: expected samples a second, a positive number"),
        (["rates.csv", "--rate-hz", "20", "--step", "1"], "--step and --scale-v-per-dps are for recordings"),
        (["none.h5", "--scale-v-per-dps", "0"], "--scale-v-per-dps 0: expected volts for a degree a second, not 0"),
        (["rates.csv", "--rate-hz", "20", "--channel", "b"], "has no column 'b'; it has 'rate_dps'"),
        (["none.csv", "--rate-hz", "20"], "none.csv: cannot be read"),
        (["none.h5"], "none.h5"),
        (["none.h5", "--rate-hz", "20"], "--rate-hz is for text files"),
    ],
)
def test_what_cannot_be_used_is_one_clear_line(arguments: list[str], says: str, rates: Path) -> None:
    ran = without_a_process("allan", *arguments, folder=rates.parent)
    assert ran.returncode == 2
    assert says in ran.stderr
    assert ran.stderr.count("\n") == 1
    assert list(rates.parent.iterdir()) == [rates]
