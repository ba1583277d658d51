"""The simulated chambers answer the requests of published clients of the real ones, written down as tables.

The clients need Python 2 or a real port; what they ask, and what they expect, is public: ChamberConnectLibrary of
EspecNorthAmerica for the Watlow F4 and F4T and the ESPEC P300, ovenctl of ecree-solarflare for the Binder MB1, P.
Tobiska's control of Binder chambers for both Binders,
O. Hartbrich's csz_ezt430i for the EZT-430i. The Eurotherms are asked by minimalmodbus itself, with the parameters of
its own example eurotherm3500.py and of eurotherm2000 in hailegroup/nupylab.
"""

from __future__ import annotations

import socket
import struct
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from benchctl_instruments.links.address import parse_address
from benchctl_instruments.simulated.binder_mb1 import SimulatedBinderMb1
from benchctl_instruments.simulated.binder_mb2 import SimulatedBinderMb2
from benchctl_instruments.simulated.csz_ezt430i import SimulatedCszEzt430i
from benchctl_instruments.simulated.espec_p300 import SimulatedEspecP300
from benchctl_instruments.simulated.eurotherm_2400 import SimulatedEurotherm2400
from benchctl_instruments.simulated.eurotherm_3500 import SimulatedEurotherm3500
from benchctl_instruments.simulated.modbus_server import ModbusRtuServer
from benchctl_instruments.simulated.watlow_f4 import SimulatedWatlowF4
from benchctl_instruments.simulated.watlow_f4t import SimulatedWatlowF4T
from tests.instruments.chamber_machine import FakeChamber

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")

Row = tuple[str, int, int | Sequence[int], Sequence[int] | int | None]
"""The client's own name of it; first register; how many are read, or the words that are written; the words that answer,
the code of an exception, or None for a write that is acknowledged. One word goes with function 6, several with 16."""

SOAK = [3, 0, 0, 0, 0, 0, 0, 30, *[0] * 19, 1, *[0] * 13, 850, *[0] * 18]
NEGATIVE_700 = 0x10000 - 700

