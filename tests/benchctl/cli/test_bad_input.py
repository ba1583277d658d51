"""Bad input: one clear line on stderr, exit status 2, no traceback, nothing half-written."""

import json
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import template
from benchctl.cli.app import run_verb
from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit
from benchctl.recordings.writer import write_recording

Refused = Callable[..., str]


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Refused:
    """Run a verb that must refuse, in an empty folder; returns its one line."""
    monkeypatch.chdir(tmp_path)

    def refuse(*arguments: str | Path) -> str:
        status = run_verb([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert status == 2
        assert captured.out == ""
        lines = captured.err.splitlines()
        assert len(lines) == 1
        assert lines[0].startswith("benchctl: ")
        return lines[0].removeprefix("benchctl: ")

    return refuse


def _a_recording(path: Path) -> Path:
    info = StepInfo(index=1, name="rest", kind="static", t_start=0.0, t_end=1.0, chamber_setpoint_c=20.0)
    times_s = np.arange(100) / 100.0
    channels = {"time_s": times_s, "encoder_deg": np.zeros(100), "gyro_v": np.zeros(100), "gyro_temp_c": times_s + 20.0}
    meta = Meta(status="complete", unit=Unit(serial="1", range_dps=100.0), bench=BenchFacts(sample_rate_hz=100.0))
    write_recording(path, meta, [Step(info, channels)])
    return path


def test_a_procedure_that_exceeds_the_benchs_limits_names_the_step_and_the_limit(refused: Refused) -> None:
    line = refused("run", "rate_sweep", "--bench", "simulated", "-p", "top_rate_dps=400", "--quiet")
    assert line.startswith("procedure rate_sweep, step 2")
    assert "the bench's limit is 300 deg/s" in line
    line = refused("check", "rate_sweep", "--bench", "simulated", "-p", "top_rate_dps=400", "--quiet")
    assert "go beyond it; the first is step" in line
    assert not Path("results").exists()


def test_an_unknown_parameter_gets_a_hint(refused: Refused) -> None:
    line = refused("run", "two_stage", "--bench", "simulated", "-p", "point=5")
    assert line == "procedure two_stage has no parameter 'point': did you mean points?"


@pytest.mark.parametrize(
    ("text", "says"),
    [("points", "expected NAME=VALUE"), ("=5", "expected NAME=VALUE"), ("points=five", "expected a whole number")],
)
def test_a_parameter_that_is_none_is_refused(refused: Refused, text: str, says: str) -> None:
    assert says in refused("run", "two_stage", "--bench", "simulated", "-p", text)


def test_a_parameter_given_twice_is_refused(refused: Refused) -> None:
    assert "given twice" in refused("check", "static", "--bench", "simulated", "-p", "at_c=1", "-p", "at_c=2")


def test_an_unknown_procedure_gets_a_hint(refused: Refused) -> None:
    assert "did you mean two_stage?" in refused("run", "twostage", "--bench", "simulated")


def test_a_wrong_field_of_bench_toml_is_named_with_file_and_line(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(template().replace("range_dps = 175.0", "range_dps = 'fast'"))
    assert refused("run", "static", "--bench", "bench.toml").startswith("bench.toml, line 14: unit.range_dps: ")


def test_a_wrong_field_of_the_physics_is_named(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(template() + "\n[physics.gyro]\nK0 = 1.0\n")
    assert "[physics.gyro] K0: no such field" in refused("run", "static", "--bench", "bench.toml")


def test_an_unknown_model_is_named_with_those_there_are(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(template().replace('"acutrol3000"', '"acutrol300"'))
    assert "did you mean acutrol3000?" in refused("run", "static", "--bench", "bench.toml")


def test_instruments_that_do_not_answer_are_all_named_with_where_and_what_was_tried(
    refused: Refused, tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        dead = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    text = template().replace("simulated = true", "simulated = false")
    for name in ("rate_table", "chamber", "digitizer"):
        text = text.replace(f"[{name}]\n", f'[{name}]\naddress = "{dead}"\n')
    (tmp_path / "bench.toml").write_text(text)
    for verb in ("run", "check"):
        line = refused(verb, "static", "--bench", "bench.toml", "--quiet")
        assert line.count(dead) >= 3
        assert [name in line for name in ("rate_table: ", "chamber: ", "digitizer: ")] == [True] * 3
        assert "connect" in line
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize("verb", ["show", "verify", "fit"])
def test_a_recording_cut_short_says_so(refused: Refused, tmp_path: Path, verb: str) -> None:
    path = _a_recording(tmp_path / "cut.h5")
    path.write_bytes(path.read_bytes()[:-2000])
    line = refused(verb, path)
    assert str(path) in line
    assert "cut short" in line


@pytest.mark.parametrize("verb", ["show", "verify", "fit"])
@pytest.mark.parametrize("content", [b"", b"not HDF5 at all", b"\x89HDF\r\n\x1a\n"])
def test_a_file_that_is_not_hdf5_says_so(refused: Refused, tmp_path: Path, verb: str, content: bytes) -> None:
    path = tmp_path / "text.h5"
    path.write_bytes(content)
    line = refused(verb, path)
    assert str(path) in line
    assert "HDF5" in line or "cut short" in line


def test_a_recording_that_is_not_there_says_so(refused: Refused) -> None:
    for verb in ("show", "verify", "fit"):
        assert "absent.h5" in refused(verb, "absent.h5")


def test_usage_errors_are_one_line_too(refused: Refused) -> None:
    assert "--bench" in refused("run", "static")
    assert "there is no option --bnech: did you mean --bench?" in refused("run", "static", "--bnech", "simulated")
    assert "nonsense" in refused("nonsense")
    assert "xlsx" in refused("export", "x.h5", "--to", "xlsx")


def test_init_never_overwrites(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text("mine")
    assert "is there already" in refused("init", ".")
    assert (tmp_path / "bench.toml").read_text() == "mine"


def test_the_json_of_a_verb_that_refuses_holds_the_error(refused: Refused, tmp_path: Path) -> None:
    line = refused("run", "two_stage", "--bench", "simulated", "-p", "point=5", "--json", "out.json")
    document = json.loads((tmp_path / "out.json").read_text())
    assert document == {"schema": "benchctl-run/1", "ok": False, "error": line}


def test_a_campaigns_folder_that_holds_something_is_not_written_into(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "precious").write_text("mine")
    line = refused("run", "static", "--bench", "simulated", "--out", "full", "--quiet")
    assert "full" in line
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["precious"]


def test_a_place_for_results_that_cannot_be_made_is_named(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    line = refused("fit", _a_recording(tmp_path / "r.h5"), "--out", "file/deeper")
    assert "--out file/deeper: cannot be made" in line


def test_a_recording_without_motion_cannot_be_fitted_and_says_so(refused: Refused, tmp_path: Path) -> None:
    line = refused("fit", _a_recording(tmp_path / "r.h5"))
    assert "motion" in line or "rate" in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["r.h5"]


def test_a_result_file_that_cannot_be_written_is_refused_before_any_work(refused: Refused, tmp_path: Path) -> None:
    line = refused("run", "two_stage", "--bench", "simulated", "--json", "absent/out.json")
    assert "--json absent/out.json: its folder is not there" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("where", ["folder", ""])
def test_a_result_file_that_is_a_folder_is_refused_before_any_work(
    refused: Refused, tmp_path: Path, where: str
) -> None:
    (tmp_path / "folder").mkdir()
    line = refused("run", "static", "--bench", "simulated", "--json", where)
    assert "is a folder; name a file" in line
    assert not (tmp_path / "results").exists()


def test_simulate_does_not_put_its_recording_into_a_folder_of_that_name(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    assert "-o folder: is a folder" in refused("simulate", "static", "-o", "folder")
    assert list((tmp_path / "folder").iterdir()) == []


def test_a_name_that_no_disk_can_hold_is_one_line(refused: Refused, tmp_path: Path) -> None:
    for arguments in (["show"], ["run", "static", "--bench", "simulated", "--out"], ["check", "static", "--bench"]):
        assert "too long" in refused(*arguments, "x" * 300)


def test_a_seed_below_zero_is_refused_wherever_it_stands(refused: Refused, tmp_path: Path) -> None:
    assert "--seed" in refused("run", "static", "--bench", "simulated", "--seed", "-1")
    (tmp_path / "bench.toml").write_text(template().replace("\nseed = 1", "\nseed = -1"))
    assert "seed is -1" in refused("check", "static", "--bench", "bench.toml", "--quiet")


@pytest.mark.parametrize("option", ["timeout_s = 'soon'", "reply_terminator = 5", "status_bits = 5", "tiemout_s = 1.0"])
def test_options_that_a_driver_cannot_be_opened_with_are_named(refused: Refused, tmp_path: Path, option: str) -> None:
    (tmp_path / "bench.toml").write_text(f"{template()}\n[rate_table.options]\n{option}\n")
    line = refused("check", "static", "--bench", "bench.toml", "--quiet")
    assert "rate_table" in line
    assert option.partition(" ")[0] in line or "rate_table.options" in line


def test_a_text_that_hdf5_cannot_keep_is_refused_before_anything_moves(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(template().replace("SIM-0001", "SIM\\u0000"))
    assert "unit_serial = 'SIM\\x00'" in refused("run", "static", "--bench", "bench.toml", "--quiet")


def test_init_needs_a_folder(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    assert "file: cannot be made into a folder" in refused("init", "file")


def test_a_recording_that_is_there_is_not_written_over(refused: Refused, tmp_path: Path) -> None:
    path = _a_recording(tmp_path / "mine.h5")
    before = path.read_bytes()
    assert "is there already" in refused("simulate", "static", "-o", path)
    assert "is there already" in refused("import", tmp_path, "-o", path)
    assert path.read_bytes() == before
