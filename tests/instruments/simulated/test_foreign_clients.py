"""The simulated chambers answer programs that others wrote for real ones, as their documentation uses them.

pymodbus' clients, minimalmodbus, a laboratory's driver for its own Watlow F4, and a person at pyserial's terminal.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Iterator

import pytest
from pymodbus import FramerType, ModbusException
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient, ModbusSerialClient, ModbusTcpClient

from benchctl_instruments.simulated.espec_p300 import SimulatedEspecP300
from benchctl_instruments.simulated.watlow_f4 import SimulatedWatlowF4
from benchctl_instruments.simulated.watlow_f4t import SimulatedWatlowF4T
from tests.instruments.chamber_machine import FakeChamber

needs_terminals = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")


@pytest.fixture
def machine() -> FakeChamber:
    chamber = FakeChamber()
    chamber.air, chamber.setpoint = -12.5, 20.0
    return chamber


@pytest.fixture
def f4_port(machine: FakeChamber) -> Iterator[str]:
    """The device of an F4's serial line."""
    with SimulatedWatlowF4(machine) as f4:
        yield serial_port(f4.address)


def serial_port(address: str) -> str:
    return address.removeprefix("serial://").partition("?")[0]


def tcp_port(address: str) -> int:
    return int(address.rpartition(":")[2])


def read_and_set_f4(client: ModbusSerialClient | ModbusTcpClient) -> list[float]:
    """Air and set point in °C, then the set point after -40 °C was written: registers 100 and 300, signed tenths."""
    assert client.connect()
    words = [*client.read_holding_registers(100, device_id=1).registers]
    words += client.read_holding_registers(300, device_id=1).registers
    minus_40 = client.convert_to_registers(-400, client.DATATYPE.INT16)
    assert not client.write_register(300, int(minus_40[0]), device_id=1).isError()
    words += client.read_holding_registers(300, device_id=1).registers
    assert client.write_register(300, 2000, device_id=1).exception_code == 3  # beyond its limit of 180 °C
    client.close()  # type: ignore[no-untyped-call]
    tenths = client.convert_from_registers(words, client.DATATYPE.INT16)
    assert isinstance(tenths, list)
    return [float(value) / 10 for value in tenths]


@needs_terminals
@pytest.mark.foreign_client("watlow_f4", "pymodbus, serial", "reads and sets", package="pymodbus")
def test_pymodbus_serial_client_reads_and_sets_the_f4(machine: FakeChamber, f4_port: str) -> None:
    client = ModbusSerialClient(f4_port, framer=FramerType.RTU, baudrate=19200, bytesize=8, parity="N", stopbits=1)
    assert read_and_set_f4(client) == [-12.5, 20.0, -40.0]
    assert machine.setpoint == -40.0


@pytest.mark.foreign_client("watlow_f4", "pymodbus, RTU over TCP", "reads and sets", package="pymodbus")
def test_pymodbus_tcp_client_with_rtu_frames_reads_and_sets_the_f4_behind_a_serial_server(machine: FakeChamber) -> None:
    with SimulatedWatlowF4(machine, over_tcp=True) as f4:
        client = ModbusTcpClient("127.0.0.1", port=tcp_port(f4.address), framer=FramerType.RTU)
        assert read_and_set_f4(client) == [-12.5, 20.0, -40.0]
    assert machine.setpoint == -40.0


@needs_terminals
@pytest.mark.foreign_client("watlow_f4", "pymodbus, asynchronous serial", "reads and sets", package="pymodbus")
def test_pymodbus_asynchronous_serial_client_reads_and_sets_the_f4(machine: FakeChamber, f4_port: str) -> None:
    async def session() -> list[int]:
        client = AsyncModbusSerialClient(f4_port, framer=FramerType.RTU, baudrate=19200)
        assert await client.connect()
        air = (await client.read_holding_registers(100, device_id=1)).registers
        assert not (await client.write_registers(300, [855], device_id=1)).isError()
        setpoint = (await client.read_holding_registers(300, device_id=1)).registers
        client.close()
        return [*air, *setpoint]

    assert asyncio.run(session()) == [0x10000 - 125, 855]
    assert machine.setpoint == 85.5


@needs_terminals
def test_a_unit_that_is_not_on_the_f4s_line_stays_silent_for_pymodbus(f4_port: str) -> None:
    with ModbusSerialClient(f4_port, baudrate=19200, timeout=0.4, retries=1) as client:
        with pytest.raises(ModbusException, match="No response"):
            client.read_holding_registers(100, device_id=2)
        assert client.read_holding_registers(300, device_id=1).registers == [200]


