"""`benchctl explain`, as its users run it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchctl.cli.app import run_verb
from tests.benchctl.cli.processes import benchctl


def test_alone_it_lists_everything_in_groups(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["explain"]) == 0
    text = capsys.readouterr().out
    for heading in (
        "Effects of the gyro's chain:",
        "Effects of the chamber:",
        "Noise terms:",
        "Verdicts and statuses:",
    ):
        assert f"\n{heading}\n" in f"\n{text}"
    for name in ("thermal_lag", "coulomb_friction", "second_lag", "scale_factor", "guard band", "INCONCLUSIVE"):
        assert f"\n  {name} " in text


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["thermal_lag"], "The fibre coil is not at the temperature of its thermistor"),
        (["scale", "factor"], "Slope K of the least-squares line"),
        (["scale factor"], "Slope K of the least-squares line"),
        (["error_percent"], "Largest residual rate over the largest rate of the run."),
        (["K0"], "Scale factor at low rates and at T0"),
        (["INCONCLUSIVE"], "The uncertainty reaches across the limit"),
        (["ARW"], "Coefficient N of the Allan deviation"),
        (["guard", "band"], "JCGM 106:2012, 8.3"),
    ],
)
def test_a_term_is_explained(words: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["explain", *words]) == 0
    assert says in " ".join(capsys.readouterr().out.split())


def test_both_meanings_of_a_word_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["explain", "deadband"]) == 0
    text = capsys.readouterr().out
    assert "effect of the gyro's chain" in text
    assert "Width of the interval of rates about zero" in " ".join(text.split())


def test_an_unknown_term_is_one_line_and_exit_2(tmp_path: Path) -> None:
    ran = benchctl("explain", "termal_lag", "--json", tmp_path / "e.json")
    assert (ran.returncode, ran.stdout) == (2, "")
    assert ran.stderr == "benchctl: explain 'termal_lag': there is no such term: did you mean thermal_lag?\n"
    told = json.loads((tmp_path / "e.json").read_text())
    assert told["ok"] is False


def test_the_json_has_what_the_page_needs(tmp_path: Path) -> None:
    assert run_verb(["explain", "dead_zone", "--json", str(tmp_path / "e.json"), "--quiet"]) == 0
    told = json.loads((tmp_path / "e.json").read_text(encoding="utf-8"))
    assert (told["schema"], told["ok"], told["name"], told["group"]) == (
        "benchctl-explain/1",
        True,
        "dead_zone",
        "gyro",
    )
    assert told["parameters"][0]["unit"] == "°/s"
    assert told["symbols"] == {"ω": "true rate, °/s"}
    assert told["look_alikes"] == ["rate_nonlinearity"]
    assert [one["kind"] for one in told["also_means"]] == ["metric"]
    assert run_verb(["explain", "--json", str(tmp_path / "all.json"), "--quiet"]) == 0
    every = json.loads((tmp_path / "all.json").read_text(encoding="utf-8"))["terms"]
    assert {"name": "thermal_lag", "group": "gyro"} in every


@pytest.mark.parametrize("columns", ["80", "100"])
def test_it_fits_the_terminal(
    columns: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    assert run_verb(["explain", "noise_rate_dependent"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= int(columns)
    assert max(map(len, lines)) > int(columns) - 12


def test_nothing_heavy_is_imported() -> None:
    heavy = ("scipy.signal", "scipy.stats", "matplotlib", "h5py", "jinja2")
    code = (
        "import sys; from benchctl.cli.app import run_verb; run_verb(['explain', 'thermal_lag', '-q']);"
        f"print([name for name in {heavy!r} if name in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"
