"""`benchctl sim`: the simulated instruments answer programs that are not ours."""

import itertools
import json
import re
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from pymodbus import FramerType
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from benchctl.bench import load_bench, template
from benchctl.recordings.reader import open_recording
from benchctl_instruments.catalog import MANUAL, models
from tests.benchctl.cli.processes import benchctl, simulated_servers, started, without_a_process
from tests.documented import handbook
from tests.instruments.chambers.lab_controllers import ACME

needs_terminals = pytest.mark.skipif(sys.platform == "win32", reason="a pty is a thing of POSIX")


def bench_with(path: Path, chamber: str, more: str = "", *, table: str = "acutrol3000") -> Path:
    """A bench.toml of simulated instruments with this chamber and rate table; `more` goes into the chamber's table."""
    bench = template().replace('model = "watlow_f4t"', f'model = "{chamber}"\n{more}')
    path.write_text(bench.replace('model = "acutrol3000"', f'model = "{table}"'))
    return path


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, dict[str, str]]]:
    """The bench.toml that the servers wrote, and the addresses that they said; they run for the tests of this file."""
    path = tmp_path_factory.mktemp("served") / "bench.toml"
    with simulated_servers(path, "--speed", "20") as addresses:
        yield path, addresses


def test_one_line_of_json_names_the_addresses_and_all_of_them_answer(served: tuple[Path, dict[str, str]]) -> None:
    _, addresses = served
    assert set(addresses) == {"rate_table", "chamber", "digitizer", "digitizer_stream"}
    table = urlsplit(addresses["rate_table"])
    with socket.create_connection((table.hostname, table.port), timeout=5) as line, line.makefile("rb") as replies:
        line.sendall(b":int:close 1\r\n:mode:rate 1\r\n:dem:rate 1,10\r\n:mode? 1\r\n")
        answers = [replies.readline() for _ in range(4)]
        assert [answer[8:].strip() for answer in answers] == [b"OK", b"OK", b"OK", b"Rate"]
    digitizer = urlsplit(addresses["digitizer"])
    with ModbusTcpClient(str(digitizer.hostname), port=int(digitizer.port or 0)) as client:
        assert client.read_holding_registers(55100, count=2).registers == [0x0011, 0x2233]
    chamber = urlsplit(addresses["chamber"])
    with ModbusTcpClient(str(chamber.hostname), port=int(chamber.port or 0)) as client:
        words = client.read_holding_registers(2820, count=2).registers
        air_c = client.convert_from_registers(words, client.DATATYPE.FLOAT32, word_order="little")
        assert air_c == pytest.approx(23.0, abs=0.5)


def test_the_bench_file_that_it_writes_reaches_the_servers(served: tuple[Path, dict[str, str]]) -> None:
    path, addresses = served
    bench = load_bench(str(path))
    assert not bench.simulated
    assert bench.time_factor == 20.0
    assert bench.rate_table.address == addresses["rate_table"]
    assert bench.digitizer.stream_address == addresses["digitizer_stream"]


@pytest.mark.skipif(sys.platform == "win32", reason="a pty is a thing of POSIX")
def test_the_bench_file_that_it_writes_finds_a_profile_of_the_labs_own_from_another_folder(tmp_path: Path) -> None:
    lab, written = tmp_path / "lab" / "bench.toml", tmp_path / "another" / "sim.toml"
    for path in (lab, written):
        path.parent.mkdir()
    lab.write_text(template().replace('"watlow_f4t"', '"acme_9.toml"'), encoding="utf-8")
    (lab.parent / "acme_9.toml").write_text(ACME, encoding="utf-8")
    with started("sim", "--bench", lab, "--write-bench", written) as process:
        assert process.stdout is not None
        address = json.loads(process.stdout.readline())["chamber"]
    bench = load_bench(str(written))
    assert (bench.chamber.address, bench.chamber_profile) == (address, ACME)


@needs_terminals
def test_the_serial_chamber_answers_a_foreign_modbus_client_on_its_pty(tmp_path: Path) -> None:
    bench = bench_with(tmp_path / "serial.toml", "watlow_f4", "options = {unit_id = 7}")
    with started("sim", "--bench", bench) as process:
        assert process.stdout is not None
        address = json.loads(process.stdout.readline())["chamber"]
        port = address.removeprefix("serial://").partition("?")[0]
        with ModbusSerialClient(port, framer=FramerType.RTU, baudrate=19200) as client:
            assert client.read_holding_registers(100, count=1, device_id=7).registers[0] == pytest.approx(230, abs=3)
            client.write_register(300, (-400) & 0xFFFF, device_id=7)
            assert client.read_holding_registers(300, count=1, device_id=7).registers == [0xFE70]