WATLOW_F4: tuple[Row, ...] = (
    ("process_controller", 319, 1, 2),
    ("process_controller", 1925, 1, [0]),
    ("set_datetime", 1916, [14, 30, 15, 11, 23, 2026], None),
    ("get_datetime", 1916, 6, [14, 30, 15, 11, 23, 2026]),
    ("get_scalar", 606, 1, [1]),
    ("get_loop_sp", 602, 1, [NEGATIVE_700]),
    ("get_loop_sp", 300, 1, [200]),
    ("get_loop_sp", 200, 1, [0]),
    ("get_loop_pv", 100, 1, [230]),
    ("set_loop_range", 602, [NEGATIVE_700, 1700], None),
    ("get_loop_range", 603, 1, [1700]),
    ("get_loop_units", 608, 1, [0]),
    ("get_loop_units", 901, 1, [1]),
    ("get_loop_power", 103, 1, [5000]),
    ("get_loop_power", 107, 1, [0]),
    ("const_start", 1217, [1], None),
    ("const_start", 2000, [1], None),
    ("get_event", 2000, 1, [1]),
    ("get_alarm_status, limit 4", 1067, 1, [1]),
    ("get_alarm_status, limit 4", 237, 1, [0]),  # not as 1067: no alarm
    ("get_prgm_empty", 1060, 1, [0]),
    ("get_prgm_empty", 600, 1, [1]),
    ("get_prgm_empty", 610, 1, 2),
    ("get_prgm_empty", 1219, 1, [256]),
    ("get_prgms", 1218, 1, [40]),
    ("get_prgms", 4000, [1, 1], None),
    ("get_prgms", 4003, 1, [6]),  # above 5: there is no such program
    ("prgm_start of none", 4002, [5], 3),
    ("create_prgm", 4002, [1], None),
    ("create_prgm", 4000, 1, [1]),
    ("set_prgm_name", 3500, [*b"SOAK      "], None),
    ("edit_prgm_step", 4001, [1, 2], None),
    ("edit_prgm_step", 4003, [3], None),
    ("edit_prgm_step", 4012, [0], None),
    ("edit_prgm_step", 4009, [0, 30, 0], None),
    ("edit_prgm_step", 4030, [1], None),
    ("edit_prgm_step", 4044, [850], None),
    ("edit_prgm_step", 4001, [2], None),
    ("edit_prgm_step", 4060, [0], None),
    ("set_prgm", 25, [0], None),
    ("get_prgm", 4000, [1], None),
    ("get_prgm_name", 3500, 10, [*b"SOAK      "]),
    ("get_prgm", 1219, 1, [254]),
    ("get_prgm", 4001, [1], None),
    ("get_prgm", 4003, 60, SOAK),
    ("get_prgm", 4001, [2], None),
    ("get_prgm_steps", 4003, 1, [5]),
    ("prgm_start", 4000, [1], None),
    ("prgm_start", 4001, [1], None),
    ("prgm_start", 2000, [0], None),
    ("prgm_start", 4002, [5], None),
    ("get_event", 2000, 1, [1]),  # the event of the step: the chamber conditions
    ("get_status", 200, 1, [2]),
    ("get_prgm_cur", 4100, 1, [1]),
    ("get_prgm_cstep", 4101, 1, [1]),
    ("get_prgm_cstime", 4119, 3, [0, 0, 0]),
    ("get_loop_sp", 4122, 1, [850]),
    ("get_prgm_counter", 4126, 3, [0, 0, 0]),
    ("prgm_pause", 1210, [1], None),
    ("get_status", 200, 1, [3]),
    ("prgm_resume", 1209, [1], None),
    ("get_status", 200, 1, [2]),
    ("stop", 1217, [1], None),
    ("stop", 2000, [0], None),
    ("get_status", 200, 1, [0]),
    ("prgm_delete", 4000, [1, 1, 3], None),
    ("get_prgms", 1218, 1, [40]),
    ("nothing", 5000, 1, 2),
)


def f4t_single(value: float) -> list[int]:
    """Low word first."""
    low, high = struct.unpack("<HH", struct.pack("<f", value))
    return [low, high]


