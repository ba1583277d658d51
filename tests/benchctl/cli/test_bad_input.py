"""Bad input: one clear line on stderr, exit status 2, no traceback, nothing half-written."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import template
from benchctl.cli.app import run_verb
from benchctl.recordings.hdf5_guard import note_own
from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit
from benchctl.recordings.writer import write_recording
from tests.benchctl.cli.processes import benchctl

Refused = Callable[..., str]


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Refused:
    """Run a verb that must refuse, in an empty folder; returns its one line."""
    monkeypatch.chdir(tmp_path)

    def refuse(*arguments: str | Path, status: int = 2) -> str:
        assert run_verb([str(argument) for argument in arguments]) == status
        captured = capsys.readouterr()
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
    assert line.endswith("(limits.rate_dps); 13 more steps have this problem")
    assert not Path("results").exists()


def test_an_unknown_parameter_gets_a_hint(refused: Refused) -> None:
    line = refused("run", "two_stage", "--bench", "simulated", "-p", "point=5")
    assert line == "procedure two_stage has no parameter 'point': did you mean points?"


@pytest.mark.parametrize(
    ("text", "says"),
    [("points", "expected NAME=VALUE"), ("=5", "expected NAME=VALUE"), ("points=five", "expected an integer")],
)
def test_a_parameter_that_is_none_is_refused(refused: Refused, text: str, says: str) -> None:
    assert says in refused("run", "two_stage", "--bench", "simulated", "-p", text)


@pytest.mark.parametrize("text", ["points=100000000", "points=-3", "points=0", "rates=0", "rates=1001"])
@pytest.mark.parametrize("verb", ["check", "run", "simulate"])
def test_a_number_out_of_range_is_refused_at_once_by_every_verb_that_takes_one(
    refused: Refused, verb: str, text: str
) -> None:
    more = ("-o", "a.h5") if verb == "simulate" else ()
    name, _, value = text.partition("=")
    line = refused(verb, "two_stage", "--bench", "simulated", "-p", text, *more)
    assert line.startswith(f"parameter {name}: expected 1 to 1000, got {value}; its default is ")


def test_a_bench_of_a_million_keys_is_refused_unread(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text("".join(f"k{number} = 1\n" for number in range(1_000_000)))
    line = refused("check", "static", "--bench", "bench.toml")
    assert line == "bench bench.toml: is larger than 0.15 MB, which no such file needs"


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
        line = refused(verb, "static", "--bench", "bench.toml", "--quiet", status=3)
        assert line.count(dead) == 3
        assert [name in line for name in ("rate_table: ", "chamber: ", "digitizer: ")] == [True] * 3
        assert "connect" in line
    assert not (tmp_path / "results").exists()
    refused("doctor", "--bench", "bench.toml", "--quiet", status=3)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("timeout_s = -1", "chamber: address 'tcp://127.0.0.1:9': a time-out of -1 s; give a finite one above 0"),
        ("unti_id = 3", "chamber.options: watlow_f4t has no option 'unti_id': did you mean unit_id?"),
    ],
)
@pytest.mark.parametrize("verb", ["run", "check", "doctor"])
def test_an_instrument_that_cannot_be_used_as_it_is_described_is_unusable_input(
    refused: Refused, tmp_path: Path, verb: str, options: str, says: str
) -> None:
    text = template().replace("simulated = true", "simulated = false")
    for name in ("rate_table", "chamber", "digitizer"):
        text = text.replace(f"[{name}]\n", f'[{name}]\naddress = "tcp://127.0.0.1:9"\n')
    (tmp_path / "bench.toml").write_text(text.replace("[chamber]", f"[chamber]\noptions = {{ {options} }}"))
    arguments = ("--bench", "bench.toml", "--quiet")
    line = refused("doctor", *arguments) if verb == "doctor" else refused(verb, "static", *arguments)
    assert line == says or verb == "doctor"


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
    assert "folder: is a folder" in refused("simulate", "static", "-o", "folder")
    assert list((tmp_path / "folder").iterdir()) == []


def test_a_name_that_no_disk_can_hold_is_one_line(refused: Refused, tmp_path: Path) -> None:
    for arguments in (["show"], ["run", "static", "--bench", "simulated", "--out"], ["check", "static", "--bench"]):
        assert "too long" in refused(*arguments, "x" * 300)


def _things(folder: Path) -> None:
    """What somebody may name by mistake, by its name."""
    (folder / "folder.h5").mkdir()
    (folder / "folder").mkdir()
    (folder / "empty.h5").touch()
    (folder / "garbage.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(range(256)) * 8)
    note_own(folder / "garbage.h5")  # that a child opens such a file first, the tests of recordings show
    (folder / "text").write_text("hello\n")
    (folder / "list.json").write_text("[1, 2, 3]")
    (folder / "loop.h5").symlink_to("loop.h5")
    os.mkfifo(folder / "pipe.h5")


THINGS = (
    "absent.h5",
    "folder.h5",
    "folder",
    "empty.h5",
    "garbage.h5",
    "text",
    "list.json",
    "loop.h5",
    "pipe.h5",
    "",
    "x" * 300,
)


@pytest.mark.parametrize(
    "arguments",
    [
        ("show", "?"),
        ("verify", "?"),
        ("recover", "?"),
        ("fit", "?"),
        ("fit", "r.h5", "?"),
        ("allan", "?"),
        ("diagnose", "?"),
        ("diagnose", "r.h5", "--model", "?"),
        ("compare", "?", "r.h5"),
        ("compare", "r.h5", "?"),
        ("accept", "?", "--limits", "limits.toml"),
        ("accept", "r.h5", "--limits", "?"),
        ("apply", "r.h5", "--coefficients", "?"),
        ("import", "?", "-o", "out.h5"),
        ("import", "text", "--map", "?", "-o", "out.h5"),
        ("export", "?", "--to", "mat", "-o", "out.mat"),
        ("simulate", "static", "--model", "?", "-o", "out.h5"),
        ("check", "static", "--bench", "?", "--offline"),
        ("check", "?", "--bench", "simulated", "--offline"),
        ("run", "static", "--bench", "?", "--dry-run"),
        ("run", "--again", "?", "--dry-run"),
        ("run", "static", "--bench", "simulated", "--resume", "?"),
        ("run", "static", "--bench", "simulated", "--answers", "?", "--dry-run"),
        ("sim", "--bench", "?"),
    ],
    ids=" ".join,
)
def test_whatever_is_named_by_mistake_is_refused_in_one_line(
    refused: Refused, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    _things(tmp_path)
    _a_recording(tmp_path / "r.h5")
    (tmp_path / "limits.toml").write_text('[limits.bias]\nhigh = 5\nunit = "deg/h"\n')
    there = sorted(tmp_path.rglob("*"))
    for thing in THINGS:
        if thing == "empty.h5" and {"--answers", "--model"} & {*arguments} and "r.h5" not in arguments:
            continue  # a file without answers is one, and so is a model that changes nothing
        assert refused(*(argument.replace("?", thing) for argument in arguments)), thing
        assert sorted(tmp_path.rglob("*")) == there, thing


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read anything")
@pytest.mark.parametrize("thing", ["secret.h5", "secret", "secret/r.h5"])
@pytest.mark.parametrize("verb", ["show", "verify", "recover", "fit", "allan"])
def test_what_may_not_be_read_is_refused_in_one_line(refused: Refused, tmp_path: Path, verb: str, thing: str) -> None:
    (tmp_path / "secret").mkdir(mode=0)
    (tmp_path / "secret.h5").touch(mode=0)
    assert "permission denied" in refused(verb, thing) or "not readable" in refused(verb, thing)


def test_a_result_is_not_put_in_the_place_of_a_pipe_or_a_device(refused: Refused, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    _a_recording(tmp_path / "r.h5")
    assert run_verb(["show", "r.h5", "-q", "--json", "pipe"]) == 2
    assert (tmp_path / "pipe").is_fifo()


def test_a_name_that_is_no_text_is_refused_as_it_can_be_shown(refused: Refused) -> None:
    assert refused("show", "\udcff.h5") == r"'\udcff.h5': expected a name in UTF-8; rename it"


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
def test_a_terminal_without_the_character_gets_its_number(monkeypatch: pytest.MonkeyPatch, encoding: str) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", f"{encoding}:strict")
    ended = benchctl("procedures")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ("chamber, \\xb0C" in ended.stdout) == (encoding == "ascii")


@pytest.mark.parametrize("verb", ["check", "run"])
def test_a_place_for_a_campaign_below_a_file_is_refused(refused: Refused, tmp_path: Path, verb: str) -> None:
    (tmp_path / "file").touch()
    more = ("--offline",) if verb == "check" else ("--dry-run",)
    line = refused(verb, "static", "--bench", "simulated", "--out", "file/c", "-q", *more)
    assert line == f"file/c: cannot be created, {tmp_path}/file is a file; name another folder"


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


STOPPED_EARLY = """
import sys

class Stop:
    def find_spec(self, name, path=None, target=None):
        if name == "benchctl.cli.messages":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Stop())
from benchctl.cli import main
main()
"""


def test_ctrl_c_while_the_program_is_being_loaded_is_one_line() -> None:
    ended = subprocess.run([sys.executable, "-c", STOPPED_EARLY, "procedures"], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (130, "benchctl: stopped\n")