@needs_terminals
def test_somebody_at_miniterm_sets_the_p300_on_its_serial_line_as_the_handbook_shows_it(tmp_path: Path) -> None:
    from tests.instruments.simulated.miniterm import Miniterm  # needs what Windows does not have

    (shown,) = handbook("first_campaign", "console")
    dialogue = re.findall(r"^> (.*?) {2,}(.*)$", shown.text, re.M)
    assert len(dialogue) >= 7
    bench = bench_with(tmp_path / "bench.toml", "espec_p300", 'address = "serial:///dev/ttyUSB0?baud=9600"')
    with started("sim", "--bench", bench, "--speed", "60", "--write-bench", tmp_path / "sim.toml") as process:
        assert process.stdout is not None
        address = json.loads(process.stdout.readline())["chamber"]
        assert address.startswith("serial:///dev/")
        assert address.endswith("?baud=9600")
        assert load_bench(str(tmp_path / "sim.toml")).chamber.address == address
        with Miniterm(address.removeprefix("serial://").partition("?")[0], baud=9600) as terminal:
            for line, answer in dialogue:
                terminal.type(f"{line}\r")
                said = terminal.next_line()
                if line == "TEMP?":  # how warm it is by now depends on the machine
                    air, said = said.split(",", 1)
                    assert 22.0 < float(air) <= 41.0
                    answer = answer.split(",", 1)[1]
                assert said == answer
            assert terminal.leave() == 0


def test_options_that_no_driver_takes_are_refused_before_anything_is_served(tmp_path: Path) -> None:
    bench = bench_with(tmp_path / "b.toml", "watlow_f4", "options = {unit = 7}")
    ended = without_a_process("sim", "--bench", bench)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert "chamber.options: watlow_f4 has no option 'unit': did you mean unit_id?" in ended.stderr
    assert "Traceback" not in ended.stderr


@needs_terminals
@pytest.mark.slow
@pytest.mark.timeout(180)
@pytest.mark.parametrize(
    ("chamber", "table"),
    list(zip(models("chamber"), itertools.cycle(one for one in models("rate_table") if one != MANUAL), strict=False)),
)
def test_a_run_beside_the_servers_is_complete_with_every_chamber_and_every_table(
    chamber: str, table: str, tmp_path: Path
) -> None:
    run_beside_the_servers(bench_with(tmp_path / "bench.toml", chamber, table=table), speed=100.0)


@needs_terminals
@pytest.mark.slow
@pytest.mark.timeout(180)
@pytest.mark.parametrize("model", models("gyro"))
def test_a_run_beside_the_servers_records_the_frames_of_every_digital_gyro(model: str, tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(f'{template()}[gyro]\nmodel = "{model}"\nframe_rate_hz = 250.0\n', encoding="utf-8")
    with open_recording(run_beside_the_servers(bench, speed=20.0)) as recording:
        streamed = [info for info in recording.infos if info.kind != "soak"]
        assert [(info.frame_rate_hz, info.frames_lost, info.frames_bad) for info in streamed] == [(250.0, 0, 0)] * 4
        for info in streamed:
            step = recording.step(info.index)
            rate_dps = np.median(step["frame_rate_dps"])
            assert rate_dps == pytest.approx(info.rate_dps or 0.0, abs=0.1, rel=0.02)  # it is not compensated


def run_beside_the_servers(bench: Path, *, speed: float) -> Path:
    """The recording of a short sweep that one process ran on the instruments of another."""
    folder = bench.parent
    with started("sim", "--bench", bench, "--speed", str(speed), "--write-bench", folder / "sim.toml") as process:
        assert process.stdout is not None
        process.stdout.readline()
        ran = benchctl(
            *("run", "rate_sweep", "--bench", folder / "sim.toml", "--out", folder / "c", "--json", folder / "r.json"),
            *("-p", "at_c=23", "-p", "soak_s=60", "-p", "top_rate_dps=60", "-p", "rates=1", "-p", "verify=false"),
            *("-p", "run_s=4", "-p", "zero_s=2"),
            timeout_s=150.0,
        )
    assert ran.returncode == 0, ran.stderr
    result = json.loads((folder / "r.json").read_text())
    assert result["status"] == "complete"
    assert result["steps"]["whole"] == result["steps"]["planned"]
    return Path(result["recording"])