WATLOW_F4T: tuple[Row, ...] = (
    ("process_controller", 16, 15, [*b"F4T1L1EAA1D1AAA"]),
    *(("process_controller, limits", 11250 + 60 * slot, 1, [61] if slot == 4 else 2) for slot in range(6)),
    ("get_datetime", 14664, 12, [12, 0, 0, 0, 0, 0, 1, 0, 1, 0, 2026, 0]),
    ("set_datetime", 14664, [14], None),
    ("set_datetime", 14674, [2027], None),
    ("get_datetime", 14664, 12, [14, 0, 0, 0, 0, 0, 1, 0, 1, 0, 2027, 0]),
    ("profile_units", 16536, 1, [1540]),
    ("profile_units", 6730, 1, [15]),
    ("get_loop_sp", 2782, 2, f4t_single(20.0)),
    ("get_loop_sp", 2810, 2, f4t_single(20.0)),
    ("get_loop_pv", 2820, 2, f4t_single(23.0)),
    ("set_loop_range", 2776, f4t_single(170.0), None),
    ("get_loop_range", 2776, 2, f4t_single(170.0)),
    ("get_loop_range", 2774, 2, f4t_single(-70.0)),
    ("get_loop_en", 2814, 1, [10]),
    ("set_loop_mode", 2730, [54], None),
    ("set_loop_power", 2784, f4t_single(25.0), None),
    ("get_loop_power", 2784, 2, f4t_single(25.0)),
    ("get_loop_power", 2808, 2, f4t_single(50.0)),
    ("set_loop_mode", 2730, [10], None),
    ("get_status", 16568, 1, [62]),
    *(("get_alarm_status", 1356 + 100 * number, 1, [61] if number < 8 else 2) for number in range(9)),
    ("get_alarm_status, limit 5", 11288 + 240, 1, [61]),
    ("get_alarm_status, limit 5", 11264 + 240, 1, [1667]),
    ("read_io", 33718, 1, [62]),
    ("read_io", 33758, 1, 4),
    ("const_start, momentary key 1", 6850, [1457], None),
    ("read_io", 33718, 1, [63]),
    ("stop, momentary key 1", 6850, [1457], None),
    ("read_io", 33718, 1, [62]),
    ("set_event 9, off", 6850, [1456], None),
    ("get_event 9", 6844, 1, [62]),
    ("set_event 10, on", 6870, [1457], None),
    ("get_event 10", 6864, 1, [63]),
    ("set_event 8, on", 16828, [63], None),
    ("get_event 8", 16828, 1, [63]),
    ("get_prgm_steps", 18888, [2], None),
    ("get_prgm_steps", 18920, 1, [0]),
    ("get_prgm_name", 16886 + 39 * 40, 20, [0] * 20),
    ("prgm_start", 16558, [2], None),
    ("prgm_start", 16560, [3], None),
    ("prgm_start", 16562, [1782], None),
    ("get_status", 16568, 1, [149]),
    ("get_prgm_cur", 16588, 1, [2]),
    ("get_prgm_cstep", 16590, 1, [3]),
    ("get_prgm_cstime", 16622, 5, [0] * 5),
    ("get_prgm_time", 16570, 3, [0] * 3),
    ("prgm_pause", 16566, [146], None),
    ("get_status", 16568, 1, [146]),
    ("prgm_resume", 16564, [147], None),
    ("get_status", 16568, 1, [149]),
    ("const_start, ends the profile", 16566, [148], None),
    ("get_status", 16568, 1, [62]),
    ("set_message", 37548, [*b"Espec"], None),
    ("set_message", 37546, [106], None),
    ("get_cascade_pv, of none", 4180, 2, 2),
    ("nothing", 40000, 1, 2),
)

BINDER_MB1: tuple[Row, ...] = (
    ("ovenctl, get_alarm_state", 0x123D, 1, [0]),
    ("ovenctl, get_alarm_state", 0x123E, 1, [0]),
    ("ovenctl, get_alarm_text", 0x1228, 20, [0x20] * 20),
    ("ovenctl, get_mode", 0x1A22, 1, [0]),
    ("ovenctl, bedew_protection", 0x158B, 1, [0]),
    ("ovenctl, get_door_state", 0x1007, 1, [0]),
    ("ovenctl, get_temp", 0x11A9, 2, f4t_single(23.0)),
    ("ovenctl, get_setpoint", 0x1077, 2, f4t_single(20.0)),
    ("ovenctl, set_setpoint", 0x1581, f4t_single(60.0), None),
    ("ovenctl, set_setpoint", 0x156F, f4t_single(60.0), None),
    ("ovenctl, get_setpoint, of idle mode", 0x1077, 2, f4t_single(60.0)),
    ("ovenctl, set_mode_active", 0x1A22, [0x0800], None),
    ("ovenctl, get_mode", 0x1A22, 1, [0x0800]),
    ("ovenctl, set_oplines", 0x158B, [1], None),
    ("ovenctl, bedew_protection", 0x158B, 1, [1]),
    ("ovenctl, set_mode_idle", 0x1A22, [0], None),
    ("ovenctl, a set point beyond its range", 0x1581, f4t_single(181.0), 3),
    ("Tobiska, get_humid", 0x11CD, 2, f4t_single(50.0)),
    ("Tobiska, state_manual", 0x1A22, [0x0800], None),
    ("Tobiska, start_prog", 0x1A22, [0], None),
    ("Tobiska, start_prog", 0x1A23, [3], None),
    ("Tobiska, start_prog", 0x1A22, [0x0400], None),
    ("Tobiska, get_state", 0x1A22, 1, [0x0400]),
    ("Tobiska, state_idle", 0x1A22, [0x1000], None),
    ("Tobiska, get_state", 0x1A22, 1, [0x1000]),
    ("the set point that is shown cannot be written", 0x1077, f4t_single(60.0), 5),
    ("nothing", 0x2000, 1, 2),
)