@pytest.mark.foreign_client("watlow_f4t", "pymodbus, TCP", "reads and sets", package="pymodbus")
def test_pymodbus_tcp_client_reads_and_sets_the_f4t(machine: FakeChamber) -> None:
    with (
        SimulatedWatlowF4T(machine) as f4t,
        ModbusTcpClient("127.0.0.1", port=tcp_port(f4t.address)) as client,
    ):
        single = client.DATATYPE.FLOAT32

        def read(address: int) -> object:
            words = client.read_holding_registers(address, count=2, device_id=1).registers
            return client.convert_from_registers(words, single, word_order="little")

        assert [read(2820), read(2782), read(2810)] == [-12.5, 20.0, 20.0]
        words = client.convert_to_registers(-40.25, single, word_order="little")
        assert not client.write_registers(2782, [int(word) for word in words], device_id=1).isError()
        assert [read(2782), read(2810), machine.setpoint] == [-40.25] * 3
        too_hot = client.convert_to_registers(200.0, single, word_order="little")
        assert client.write_registers(2782, [int(word) for word in too_hot], device_id=1).exception_code == 3


@pytest.mark.foreign_client("watlow_f4t", "pymodbus, asynchronous TCP", "40 requests at once", package="pymodbus")
def test_pymodbus_asynchronous_tcp_client_has_many_requests_answered_by_the_f4t(machine: FakeChamber) -> None:
    async def session(port: int) -> list[object]:
        client = AsyncModbusTcpClient("127.0.0.1", port=port)
        assert await client.connect()
        asked = [client.read_holding_registers(2820 if even else 2782, count=2) for even in (1, 0) * 20]
        replies = await asyncio.gather(*asked)
        client.close()
        single = client.DATATYPE.FLOAT32
        return [client.convert_from_registers(reply.registers, single, word_order="little") for reply in replies]

    with SimulatedWatlowF4T(machine) as f4t:
        assert asyncio.run(session(tcp_port(f4t.address))) == [-12.5, 20.0] * 20


@needs_terminals
@pytest.mark.foreign_client("watlow_f4", "minimalmodbus", "reads and sets, refusals", package="minimalmodbus")
def test_minimalmodbus_reads_and_sets_the_f4_in_signed_tenths(machine: FakeChamber, f4_port: str) -> None:
    minimalmodbus = pytest.importorskip("minimalmodbus")
    controller = minimalmodbus.Instrument(f4_port, 1)
    controller.serial.baudrate = 19200
    controller.serial.timeout = 1.0  # it waits that long for the rest of a refusal, which is shorter than an answer
    with controller.serial:
        assert controller.read_register(100, 1, signed=True) == -12.5
        assert controller.read_register(300, 1, signed=True) == 20.0
        for setpoint_c, function in ((-40.0, 16), (85.5, 6)):
            controller.write_register(300, setpoint_c, 1, functioncode=function, signed=True)
            assert machine.setpoint == controller.read_register(300, 1, signed=True) == setpoint_c
        with pytest.raises(minimalmodbus.IllegalRequestError, match="illegal data value"):
            controller.write_register(300, 200.0, 1, signed=True)
    assert machine.setpoint == 85.5


@needs_terminals
@pytest.mark.foreign_client("watlow_f4", "watlow-f4", "reads and sets", package="watlow-f4")
def test_a_laboratorys_own_driver_for_its_watlow_f4_runs_on_the_simulated_one(
    machine: FakeChamber, f4_port: str
) -> None:
    """watlow-f4, by a laboratory with an F4 in a TestEquity 107; it reads back what it sets."""
    chamber = pytest.importorskip("watlow_f4").WatlowF4(f4_port)
    with chamber.instrument.serial:
        assert (chamber.temperature, chamber.temperature_setpoint) == (-12.5, 20.0)
        chamber.temperature_setpoint = -33.3
        assert chamber.temperature_setpoint == machine.setpoint == -33.3


@needs_terminals
@pytest.mark.parametrize("serial", [True, False], ids=["serial", "tcp"])
@pytest.mark.foreign_client("espec_p300", "pyserial's miniterm", "a person types commands", package="pyserial")
def test_somebody_at_pyserials_miniterm_reads_and_sets_the_p300(machine: FakeChamber, serial: bool) -> None:
    from tests.instruments.simulated.miniterm import Miniterm  # needs what Windows does not have

    with SimulatedEspecP300(machine, over_tcp=not serial) as p300:
        port = serial_port(p300.address) if serial else f"socket://127.0.0.1:{tcp_port(p300.address)}"
        with Miniterm(port, baud=9600) as terminal:
            for line, answer in (
                ("TEMP?", "-12.5,20.0,180.0,-75.0"),
                ("TEMP, S-40.0", "OK:TEMP,S-40.0"),
                ("temp, s200", "NA:DATA OUT OF RANGE"),
                ("MODE,CONSTANT", "OK:MODE,CONSTANT"),
                ("MON?", "-12.5,,CONSTANT,0"),
                ("HELLO", "NA:CMD ERR"),
            ):
                terminal.type(f"{line}\r")
                assert terminal.next_line() == answer
            assert terminal.leave() == 0
    assert (machine.setpoint, machine.on) == (-40.0, True)
