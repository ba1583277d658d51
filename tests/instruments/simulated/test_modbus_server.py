"""The servers as foreign programs see them: pymodbus' own clients, pyserial, and plain sockets with literal bytes."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator

import pytest
import serial
from pymodbus import FramerType
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from benchctl_instruments.errors import LinkError
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.links.modbus import ModbusLink
from benchctl_instruments.protocols.modbus import with_crc
from benchctl_instruments.simulated.modbus_server import ModbusRtuServer, ModbusTcpServer
from tests.instruments.modbus_device import Memory

READ_5 = bytes.fromhex("01 03 00 05 00 01 94 0B")
FIVE = bytes.fromhex("01 03 02 00 05 78 47")


@pytest.fixture
def memory() -> Memory:
    return Memory()


@pytest.fixture
def tcp(memory: Memory) -> Iterator[socket.socket]:
    with ModbusTcpServer(memory, unit_id=1) as server:
        address = parse_address(server.address)
        with socket.create_connection((address.host, address.port), timeout=1.0) as connection:
            yield connection


@pytest.fixture(params=[False, True], ids=["pty", "over tcp"])
def line(request: pytest.FixtureRequest, memory: Memory) -> Iterator[serial.SerialBase]:
    with ModbusRtuServer(memory, unit_id=1, over_tcp=request.param) as server:
        port = serial.serial_for_url(parse_address(server.address).pyserial_url, timeout=0.2)
        yield port
        port.close()


def read_exactly(connection: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += connection.recv(size - len(data))
    return data


def test_pymodbus_over_tcp_reads_writes_and_is_refused(memory: Memory) -> None:
    with ModbusTcpServer(memory, unit_id=1) as server:
        client = ModbusTcpClient("127.0.0.1", port=parse_address(server.address).port)
        client.connect()  # type: ignore[no-untyped-call]
        assert client.read_holding_registers(3, count=2, device_id=1).registers == [3, 4]
        assert client.read_input_registers(3, count=2, device_id=1).registers == [3, 4]
        assert not client.write_register(3, 77, device_id=1).isError()
        assert not client.write_registers(4, [78, 79], device_id=1).isError()
        assert client.read_holding_registers(99, count=2, device_id=1).exception_code == 2
        assert client.read_coils(0, count=1, device_id=1).exception_code == 1
        client.close()  # type: ignore[no-untyped-call]
    assert memory.words[3:6] == [77, 78, 79]


def test_pymodbus_over_a_pty_and_over_rtu_in_tcp_reads_and_writes(memory: Memory) -> None:
    with ModbusRtuServer(memory, unit_id=1) as server, ModbusRtuServer(memory, unit_id=1, over_tcp=True) as networked:
        on_line = ModbusSerialClient(parse_address(server.address).pyserial_url, baudrate=115200)
        in_tcp = ModbusTcpClient(
            "127.0.0.1", port=parse_address(networked.address).port, framer=FramerType.RTU, timeout=1.0
        )
        for value, client in ((501, on_line), (502, in_tcp)):
            client.connect()
            assert not client.write_registers(8, [value, value], device_id=1).isError()
            assert client.read_holding_registers(7, count=4, device_id=1).registers == [7, value, value, 10]
            client.close()  # type: ignore[no-untyped-call]


def test_pipelined_requests_are_answered_in_order_each_with_its_transaction(tcp: socket.socket) -> None:
    tcp.sendall(
        bytes.fromhex("00 67 00 00 00 06 01 03 00 05 00 01")
        + bytes.fromhex("00 68 00 00 00 06 01 06 00 05 00 63")
        + bytes.fromhex("00 69 00 00 00 06 01 03 00 05 00 01")
    )
    assert read_exactly(tcp, 11 + 12 + 11) == bytes.fromhex(
        "00 67 00 00 00 05 01 03 02 00 05  00 68 00 00 00 06 01 06 00 05 00 63  00 69 00 00 00 05 01 03 02 00 63"
    )


def test_another_unit_is_silent_over_tcp_and_the_next_request_is_answered(tcp: socket.socket) -> None:
    tcp.sendall(
        bytes.fromhex("00 01 00 00 00 06 02 03 00 05 00 01")
        + bytes.fromhex("00 02 00 00 00 06 00 03 00 05 00 01")
        + bytes.fromhex("00 03 00 00 00 06 01 03 00 05 00 01")
    )
    assert read_exactly(tcp, 11) == bytes.fromhex("00 03 00 00 00 05 01 03 02 00 05")


def test_a_server_without_a_unit_of_its_own_answers_as_whatever_unit_is_asked(memory: Memory) -> None:
    with ModbusTcpServer(memory, unit_id=None) as server:
        client = ModbusTcpClient("127.0.0.1", port=parse_address(server.address).port)
        client.connect()  # type: ignore[no-untyped-call]
        assert client.read_holding_registers(3, device_id=200).registers == [3]
        client.close()  # type: ignore[no-untyped-call]


def test_a_serial_line_answers_literal_bytes(line: serial.SerialBase) -> None:
    line.write(READ_5)
    assert line.read(len(FIVE)) == FIVE


@pytest.mark.parametrize(
    "pdu",
    [
        "07",
        "08 00 00 12 34",
        "0B",
        "0C",
        "11",
        "16 00 05 00 F2 00 25",
        "17 00 05 00 01 00 05 00 01 02 00 63",
        "18 00 05",
    ],
)
def test_a_function_that_a_device_lacks_is_refused_on_a_serial_line_too(line: serial.SerialBase, pdu: str) -> None:
    request = bytes.fromhex(pdu)
    line.write(with_crc(b"\x01" + request))
    assert line.read(5) == with_crc(bytes([0x01, request[0] | 0x80, 1]))


def test_noise_and_other_units_on_a_serial_line_are_met_with_silence(line: serial.SerialBase) -> None:
    for_unit_2 = bytes.fromhex("02 03 00 05 00 01 94 38")
    damaged = READ_5[:-1] + b"\x00"
    line.write(b"\x00\xff" + for_unit_2 + damaged)
    assert line.read(1) == b""
    line.write(b"\x01\x10" + READ_5)
    assert line.read(len(FIVE)) == FIVE


def test_a_broadcast_is_carried_out_and_not_answered(line: serial.SerialBase, memory: Memory) -> None:
    line.write(bytes.fromhex("00 06 00 05 00 63 D8 33") + bytes.fromhex("00 03 00 05 00 01 95 DA"))
    assert line.read(1) == b""
    assert memory.words[5] == 0x63


def test_a_client_may_close_the_port_and_another_one_open_it(memory: Memory) -> None:
    with ModbusRtuServer(memory, unit_id=1) as server:
        for _ in range(3):
            with serial.serial_for_url(parse_address(server.address).pyserial_url, timeout=0.5) as port:
                port.write(READ_5)
                assert port.read(len(FIVE)) == FIVE


def test_a_paced_line_takes_the_time_that_a_wire_takes(memory: Memory) -> None:
    with (
        ModbusRtuServer(memory, unit_id=1, pace_baud=4800) as server,
        serial.serial_for_url(parse_address(server.address).pyserial_url, timeout=1.0) as port,
    ):
        started_s = time.monotonic()
        port.write(READ_5)
        assert port.read(len(FIVE)) == FIVE
        took_s = time.monotonic() - started_s
    wire_s = (len(READ_5) + len(FIVE)) * 10 / 4800
    assert wire_s <= took_s < 5 * wire_s


def test_a_stopped_server_is_gone_and_stopping_twice_is_harmless(memory: Memory) -> None:
    for server in (ModbusTcpServer(memory, unit_id=1), ModbusRtuServer(memory, unit_id=1)):
        server.start()
        link = ModbusLink(server.address)
        server.stop()
        server.stop()
        with pytest.raises(LinkError, match=r"refused|no such file"):
            link.open()