SEGMENT = 0x3014
BINDER_MB2: tuple[Row, ...] = (
    ("get_temp", 0x10D2, 2, f4t_single(23.0)),
    ("get_humid", 0x10D6, 2, f4t_single(50.0)),
    ("door", 0x1006, 2, f4t_single(23.0)),
    ("get_target", 0x10B2, 4, [*f4t_single(20.0), *f4t_single(50.0)]),
    ("set_temp", 0x114C, f4t_single(60.0), None),
    ("set_humid", 0x114E, f4t_single(40.0), None),
    ("get_state", 0x10A6, 2, [0, 0]),
    ("get_state", 0x1292, 1, [2]),
    ("state_manual", 0x1158, [0], None),
    ("get_state", 0x1292, 1, [0]),
    ("scan_programs", 0x3004, [3], None),
    ("scan_programs", 0x3003, [100], None),
    ("scan_programs", 0x3000, [0x008B, 0], None),  # load
    ("scan_programs", 0x3000, 1, [0x0000]),  # not busy
    ("scan_programs", 0x3002, 1, [1]),  # there is no program 3
    ("load_prog", 0x3000, [0x0086, 0], None),  # delete
    ("load_prog", 0x3002, 1, [0]),
    ("load_prog", 0x3004, [3], None),
    ("load_prog", 0x3003, [2], None),
    ("load_prog", 0x4300, [0x536F, 0x616B, *[0] * 30], None),
    ("load_prog", 0x3038, [600, 0], None),
    ("load_prog", 0x3038 + 0x30, [1, 1], None),
    ("load_prog", 0x3042, [0, 0], None),
    ("load_prog", 0x303D, [0x0100], None),
    ("load_prog", SEGMENT, [*f4t_single(60.0), *f4t_single(40.0), *[0] * 32], None),
    ("load_prog", 0x303C, [1], None),
    ("load_prog", 0x3000, [0x008C, 0], None),  # store
    ("load_prog", 0x3002, 1, [0]),
    ("another program in between", 0x3003, [0, 4], None),
    ("another program in between", SEGMENT, [0, 0], None),
    ("read_program", 0x3004, [3], None),
    ("read_program", 0x3000, [0x008B, 0], None),
    ("read_program", 0x3002, 1, [0]),
    ("read_program", 0x3003, 1, [2]),
    ("read_program", SEGMENT, 4, [*f4t_single(60.0), *f4t_single(40.0)]),
    ("read_pgm_title", 0x4300, 32, [0x536F, 0x616B, *[0] * 30]),
    ("start_prog", 0x134A, 6, [2026, 1, 1, 12, 0, 0]),
    ("start_prog", 0x1148, [1], None),
    ("start_prog", 0x1146, [0], None),
    ("start_prog", 0x1147, [4], None),
    ("start_prog of none", 0x1149, [1], 3),
    ("start_prog", 0x1147, [3], None),
    ("start_prog", 0x1140, [2026, 1, 1, 12, 0, 0], None),
    ("start_prog", 0x1149, [1], None),
    ("get_state", 0x10A8, 2, [1, 601]),  # 0x10000 + 1 + 600 s
    ("get_state", 0x10A4, 2, [3, 1]),
    ("state_idle while it runs", 0x1158, [2], 8),
    ("stop_prog", 0x114A, [1], None),
    ("get_state", 0x10A6, 4, [0, 0, 0, 0]),
    ("state_idle", 0x1158, [2], None),
    ("nothing", 0x2000, 1, 2),
)

