"""`benchctl sim`: the simulated instruments answer programs that are not ours."""

import json
import socket
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from pymodbus import FramerType
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from benchctl.bench import load_bench, template
from tests.benchctl.cli.processes import simulated_servers, started


def test_one_line_of_json_names_the_addresses_and_all_of_them_answer(tmp_path: Path) -> None:
    with simulated_servers(tmp_path / "bench.toml") as addresses:
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


def test_the_bench_file_that_it_writes_reaches_the_servers(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    with simulated_servers(path, "--speed", "20") as addresses:
        bench = load_bench(str(path))
    assert not bench.simulated
    assert bench.time_factor == 20.0
    assert bench.rate_table.address == addresses["rate_table"]
    assert bench.digitizer.stream_address == addresses["digitizer_stream"]


@pytest.mark.skipif(sys.platform == "win32", reason="a pty is a thing of POSIX")
def test_the_serial_chamber_answers_a_foreign_modbus_client_on_its_pty(tmp_path: Path) -> None:
    bench = tmp_path / "serial.toml"
    bench.write_text(template().replace('"watlow_f4t"', '"watlow_f4"'))
    with started("sim", "--bench", bench) as process:
        assert process.stdout is not None
        address = json.loads(process.stdout.readline())["chamber"]
        port = address.removeprefix("serial://").partition("?")[0]
        with ModbusSerialClient(port, framer=FramerType.RTU, baudrate=19200) as client:
            assert client.read_holding_registers(100, count=1, device_id=1).registers[0] == pytest.approx(230, abs=3)
            client.write_register(300, (-400) & 0xFFFF, device_id=1)
            assert client.read_holding_registers(300, count=1, device_id=1).registers == [0xFE70]
