"""`benchctl doctor` as its users run it."""

import json
import sys
from pathlib import Path

import pytest

from benchctl.bench import template
from benchctl.cli.app import run_verb
from tests.benchctl.cli.processes import benchctl, simulated_servers, without_a_process

KEYS = {"where", "what", "verdict", "says", "do"}


def _nowhere(path: Path) -> Path:
    """A bench at whose addresses nobody listens."""
    text = template().replace("simulated = true", "simulated = false")
    for port, model in enumerate(("acutrol3000", "watlow_f4t", "labjack_t7"), start=1):
        text = text.replace(f'model = "{model}"', f'model = "{model}"\naddress = "tcp://127.0.0.1:{port}"')
    path.write_text(text, encoding="utf-8")
    return path


def test_this_machine_and_the_simulated_bench_are_fine(tmp_path: Path) -> None:
    ran = benchctl("doctor", "--bench", "simulated", "--out", tmp_path / "r", "--json", tmp_path / "told.json")
    assert (ran.returncode, ran.stderr) == (0, "")
    told = json.loads((tmp_path / "told.json").read_text())
    assert (told["schema"], told["ok"]) == ("benchctl-doctor/1", True)
    assert all(finding.keys() == KEYS for finding in told["findings"])
    assert {finding["verdict"] for finding in told["findings"]} <= {"ok", "look"}
    identities = [finding["where"] for finding in told["findings"] if finding["what"] == "identity"]
    assert identities == ["rate_table", "chamber", "digitizer"]
    assert ran.stdout.startswith("This machine\n  ok    Python ")
    assert ran.stdout.splitlines()[-1].startswith("nothing is bad")
    assert not (tmp_path / "r").exists()


def test_a_bench_that_does_not_answer_is_status_3_and_every_instrument_is_told(tmp_path: Path) -> None:
    bench = _nowhere(tmp_path / "bench.toml")
    ran = without_a_process("doctor", "--bench", bench, "--out", tmp_path, "--json", tmp_path / "told.json")
    assert ran.returncode == 3
    told = json.loads((tmp_path / "told.json").read_text())
    refused = {each["where"] for each in told["findings"] if "refuses that port" in each["says"]}
    assert refused == {"rate_table", "chamber", "digitizer"}
    assert told["ok"] is False
    assert ran.stderr == f"benchctl: {told['error']}\n"
    assert told["error"].endswith("findings are bad: rate_table, chamber, digitizer")
    assert "; first rate_table, connection: start what serves port 1 there" in ran.stdout.splitlines()[-1]
    assert "-> start what serves port 2 there" in ran.stdout


def test_a_wrong_bench_file_is_status_2_and_the_machine_is_looked_at_all_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(template().replace("rate_dps = 300.0", "rate_dps = 0"), encoding="utf-8")
    assert run_verb(["doctor", "--bench", str(bench), "--out", str(tmp_path), "--json", "-"]) == 2
    out, err = capsys.readouterr()
    told = json.loads(out)
    (wrong,) = [finding for finding in told["findings"] if finding["verdict"] == "bad"]
    assert (wrong["where"], wrong["what"]) == ("bench", "bench.toml")
    assert "line 18: limits.rate_dps: expected a number above 0, got 0" in wrong["says"]
    assert {"machine", "results", "ports"} <= {finding["where"] for finding in told["findings"]}
    assert err == "benchctl: 1 of {} findings is bad: bench\n".format(len(told["findings"]))


def test_quiet_says_nothing_where_nothing_is_bad(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["doctor", "--out", str(tmp_path), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.skipif(sys.platform == "win32", reason="a pty is a thing of POSIX")
@pytest.mark.slow
def test_real_servers_are_asked_at_their_addresses(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    with simulated_servers(bench) as addresses:
        ran = benchctl("doctor", "--bench", bench, "--out", tmp_path)
    assert (ran.returncode, ran.stderr) == (0, "")
    for role, model in (("rate_table", "acutrol3000"), ("chamber", "watlow_f4t"), ("digitizer", "labjack_t7")):
        assert f"answers as {model} at {addresses[role]}: " in ran.stdout