CSZ_EZT430I: tuple[Row, ...] = (
    ("status", 0, 1, [0]),
    ("events", 12, 1, [0]),
    ("events", 12, [1], None),
    ("events", 12, 1, [1]),
    ("loop1_PV", 35, 1, [230]),
    ("loop1_SP", 36, [500], None),
    ("loop1_SP", 36, 1, [500]),
    ("loop1_mode_operation", 38, 1, [0]),
    ("loop1_errorstatus", 39, 1, [0]),
    ("loop2_PV", 40, 1, [500]),
    ("loop2_SP", 41, [450], None),
    ("loop2_SP", 41, 1, [450]),
    ("loop2_mode_operation", 43, 1, [0]),
    ("loop2_errorstatus", 44, 1, [0]),
    ("manual, page 5.2: alarm status", 2, 3, [0, 0, 0]),
    ("manual, page 5.2: program", 14, 14, [1, 0, *[0] * 12]),
    ("manual, page 5.3: set points of alarms", 51, 6, [1900] * 6),
    ("nothing", 6, 1, 2),
)


@contextmanager
def client_of(twin: ModbusRtuServer | SimulatedWatlowF4T) -> Iterator[ModbusSerialClient | ModbusTcpClient]:
    with twin:
        address = parse_address(twin.address)
        client: ModbusSerialClient | ModbusTcpClient
        if address.scheme == "tcp":
            client = ModbusTcpClient(address.host, port=address.port)
        else:
            client = ModbusSerialClient(address.pyserial_url, baudrate=19200)
        client.connect()
        yield client
        client.close()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize(
    "model",
    [
        pytest.param(model, marks=pytest.mark.foreign_client(model, client, "its registers, each answer checked"))
        for model, client in (
            ("watlow_f4", "EspecNorthAmerica/ChamberConnectLibrary"),
            ("watlow_f4t", "EspecNorthAmerica/ChamberConnectLibrary"),
            ("binder_mb1", "ecree-solarflare/ovenctl, P. Tobiska's control of Binder chambers"),
            ("binder_mb2", "P. Tobiska's control of Binder chambers"),
            ("csz_ezt430i", "O. Hartbrich's csz_ezt430i"),
        )
    ],
)
def test_a_published_client_gets_the_answers_that_it_expects(model: str) -> None:
    machine = FakeChamber()
    machine.power = 50.0
    twin, rows = {
        "watlow_f4": (SimulatedWatlowF4(machine), WATLOW_F4),
        "watlow_f4t": (SimulatedWatlowF4T(machine, on_by="momentary_key"), WATLOW_F4T),
        "binder_mb1": (SimulatedBinderMb1(machine), BINDER_MB1),
        "binder_mb2": (SimulatedBinderMb2(machine), BINDER_MB2),
        "csz_ezt430i": (SimulatedCszEzt430i(machine), CSZ_EZT430I),
    }[model]
    with client_of(twin) as client:
        for place, (name, address, asked, expected) in enumerate(rows):
            if isinstance(asked, int):
                answer = client.read_holding_registers(address, count=asked)
            elif len(asked) == 1:
                answer = client.write_register(address, asked[0])
            else:
                answer = client.write_registers(address, list(asked))
            got = answer.exception_code if answer.isError() else answer.registers if isinstance(asked, int) else None
            assert got == expected, f"row {place}, {name}: register {address}"


