"""The simulated LabJack T7 answers clients that know nothing of this project.

pymodbus' client and plain sockets do what LabJack's public pages show (T-series datasheet 3.2.4, low-level streaming;
the register map ljm_constants.json), and what async_labjack sends; FEMTO-ST's `scinstr`, a driver for T7s without
LabJack's own library, runs as it is published.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from pymodbus.client import ModbusTcpClient

from benchctl_instruments.links.address import parse_address
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.labjack_t7 import SimulatedLabJackT7
from tests.instruments.simulated.fake_inputs import FakeInputs

TYPES = {"f32": ModbusTcpClient.DATATYPE.FLOAT32, "u32": ModbusTcpClient.DATATYPE.UINT32}
AIN_ALL_RANGE, AIN_ALL_NEGATIVE_CH, AIN_ALL_RESOLUTION_INDEX, AIN_ALL_SETTLING_US = 43900, 43902, 43903, 43904


@pytest.fixture
def inputs() -> FakeInputs:
    return FakeInputs(VirtualClock())


@pytest.fixture
def t7(inputs: FakeInputs) -> Iterator[SimulatedLabJackT7]:
    with SimulatedLabJackT7(inputs) as running:
        yield running


class Client(ModbusTcpClient):
    """pymodbus' client, with numbers of 32 bits; an exception of the device is its code, negative."""

    def get(self, address: int, kind: str = "u32") -> float:
        answer = self.read_holding_registers(address, count=1 if kind == "u16" else 2)
        if answer.isError():
            return -answer.exception_code
        found = answer.registers[0] if kind == "u16" else self.convert_from_registers(answer.registers, TYPES[kind])
        assert isinstance(found, int | float)
        return found

    def put(self, address: int, value: float, kind: str = "u32") -> int:
        words = [int(value)] if kind == "u16" else self.convert_to_registers(value, TYPES[kind])
        answer = self.write_registers(address, words)
        return -answer.exception_code if answer.isError() else 0


@pytest.fixture
def client(t7: SimulatedLabJackT7) -> Iterator[Client]:
    connected = Client("127.0.0.1", port=parse_address(t7.address).port)
    assert connected.connect()
    yield connected
    connected.close()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize(
    ("address", "kind", "value"),
    [
        (55100, "u32", 0x00112233),
        (55110, "u16", 0x11),
        (55120, "u32", 0x00112233),
        (55122, "u32", 0x8899AABB),
        (55124, "f32", -9999.0),
        (60000, "f32", 7.0),
        (60028, "u32", 470_012_345),
        (40000, "f32", 10.0),
        (41000, "u16", 199),
        (41254, "u16", 199),
        (AIN_ALL_NEGATIVE_CH, "u16", 199),
        (4016, "u32", 0),
        (48003, "u16", 1),
    ],
)
def test_pymodbus_reads_what_the_register_map_states_as_the_default(
    client: Client, address: int, kind: str, value: float
) -> None:
    assert client.get(address, kind) == value


@pytest.mark.parametrize(
    ("address", "kind", "value"),
    [
        (1000, "f32", 2.5),
        (2005, "u16", 0),
        (42026, "f32", 500.0),
        (44300, "u32", 4000),
        (44904, "u32", 1600),
        (46000, "f32", 3.25),
        (46078, "f32", -1.5),
        (46100, "u32", 0xFFFFFFFF),
        (46199, "u16", 0xABCD),
        (55124, "f32", 0.5),
        (61604, "u32", 60),
    ],
)
@pytest.mark.foreign_client("labjack_t7", "pymodbus, TCP", "registers of the public map", package="pymodbus")
def test_pymodbus_writes_and_reads_back_what_a_t7_keeps_until_it_is_rebooted(
    client: Client, address: int, kind: str, value: float
) -> None:
    before = client.get(address, kind)
    assert client.put(address, value, kind) == 0
    assert client.get(address, kind) == value != before
    assert client.put(61998, 0x4C4A0000) == 0
    assert client.get(address, kind) == before


def test_settings_of_all_inputs_are_written_at_once_and_read_as_mixed_where_they_differ(client: Client) -> None:
    assert client.put(AIN_ALL_RANGE, 1.0, "f32") == 0
    assert [client.get(40000 + 2 * channel, "f32") for channel in (0, 13, 254)] == [1.0] * 3
    assert client.put(40002, 0.1, "f32") == 0
    assert client.get(AIN_ALL_RANGE, "f32") == -9999.0
    assert client.put(41002, 3, "u16") == 0
    assert client.get(AIN_ALL_NEGATIVE_CH, "u16") == 0xFFFF


@pytest.mark.parametrize("address", [4494, 4998, 6000, 60030])
def test_pymodbus_gets_illegal_data_address_for_a_register_that_is_not_there(client: Client, address: int) -> None:
    assert client.get(address) == client.put(address, 0) == -2


def test_what_can_only_be_written_or_only_be_read_is_refused_the_other_way(client: Client) -> None:
    assert client.get(49002) == client.put(60028, 1) == -2


