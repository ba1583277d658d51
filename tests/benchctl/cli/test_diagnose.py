"""`benchctl diagnose` around an engine that answers at once: what is asked of it, what becomes of its answer."""

import io
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchctl.cli import terminal
from benchctl.cli.app import run_verb
from benchctl.cli.terminal import search_progress
from benchctl.diagnosis.result import Diagnosis
from benchctl.plan.find import find_procedure
from benchctl.recordings.reader import Recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.diagnosis.example import nothing_missing, pair
from tests.benchctl.diagnosis.moving import SIMULATION, write_moving
from tests.benchctl.recordings.open_folder import write_open


class Engine:
    """Stands in for the search; notes what it was asked."""

    def __init__(self) -> None:
        self.answers: list[Diagnosis | BaseException] = []
        self.asked: list[dict[str, Any]] = []
        self.steps: list[int] = []

    def diagnose(self, recording: Recording, **options: Any) -> Diagnosis:
        self.asked.append(options)
        self.steps.append(len(recording.infos))
        answer = self.answers.pop(0) if self.answers else _small(pair())
        if isinstance(answer, BaseException):
            raise answer
        return replace(answer, recording=str(recording.path))


def _small(diagnosis: Diagnosis) -> Diagnosis:
    """Quick to draw."""
    return replace(diagnosis, slices=diagnosis.slices[:1], steps=diagnosis.steps[:5], traces=())


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Engine:
    made = Engine()
    monkeypatch.setattr("benchctl.diagnosis.diagnose", made.diagnose, raising=False)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return made


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return write_moving(tmp_path / "sweep.h5")


def diagnose(*arguments: str | Path) -> int:
    return run_verb(["diagnose", *map(str, arguments)])