P300 = (
    ("ROM?", "P300 SIMULATED 1.00"),  # begins with P3: else the client takes it for an SCP-220
    ("ROM?,DISP", "P300 SIMULATED 1.00"),
    ("TYPE?", "T,P300,180.0"),
    ("DATE,26.11/23. MON", "OK:DATE,26.11/23. MON"),
    ("DATE?", "26.11/23"),
    ("TIME,14:30:5", "OK:TIME,14:30:5"),
    ("TIME?", "14:30:5"),
    ("SRQ?", "00000000"),
    ("MASK,01110010", "OK:MASK,01110010"),
    ("MASK?", "01110010"),
    ("SRQ,RESET", "OK:SRQ,RESET"),
    ("TIMER ON?", "0"),
    ("TIMER USE?", "0"),
    ("TIMER LIST?,0", "NA:DATA NOT READY"),
    ("TIMER WRITE,NO0,1:30,STANDBY", "NA:INVALID REQ"),
    ("ALARM?", "0"),
    ("KEYPROTECT?", "OFF"),
    ("KEYPROTECT,off", "OK:KEYPROTECT,OFF"),
    ("MODE?,DETAIL", "STANDBY"),
    ("MON?", "23.0,,STANDBY,0"),
    ("TEMP?", "23.0,20.0,180.0,-75.0"),
    ("HUMI?", "NA:CONT NOT READY-1"),
    ("SET?", "REF9"),
    ("SET,REF3", "OK:SET,REF3"),
    ("CONSTANT SET?,REF", "50"),
    ("REF?", "2,OFF1,OFF2"),
    ("RELAY,ON,1,12", "OK:RELAY,ON,1,12"),
    ("RELAY?", "2,1,12"),
    ("CONSTANT SET?,RELAY", "2,1,12"),
    ("%?", "1,50.0"),
    ("CONSTANT SET?,TEMP", "20.0,ON"),
    ("CONSTANT SET?,HUMI", "NA:CONT NOT READY-1"),
    ("CONSTANT SET?,PTC", "NA:CONT NOT READY-1"),
    ("CONSTANT SET?", "NA:PARA ERR"),
    ("SYSTEM SET?,PTCOPT", "OFF"),
    ("MON PTC?", "NA:CONT NOT READY-1"),
    ("PRGM MON?", "NA:CONT NOT READY-2"),
    ("PRGM SET?", "NA:CONT NOT READY-2"),
    ("PRGM USE?,RAM", "0"),
    ("PRGM USE?,RAM:1", "NA:DATA NOT READY"),
    ("PRGM DATA?,RAM:1", "NA:DATA NOT READY"),
    ("PRGM DATA?,RAM:1,STEP2", "NA:DATA NOT READY"),
    ("PRGM DATA WRITE,PGM1,EDIT START", "NA:PRGM WRITE ERR-1"),
    ("RUN PRGM, TEMP25.0 TIME1:30", "NA:CONT NOT READY-3"),
    ("TEMP, S25.0 H130.0 L-45.0", "OK:TEMP,S25.0 H130.0 L-45.0"),
    ("MODE,CONSTANT", "OK:MODE,CONSTANT"),
    ("REF?", "2,ON1,ON2"),
    ("POWER,off", "OK:POWER,OFF"),
    ("SPEED?", "NA:CMD ERR"),
    ("SPEED,1", "NA:CMD ERR"),
)
P300_PROGRAM = (
    ("PRGM MON?", "1,20.0,0:00,0,0"),
    ("PRGM SET?", "RAM:1,PANEL,END(STANDBY)"),
    ("PRGM,PAUSE", "OK:PRGM,PAUSE"),
    ("MODE?,DETAIL", "RUN PAUSE"),
    ("PRGM,CONTINUE", "OK:PRGM,CONTINUE"),
    ("MODE?,DETAIL", "RUN"),
    ("PRGM,ADVANCE", "OK:PRGM,ADVANCE"),
    ("PRGM,END,HOLD", "OK:PRGM,END,HOLD"),
    ("MODE?", "CONSTANT"),
)


@pytest.mark.parametrize(("rows", "program"), [(P300, False), (P300_PROGRAM, True)])
@pytest.mark.foreign_client("espec_p300", "EspecNorthAmerica/ChamberConnectLibrary", "its commands, a program")
def test_the_makers_library_gets_the_p300s_answers(rows: tuple[tuple[str, str], ...], program: bool) -> None:
    machine = FakeChamber()
    machine.power = 50.0
    with SimulatedEspecP300(machine) as twin:
        if program:
            twin.controller.run_program()
        address = parse_address(twin.address)
        with socket.create_connection((address.host, address.port), timeout=5.0) as line, line.makefile("rb") as heard:
            for request, answer in rows:
                line.sendall(f"{request}\r\n".encode())
                assert heard.readline() == f"{answer}\r\n".encode(), request