def test_a_device_name_is_kept(client: Client) -> None:
    name = "North bench".ljust(50, "\0").encode()
    words = list(struct.unpack(">25H", name))
    assert not client.write_registers(60500, words).isError()
    assert client.read_holding_registers(60500, count=25).registers == words


def test_the_stream_of_a_client_without_any_library(t7: SimulatedLabJackT7, client: Client, inputs: FakeInputs) -> None:
    """Stop what may run, configure, connect to the stream's port, enable, read the actual rate, read packets."""
    scan_list, scans_a_packet = (3000, 4899, 0), 10
    for line in (0, 1):
        assert (
            client.put(44000 + 2 * line, 0) == client.put(44100 + 2 * line, 10) == client.put(44000 + 2 * line, 1) == 0
        )
    assert client.put(4990, 0) == -4
    assert client.get(55000, "u16") == 2620
    assert client.put(AIN_ALL_RANGE, 10.0, "f32") == client.put(AIN_ALL_NEGATIVE_CH, 199, "u16") == 0
    assert client.put(AIN_ALL_RESOLUTION_INDEX, 0, "u16") == client.put(AIN_ALL_SETTLING_US, 0.0, "f32") == 0
    assert client.put(4002, 3000.0, "f32") == client.put(4008, 0.0, "f32") == 0
    values = {
        4004: len(scan_list),
        4006: scans_a_packet * len(scan_list),
        4010: 0,
        4012: 4096,
        4014: 0,
        4016: 1,
        4020: 0,
    }
    assert [client.put(address, value) for address, value in values.items()] == [0] * len(values)
    assert [client.put(4100 + 2 * place, address) for place, address in enumerate(scan_list)] == [0, 0, 0]
    with socket.create_connection(("127.0.0.1", parse_address(t7.stream_address).port), timeout=10.0) as stream:
        assert client.put(4990, 1) == 0
        rate_hz = client.get(4002, "f32")
        assert rate_hz == 3000.300048828125
        inputs.clock.sleep(1.0)
        packets = [packet_of(stream, transaction, scans_a_packet * len(scan_list)) for transaction in range(300)]
    assert client.put(4990, 0) == 0
    samples = np.concatenate(packets).reshape(-1, len(scan_list)).astype(np.int64)
    times_s = np.arange(len(samples)) / rate_hz
    assert (samples[:, 0] | samples[:, 1] << 16).tolist() == inputs.counts(times_s).tolist()
    assert samples[:, 2] * 20.0 / 65536 - 10.0 == pytest.approx(inputs.gyro_v(times_s), abs=2e-4)


def packet_of(stream: socket.socket, transaction: int, samples: int) -> np.ndarray[Any, np.dtype[np.uint16]]:
    """The samples of the next packet, whose header is as the datasheet states it."""
    head = stream.recv(16, socket.MSG_WAITALL)
    number, protocol, length, unit, function, kind, reserved, _, status, _ = struct.unpack(">HHHBBBBHHH", head)
    assert (number, protocol, length) == (transaction, 0, 10 + 2 * samples)
    assert (unit, function, kind, reserved, status) == (1, 76, 16, 0, 0)
    return np.frombuffer(stream.recv(2 * samples, socket.MSG_WAITALL), ">u2").astype(np.uint16)


class Feedback:
    """What NSchrading/async_labjack does after it has connected: almost all of it by Modbus Feedback, function 76."""

    def __init__(self, t7: SimulatedLabJackT7) -> None:
        self._wire = socket.create_connection(("127.0.0.1", parse_address(t7.address).port), timeout=10.0)

    def __enter__(self) -> Feedback:
        return self

    def __exit__(self, *exc: object) -> None:
        self._wire.close()

    def ask(self, data: bytes, *, function: int = 76) -> bytes | int:
        """Data of the reply; negative: the code of an exception."""
        self._wire.sendall(struct.pack(">HHHBB", 7, 0, 2 + len(data), 1, function) + data)
        _, _, length, _, answered = struct.unpack(">HHHBB", self._wire.recv(8, socket.MSG_WAITALL))
        come = self._wire.recv(length - 2, socket.MSG_WAITALL)
        assert answered & 0x7F == function
        return -come[0] if answered & 0x80 else come


def reads(address: int, count: int) -> bytes:
    return struct.pack(">BHB", 0, address, count)


