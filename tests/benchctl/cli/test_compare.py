"""`benchctl compare`: two recordings of one procedure, or one beside the models of its gyro."""

import json
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from benchctl.cli.app import run_verb
from tests.benchctl.diagnosis.moving import K0, NOISE_V, RATE_DPS, SIMULATION, write_moving
from tests.benchctl.reports.page import Page


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


def compare(*arguments: str | Path) -> int:
    return run_verb(["compare", *map(str, arguments)])


def test_a_recording_stands_beside_the_labs_model_and_the_new_one(capsys: pytest.CaptureFixture[str]) -> None:
    write_moving(Path("real.h5"), squared_v=1e-5)
    effects = {"rate_squared": {"v_per_dps2": 1e-5}}
    Path("new.toml").write_text(
        tomli_w.dumps({"format": "benchctl-model/1", "simulation": SIMULATION, "effects": effects})
    )
    assert compare("real.h5", "--model", "new.toml", "--json", "out.json") == 0
    told = json.loads(Path("out.json").read_text())
    assert told["schema"] == "benchctl-compare/1"
    assert told["against"] == ["the lab's model", "the new model"]
    turning = told["steps"][1]
    assert turning["mean_v"]["the lab's model"] == pytest.approx(1e-5 * RATE_DPS**2, rel=0.02)
    assert turning["rms_v"]["the new model"] == pytest.approx(NOISE_V, rel=0.1)
    assert told["noise_v"] == pytest.approx(NOISE_V, rel=0.05)
    rate = told["coordinates"]["rate"]
    assert rate["mean_v"]["the lab's model"][-1] == pytest.approx(1e-5 * 60.0**2, rel=0.15)
    assert "step, rms of measured less simulated" in capsys.readouterr().out
    page = Page(Path(told["report"]).read_text(encoding="utf-8"))
    assert told["report"] == "real.diagnosis/comparison.html"
    assert len(page.figures) == 3
    assert page.refers_elsewhere() == []
    assert "Comparison: real.h5" in page.words
    assert "constant_rate at +23 constant rate 16." in page.words


def test_a_model_with_two_effects_of_one_kind_predicts_both() -> None:
    write_moving(Path("real.h5"))
    tables = {
        "heading_dependent_bias": {"amplitude_v": 0.04, "phase_deg": 0.0, "order": 1.0},
        "heading_dependent_bias_2": {"amplitude_v": 0.04, "phase_deg": 90.0, "order": 2.0},
    }
    Path("new.toml").write_text(
        tomli_w.dumps({"format": "benchctl-model/1", "simulation": SIMULATION, "effects": tables})
    )
    assert compare("real.h5", "--model", "new.toml", "--json", "out.json", "--quiet") == 0
    turning = json.loads(Path("out.json").read_text())["steps"][1]
    assert turning["rms_v"]["the lab's model"] == pytest.approx(NOISE_V, rel=0.1)
    angle = np.radians(RATE_DPS * np.arange(0.0, 8.0, 1 / 200.0))
    both = 0.04 * np.cos(angle) - 0.04 * np.cos(2.0 * angle)
    assert turning["rms_v"]["the new model"] == pytest.approx(np.sqrt(np.mean(both**2)), rel=0.05)


def test_two_recordings_of_one_procedure_are_laid_over_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    write_moving(Path("real.h5"))
    write_moving(Path("simulated.h5"), K0_v_per_dps=0.99 * K0, phase=0.7, seed=3, kinds=("static", "sine", "sine"))
    assert compare("simulated.h5", "real.h5", "--json", "out.json") == 0
    out = capsys.readouterr().out
    assert "only in the real one: constant_rate at +23" in out
    assert "report: real.diagnosis/comparison.html" in out
    told = json.loads(Path("out.json").read_text())
    assert told["against"] == ["simulated.h5"]
    sine = told["steps"][1]
    assert sine["rms_v"]["simulated.h5"] == pytest.approx(0.01 * K0 * 60 / np.sqrt(2), rel=0.05)
    assert "only in the simulated one: sine at +23" in told["remarks"]


def test_a_recording_is_not_compared_with_itself(capsys: pytest.CaptureFixture[str]) -> None:
    write_moving(Path("real.h5"))
    Path("copy.h5").write_bytes(Path("real.h5").read_bytes())
    assert compare("real.h5", "copy.h5") == 2
    assert "the samples are identical" in capsys.readouterr().err
    assert sorted(path.name for path in Path().iterdir()) == ["copy.h5", "real.h5"]


def test_a_program_that_asks_for_json_alone_gets_that(capsys: pytest.CaptureFixture[str]) -> None:
    write_moving(Path("real.h5"))
    assert compare("real.h5", "--json", "out.json", "--quiet") == 0
    assert capsys.readouterr() == ("", "")
    assert sorted(path.name for path in Path().iterdir()) == ["out.json", "real.h5"]
    assert "report" not in json.loads(Path("out.json").read_text())


def test_a_recording_that_names_no_model_needs_something_to_be_compared_with(
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_moving(Path("real.h5"), simulation=None)
    assert compare("real.h5") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "names no model that it could be compared with; name one with --model FILE" in line
    assert not Path("real.diagnosis").exists()


def test_two_recordings_and_a_model_are_one_too_many(capsys: pytest.CaptureFixture[str]) -> None:
    write_moving(Path("real.h5"))
    assert compare("real.h5", "real.h5", "--model", "m.toml") == 2
    assert "two recordings, or one and --model FILE" in capsys.readouterr().err


def test_a_comparison_with_a_model_says_where_it_did_not_look_at_all_rows(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_moving(Path("real.h5"), squared_v=1e-5)
    monkeypatch.setattr("benchctl.diagnosis.gyro.problem.most_rows", lambda: 2400)
    monkeypatch.setattr("benchctl.diagnosis.gyro.subsample.PIECE", 200)
    assert compare("real.h5", "--json", "out.json") == 0
    assert "The recording has 4,800 rows: 2,400 of them were looked at" in capsys.readouterr().out
    told = json.loads(Path("out.json").read_text())
    turning = next(step for step in told["steps"] if step["kind"] == "constant_rate")
    assert turning["mean_v"]["the lab's model"] == pytest.approx(1e-5 * RATE_DPS**2, rel=0.02)


def test_two_recordings_that_memory_would_not_hold_are_refused_beforehand(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_moving(Path("real.h5"))
    write_moving(Path("simulated.h5"), seed=1)
    monkeypatch.setattr("benchctl.limits.memory_bytes", lambda: 1_500_000)
    assert compare("simulated.h5", "real.h5") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "real.h5: laying it and simulated.h5 over each other needs" in line
    assert "this machine has 0.0015 GB; split the recording, or use a larger machine" in line
    assert sorted(path.name for path in Path().iterdir()) == ["real.h5", "simulated.h5"]


@pytest.mark.slow
def test_the_same_comparison_is_the_same_page() -> None:
    write_moving(Path("real.h5"))
    assert compare("real.h5", "--out", "a", "--quiet") == 0
    assert compare("real.h5", "--out", "b", "--quiet") == 0
    assert Path("a/comparison.html").read_bytes() == Path("b/comparison.html").read_bytes()