@contextmanager
def asked_by_minimalmodbus(twin: ModbusRtuServer) -> Iterator[Any]:
    with twin:
        instrument = pytest.importorskip("minimalmodbus").Instrument(
            twin.address.removeprefix("serial://").partition("?")[0], 1
        )
        instrument.serial.timeout = 1.0
        with instrument.serial:
            yield instrument


@contextmanager
def asked_by_basil(twin: ModbusRtuServer, kind: str) -> Iterator[Any]:
    dut = pytest.importorskip("basil.dut", reason="basil is not installed: pip install basil-daq")
    with twin:
        port = twin.address.removeprefix("serial://").partition("?")[0]
        line = {"port": port, "baudrate": 9600, "timeout": 1.0, "read_termination": "", "write_termination": ""}
        limits = {"address": 1, "min_temp": -40, "max_temp": 120}
        bench = dut.Dut(
            {
                "transfer_layer": [{"name": "serial", "type": "Serial", "init": line}],
                "hw_drivers": [{"name": "chamber", "type": kind, "interface": "serial", "init": limits}],
            }
        )
        bench.init()
        yield bench["chamber"]
        bench.close()


@pytest.mark.foreign_client("binder_mb2", "basil binderMK56", "reads and sets, its limits", package="basil-daq")
def test_basils_binder_mk56_reads_and_sets_the_chamber() -> None:
    """The MK 56 has an MB2, and basil reads its temperature at 1004h."""
    machine = FakeChamber()
    machine.air, machine.on = -12.5, True
    with asked_by_basil(SimulatedBinderMb2(machine), "binder_mk56") as chamber:
        assert (chamber.get_temperature(), chamber.get_temperature_target()) == (-12.5, 20.0)
        chamber.set_temperature(-30.25)
        assert chamber.get_temperature_target() == machine.setpoint == -30.25
        with pytest.raises(RuntimeWarning, match="higher than maximum allowed"):
            chamber.set_temperature(130.0)


class Checksum(int):
    """A checksum that equals a tuple of itself: basil's MK 53 compares one with the other, its MK 56 two tuples."""

    def __ne__(self, other: object) -> bool:
        return int(self) != (other[0] if isinstance(other, tuple) else other)


@pytest.mark.foreign_client(
    "binder_mb1",
    "basil binderMK53, its check of checksums mended",
    "reads and sets, modes, door, its limits",
    package="basil-daq",
)
def test_basils_binder_mk53_reads_and_sets_the_chamber(monkeypatch: pytest.MonkeyPatch) -> None:
    mk53 = pytest.importorskip(
        "basil.HL.binder_mk53", reason="basil is not installed: pip install basil-daq"
    ).binderMK53
    checksum = mk53._calc_crc16
    monkeypatch.setattr(mk53, "_calc_crc16", lambda self, message: Checksum(checksum(self, message)))
    machine = FakeChamber()
    machine.air, machine.on = -12.5, True
    with asked_by_basil(twin := SimulatedBinderMb1(machine), "binder_mk53") as chamber:
        assert (chamber.get_temperature(), chamber.get_temperature_target()) == (-12.5, 20.0)
        assert (chamber.get_mode(), chamber.get_door_open()) == (["manual"], False)
        chamber.set_temperature(-30.25)
        assert chamber.get_temperature_target() == machine.setpoint == -30.25
        twin.mode, twin.door_open = 0, 1
        assert (chamber.get_mode(), chamber.get_door_open()) == (["idle"], True)
        with pytest.raises(RuntimeWarning, match="higher than maximum allowed"):
            chamber.set_temperature(130.0)