def test_the_report_and_the_model_land_beside_a_file_in_a_folder_of_its_name(
    engine: Engine, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert diagnose(recording) == 0
    told = capsys.readouterr()
    folder = recording.with_name("sweep.diagnosis")
    assert f"report: {folder / 'diagnosis.html'}" in told.out
    assert f"model: {folder / 'model.toml'}" in told.out
    assert told.out.startswith("missing-physics: The data demand physics that the model does not have: thermal lag")
    assert told.err == ""
    assert "Diagnosis: sweep.h5" in (folder / "diagnosis.html").read_text(encoding="utf-8")
    assert "tau_s = 590.8" in (folder / "model.toml").read_text(encoding="utf-8")
    (options,) = engine.asked
    assert options == {"model": None, "part": "gyro", "seed": 0, "progress": None}


def test_nothing_is_written_into_somebody_elses_folder(engine: Engine, tmp_path: Path) -> None:
    theirs = write_open(tmp_path / "theirs")
    before = sorted(theirs.iterdir())
    assert diagnose(theirs) == 0
    assert sorted(theirs.iterdir()) == before
    assert sorted(path.name for path in Path("theirs.diagnosis").iterdir()) == [
        "diagnosis.html",
        "diagnosis.json",
        "model.toml",
    ]


def test_a_program_that_asks_for_json_alone_gets_that_and_nothing_else(
    engine: Engine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    theirs = write_open(tmp_path / "theirs")
    assert diagnose(theirs, "--json", "out.json", "--quiet") == 0
    assert capsys.readouterr() == ("", "")
    assert [path.name for path in Path().iterdir()] == ["out.json"]
    told = json.loads(Path("out.json").read_text())
    assert (told["schema"], told["ok"], told["recording"]) == ("benchctl-diagnosis/2", True, "theirs")
    assert told["findings"][0]["parameters"]["tau_s"]["value"] == 590.8
    assert str(tmp_path) not in Path("out.json").read_text()


def test_json_on_stdout_is_all_that_is_there(
    engine: Engine, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert diagnose(recording, "--json", "-") == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "missing-physics"


def test_where_no_report_can_be_written_the_json_is_and_a_line_says_so(
    engine: Engine, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording.with_name("sweep.diagnosis").write_text("in the way")
    assert diagnose(recording, "--json", "out.json") == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert "no report is written; name another place with --out DIR" in line
    assert json.loads(Path("out.json").read_text())["ok"] is True


def test_where_nothing_could_be_written_the_search_is_not_begun(
    engine: Engine, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording.with_name("sweep.diagnosis").write_text("in the way")
    assert diagnose(recording) == 2
    assert "name another place for the results with --out DIR" in capsys.readouterr().err
    assert diagnose(recording, "--out", recording) == 2
    assert diagnose(recording, "--next", "next.txt") == 2
    assert "ends in .py" in capsys.readouterr().err
    assert engine.asked == []


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_is_read_only_is_seen_before_the_search(engine: Engine, recording: Path) -> None:
    recording.parent.chmod(0o555)
    assert diagnose(recording) == 2
    assert engine.asked == []


def test_several_recordings_of_one_unit_are_diagnosed_jointly(engine: Engine, recording: Path, tmp_path: Path) -> None:
    other = write_moving(tmp_path / "later.h5", seed=1)
    assert diagnose(recording, other, "--json", "out.json", "--quiet") == 0
    assert engine.steps == [6]
    assert json.loads(Path("out.json").read_text())["recording"] == "sweep.h5 + later.h5"


def test_recordings_of_two_units_are_not(
    engine: Engine, recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = write_moving(tmp_path / "other.h5", serial="G-2")
    assert diagnose(recording, other) == 2
    assert "different units: G-1, G-2" in capsys.readouterr().err


def test_the_labs_model_may_be_named_and_its_effects_are_still_looked_for(
    engine: Engine, recording: Path, tmp_path: Path
) -> None:
    import tomli_w

    model = tmp_path / "lab.toml"
    document: dict[str, Any] = {"format": "benchctl-model/1", "simulation": SIMULATION}
    model.write_text(tomli_w.dumps({**document, "effects": {"thermal_lag": {"tau_s": 100.0}}}))
    assert diagnose(recording, "--model", model, "--seed", "7", "--json", "o.json", "--quiet") == 0
    (options,) = engine.asked
    assert (options["model"], options["part"], options["seed"]) == (SIMULATION, "gyro", 7)
    assert "The effects of lab.toml (thermal_lag)" in json.loads(Path("o.json").read_text())["notes"][-1]


def test_of_another_part_the_model_is_its_own_table(engine: Engine, recording: Path, tmp_path: Path) -> None:
    (tmp_path / "lab.toml").write_text(
        "[parts.drive]\ninertia_kg_m2 = 0.05\nviscous_nm_s = 0.03\n"
        "[parts.drive.effects.coulomb_friction]\ncoulomb_nm = 0.02\n"
    )
    assert diagnose(recording, "--part", "drive", "--model", tmp_path / "lab.toml", "--json", "o.json", "--quiet") == 0
    (options,) = engine.asked
    assert options["part"] == "drive"
    assert options["model"]["inertia_kg_m2"] == 0.05
    assert "The effects of lab.toml (coulomb_friction)" in json.loads(Path("o.json").read_text())["notes"][-1]


@pytest.mark.parametrize(
    ("unit", "told"), [("V", "1.94\u00a0mV"), ("N m", "1.94\u00a0mN\u00a0m"), ("K", "1.94\u00a0mK")]
)
def test_sizes_are_told_in_the_unit_of_what_was_measured(
    engine: Engine, recording: Path, capsys: pytest.CaptureFixture[str], unit: str, told: str
) -> None:
    engine.answers.append(replace(_small(pair()), fit=replace(pair().fit, unit=unit)))
    assert diagnose(recording) == 0
    assert f"rms: {told} (" in capsys.readouterr().out


@pytest.mark.parametrize(("part", "table"), [("gyro", "[simulation]"), ("chamber", "[parts.chamber]")])
def test_a_model_file_without_the_part_is_refused(
    engine: Engine, recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], part: str, table: str
) -> None:
    (tmp_path / "m.toml").write_text('format = "benchctl-model/1"\n')
    assert diagnose(recording, "--part", part, "--model", tmp_path / "m.toml") == 2
    assert f"has no {table}" in capsys.readouterr().err
    assert engine.asked == []


def test_the_next_experiment_is_written_so_that_it_can_be_run(
    engine: Engine, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert diagnose(recording, "--next", "next.py") == 0
    assert "next experiment: benchctl run next.py --bench bench.toml" in capsys.readouterr().out
    written = find_procedure("next.py")
    assert written.expand().steps == find_procedure("temperature_sweep").expand({"points": "3"}).steps
    assert written.says.startswith("Soak cold, then ramp up")


def test_where_nothing_is_open_no_experiment_is_written(
    engine: Engine, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.answers = [_small(nothing_missing())]
    assert diagnose(recording, "--next", "next.py") == 0
    assert "nothing is left open: next.py is not written" in capsys.readouterr().out
    assert not Path("next.py").exists()


def test_settle_runs_the_experiment_on_the_bench_of_the_recording_and_diagnoses_both(
    engine: Engine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = ("-p", "duration_s=2", "-p", "soak_s=60")
    made = tmp_path / "made.h5"
    assert run_verb(["simulate", "static", *short, "-o", str(made), "--seed", "5"]) == 0
    following = replace(pair().next_experiment, procedure="static", parameters={"duration_s": 2.0, "soak_s": 60.0})
    engine.answers = [replace(_small(pair()), next_experiment=following), _small(nothing_missing())]
    capsys.readouterr()
    assert diagnose(made, "--settle", "--json", "out.json") == 0
    assert engine.steps == [2, 4]
    (ran,) = Path("results").iterdir()
    assert f"next experiment run: {ran / 'recording.h5'}" in capsys.readouterr().out
    told = json.loads(Path("out.json").read_text())
    assert (told["verdict"], told["recording"]) == ("consistent", f"made.h5 + {ran.name}")


def test_settle_does_not_move_what_is_no_simulated_bench(
    engine: Engine, recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert diagnose(recording, "--settle") == 2
    assert "was not made by a simulated bench" in capsys.readouterr().err
    from benchctl.bench import template

    real = template().replace("simulated = true", "simulated = false")
    for role in ("rate_table", "chamber", "digitizer"):
        real = real.replace(f"[{role}]", f'[{role}]\naddress = "tcp://127.0.0.1:1"', 1)
    (tmp_path / "bench.toml").write_text(real[: real.index("[physics]")])
    assert diagnose(recording, "--settle", "--bench", tmp_path / "bench.toml") == 2
    assert "is no simulated bench; write the experiment with --next" in capsys.readouterr().err
    assert engine.asked == []


def test_ctrl_c_ends_the_search_with_a_line_and_nothing_half_written(
    engine: Engine, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.answers = [KeyboardInterrupt()]
    before = sorted(recording.parent.iterdir())
    assert diagnose(recording, "--json", "out.json", "--next", "next.py") == 130
    assert capsys.readouterr().err.strip().splitlines() == ["benchctl: stopped"]
    assert sorted(recording.parent.iterdir()) == before
    assert list(Path().iterdir()) == []


def test_settle_says_where_there_is_nothing_to_run(
    engine: Engine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = tmp_path / "made.h5"
    assert run_verb(["simulate", "static", "-p", "duration_s=2", "-p", "soak_s=60", "-o", str(made)]) == 0
    engine.answers = [_small(nothing_missing())]
    assert diagnose(made, "--settle") == 0
    assert "nothing is left open: no experiment was run" in capsys.readouterr().out
    assert len(engine.asked) == 1


def test_what_cannot_be_diagnosed_is_one_line_also_for_programs(
    engine: Engine, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.answers = [UsageError("sweep.h5: 12 samples are too few")]
    assert diagnose(recording, "--json", "out.json") == 2
    assert capsys.readouterr().err == "benchctl: sweep.h5: 12 samples are too few\n"
    told = json.loads(Path("out.json").read_text())
    assert (told["ok"], told["error"]) == (False, "sweep.h5: 12 samples are too few")
    assert not recording.with_name("sweep.diagnosis").exists()


def test_a_recording_that_was_changed_is_not_diagnosed(
    engine: Engine, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import h5py

    with h5py.File(recording, "r+") as file:
        file["steps"][next(iter(file["steps"]))]["gyro_v"][5] = 1.0
    assert diagnose(recording) == 2
    assert "changed since it was written, and so not diagnosed" in capsys.readouterr().err
    assert engine.asked == []


class _Window(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_sees_what_is_tried_and_how_long_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    window = _Window()
    monkeypatch.setattr("sys.stderr", window)
    monkeypatch.setattr(terminal, "REDRAW_S", 0.0)
    with search_progress(quiet=False) as progress:
        assert progress is not None
        progress("thermal_lag", 0.0)
        progress("encoder_eccentricity", 0.5)
    assert "thermal_lag" in window.getvalue()
    assert "encoder_eccentricity" in window.getvalue()
    assert " s left" in window.getvalue()


@pytest.mark.parametrize("make", [io.StringIO, _Window], ids=["a pipe", "--quiet"])
def test_nobody_is_told_where_nobody_looks(make: Callable[[], io.StringIO], monkeypatch: pytest.MonkeyPatch) -> None:
    stream = make()
    monkeypatch.setattr("sys.stderr", stream)
    with search_progress(quiet=isinstance(stream, _Window)) as progress:
        assert progress is None
    assert stream.getvalue() == ""


def test_values_that_are_not_finite_do_not_break_the_json(engine: Engine, recording: Path) -> None:
    engine.answers = [replace(_small(pair()), threshold=math.inf)]
    assert diagnose(recording, "--json", "out.json", "--quiet") == 0
    assert json.loads(Path("out.json").read_text())["threshold"] is None


STARTED = """
import os, sys
sys.argv = ["benchctl", "diagnose", "--help"]
from benchctl.cli.app import main
try:
    main()
finally:
    with open("/proc/self/environ") as began_with:
        print("MALLOC_MMAP_MAX_=0" in began_with.read().split("\\0"), "MALLOC_MMAP_MAX_" in os.environ)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks for the C library of Linux")
def test_a_diagnosis_begins_with_a_c_library_that_keeps_memory_and_its_children_do_not() -> None:
    ran = subprocess.run([sys.executable, "-c", STARTED], capture_output=True, text=True, check=True)
    assert "benchctl diagnose" in ran.stdout
    assert ran.stdout.splitlines()[-1] == "True False"