def writes(address: int, data: bytes) -> bytes:
    return struct.pack(">BHB", 1, address, len(data) // 2) + data


@pytest.mark.foreign_client("labjack_t7", "NSchrading/async_labjack", "connects, streams, reads the calibration")
def test_async_labjack_connects_streams_and_reads_the_calibration(t7: SimulatedLabJackT7) -> None:
    settings = {4002: (1000.0, "f"), 4004: (2, "I"), 4006: (20, "I"), 4008: (0.0, "f"), 4010: (0, "I")}
    settings |= {4012: (4096, "I"), 4016: (1, "I"), 4020: (0, "I")}
    words = {address: struct.pack(f">{kind}", value) for address, (value, kind) in settings.items()}
    stop = writes(4990, bytes(4)) + reads(4990, 2)
    with Feedback(t7) as client:
        assert client.ask(struct.pack(">HH", 60000, 2), function=4) == b"\x04" + struct.pack(">f", 7.0)
        calibration = client.ask(writes(61810, struct.pack(">I", 0x3C4000)) + reads(61812, 82))
        assert isinstance(calibration, bytes)
        constants = struct.unpack(">41f", calibration)
        assert constants[:4] == constants[16:20] == pytest.approx((10 / 32768, -10 / 32768, 32768.0, -10.0))
        assert constants[32:] == pytest.approx((13200.0, 0.0, 13200.0, 0.0, -92.6, 467.6, 10e-6, 200e-6, 15e-9))
        start = b"".join(writes(address, data) for address, data in (*words.items(), (4018, bytes(4))))
        wanted = b"".join(words.values())
        assert client.ask(start + b"".join(reads(address, 2) for address in words)) == wanted
        scan_list = struct.pack(">HHBII", 4100, 4, 8, 0, 2)
        assert client.ask(scan_list, function=16) == struct.pack(">HH", 4100, 4)
        assert client.ask(writes(4990, struct.pack(">I", 1)) + reads(4990, 2)) == struct.pack(">I", 1)
        assert client.ask(stop) == bytes(4)
        assert client.ask(stop) == -4
        assert client.ask(struct.pack(">HH", 55000, 1), function=4) == b"\x02" + struct.pack(">H", 2620)


def test_what_modbus_feedback_wrote_before_a_refused_frame_stays_written(t7: SimulatedLabJackT7) -> None:
    with Feedback(t7) as client:
        assert client.ask(writes(46000, struct.pack(">f", 2.5)) + reads(4494, 2) + writes(46000, bytes(4))) == -2
        assert client.ask(reads(46000, 2)) == struct.pack(">f", 2.5)
        for broken in (b"\0\0\0", struct.pack(">BHB", 0, 46000, 0), struct.pack(">BHB", 1, 46000, 2) + b"\0\0"):
            assert client.ask(broken) == -3
        assert client.ask(struct.pack(">BHB", 2, 46000, 2)) == -3


def test_the_registers_of_the_last_error_speak_of_the_last_refusal(client: Client) -> None:
    assert client.put(4990, 0) == -4
    assert (client.get(55000, "u16"), client.get(55001, "u16")) == (2620, 4)
    assert client.get(4494) == -2
    assert (client.get(55000, "u16"), client.get(55001, "u16")) == (0, 2)


class OldPymodbus(ModbusTcpClient):
    """pymodbus with the argument `count` in second place, as version 2 had it, for which scinstr was written."""

    def read_input_registers(self, address: int, count: int = 1, **more: Any) -> Any:  # type: ignore[override]
        return super().read_input_registers(address, count=count, **more)


@pytest.fixture
def old_client(t7: SimulatedLabJackT7) -> Iterator[OldPymodbus]:
    with OldPymodbus("127.0.0.1", port=parse_address(t7.address).port) as connected:
        yield connected


@pytest.mark.foreign_client(
    "labjack_t7",
    "scinstr T7, its pymodbus 2 adapted",
    "inputs, counters, watchdog",
    package="scinstr",
)
def test_scinstr_runs_its_t7_as_it_is_published(old_client: OldPymodbus, inputs: FakeInputs) -> None:
    published = pytest.importorskip("scinstr.daq.labjack.t7", reason="scinstr is not installed")
    device = published.T7()
    device._client = old_client
    inputs.clock.sleep(70.0)

    def voltages(*channels: int) -> Sequence[float]:
        found: Sequence[float] = device.get_ains_voltage(list(channels))
        return found

    assert device.check_test_reg()
    assert device.get_id() == 7.0
    assert voltages(0, 1) == pytest.approx([2.0, 0.25], abs=1e-5)
    device.set_ains_range([0, 1], [1.0, 1.0])
    device.set_ains_negative_ch([0, 2], [199, 3])
    device.set_ains_settling([0, 1], [0.0, 100.0])
    assert voltages(0, 1) == pytest.approx([1.0, 0.25], abs=1e-5)
    assert device.read_float32_register(published.AIN_RANGE_ADDR[0]) == 1.0
    assert device.get_current_source_200ua_value() == pytest.approx(200e-6)
    for line in (0, 1):
        device.write_uint32_register(published.DIO_EF_INDEX_ADDR[line], 10)
        device.write_uint32_register(published.DIO_EF_ENABLE_ADDR[line], 1)
    assert device.read_uint32_register(published.DIO_EF_READ_A_ADDR[0]) == 70_000
    assert device.read_uint32_register(published.DIO_EF_READ_A_AND_RESET_ADDR[0]) == 70_000
    assert device.read_uint32_register(published.DIO_EF_READ_A_ADDR[0]) == 0
    assert device.get_high_speed_counter_frequency(0) == 0
    device.set_watchdog(60)
    assert device.read_uint32_register(published.WATCHDOG_TIMEOUT_S_DEFAULT) == 60
    device.set_current_config_as_default()
    device.reboot()
    assert device.read_float32_register(published.AIN_RANGE_ADDR[0]) == 10.0
    assert device.read_uint32_register(published.DIO_EF_ENABLE_ADDR[0]) == 0