@pytest.mark.foreign_client(
    "eurotherm_2400",
    "minimalmodbus, calls of hailegroup/nupylab",
    "reads, sets, ramps",
    package="minimalmodbus",
)
def test_minimalmodbus_asks_the_2400_as_nupylab_does() -> None:
    machine = FakeChamber()
    machine.air, machine.power, machine.on = 78.1, 12.5, True
    with asked_by_minimalmodbus(SimulatedEurotherm2400(machine)) as instrument:

        def single(parameter: int) -> float:
            return float(instrument.read_float(2 * parameter + 32768))

        assert [instrument.read_register(parameter) for parameter in (521, 517, 211)] == [1, 1, 16]  # the constructor
        assert single(1) == pytest.approx(78.1)
        assert (single(2), single(3), single(5)) == (20.0, 12.5, 20.0)
        instrument.write_float(2 * 24 + 32768, -40.5)
        assert [single(parameter) for parameter in (2, 5, 24)] == [-40.5] * 3
        assert instrument.read_register(2, 1, signed=True) == machine.setpoint == -40.5
        instrument.write_float(2 * 35 + 32768, 2.5)
        assert (single(35), instrument.read_register(35, 1)) == (2.5, 2.5)
        instrument.write_float(2 * 25 + 32768, 60.0)
        instrument.write_register(15, 1)
        assert (instrument.read_register(15), single(2)) == (1, 60.0)
        assert [instrument.read_register(parameter) for parameter in (22, 23, 29, 56, 59, 273)] == [1, 1, 0, 0, 0, 0]
        assert [single(parameter) for parameter in (160, 161, 163)] == [0.0] * 3
        assert [instrument.read_long(2 * parameter + 32768) for parameter in (36, 58)] == [0, 0]  # milliseconds
        segment = 8192 + 136 + 8
        instrument.write_register(segment, 1)  # a ramp by rate
        instrument.write_float(2 * (segment + 1) + 32768, 85.0)
        assert (instrument.read_register(segment), single(segment + 1)) == (1, 85.0)
        instrument.write_register(23, 2)
        assert instrument.read_register(23) == 2
        instrument.write_register(273, 1)
        assert (instrument.read_register(273), single(3)) == (1, 12.5)
        with pytest.raises(OSError, match="illegal data address"):
            instrument.read_register(4000)


@pytest.mark.foreign_client(
    "eurotherm_3500", "minimalmodbus, calls of its eurotherm3500", "reads, sets", package="minimalmodbus"
)
def test_minimalmodbus_asks_the_3500_by_the_list_of_its_own_example() -> None:
    machine = FakeChamber()
    machine.air, machine.power, machine.on = 78.1, 12.5, True
    twin = SimulatedEurotherm3500(machine)
    with asked_by_minimalmodbus(twin) as instrument:
        expected = {
            289: 78.1,  # get_pv_loop1
            1313: 0.0,  # get_pv_loop2
            370: 0.0,  # get_pv_module3, 4, 6
            373: 0.0,
            379: 0.0,
            273: 0.0,  # is_manual_loop1
            2: 20.0,  # get_sptarget_loop1
            5: 20.0,  # get_sp_loop1
            1029: 0.0,  # get_sp_loop2
            35: 0.0,  # get_sprate_loop1
            78: 0.1,  # is_sprate_disabled_loop1
            85: 12.5,  # get_op_loop1
            268: 0.0,  # is_inhibited_loop1
            1109: 0.0,  # get_op_loop2
            10241: 185.0,  # get_threshold_alarm1
            10213: 0.0,  # is_set_alarmsummary
        }
        assert {parameter: instrument.read_register(parameter, 1) for parameter in expected} == expected
        instrument.write_register(24, 65.5, 1)  # set_sp_loop1
        assert (instrument.read_register(2, 1), machine.setpoint) == (65.5, 65.5)
        instrument.write_register(35, 1.5, 1)  # set_sprate_loop1
        instrument.write_register(78, 0, 0)  # enable_sprate_loop1
        assert (instrument.read_register(35, 1), instrument.read_register(78, 1)) == (1.5, 0.0)
        twin.alarms = 1
        assert instrument.read_register(10213, 1) > 0
        for of_the_2000_series in (3, 75, 258):
            with pytest.raises(OSError, match="illegal data address"):
                instrument.read_register(of_the_2000_series)
