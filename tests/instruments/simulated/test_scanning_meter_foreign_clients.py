"""Programs that others wrote for real scanning multimeters, against the simulated ones.

PyMeasure's DAQ6510 client runs as it is installed, over PyVISA. Of clients that are no packages the dialogue is
reproduced: what they send, and what they need for an answer.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest

from benchctl_instruments.links.address import parse_address
from benchctl_instruments.simulated.clock import ScaledClock
from benchctl_instruments.simulated.keithley_daq6510 import SimulatedDAQ6510
from benchctl_instruments.simulated.keysight_34970a import Simulated34970A
from benchctl_instruments.simulated.keysight_daq970a import SimulatedDAQ970A
from benchctl_instruments.simulated.machines import AnalogInputs
from tests.instruments.simulated.fake_inputs import FakeInputs

by_pymeasure = partial(
    pytest.mark.foreign_client, "keithley_daq6510", "PyMeasure KeithleyDAQ6510, PyVISA-py", package="pymeasure"
)


class _SteadyInputs(FakeInputs):
    """The gyro gives 1.25 V, the thermistor's amplifier 0.25 V."""

    def gyro_v(self, times_s: np.ndarray) -> np.ndarray:
        return np.full(times_s.shape, 1.25)


@pytest.fixture
def inputs() -> AnalogInputs:
    return _SteadyInputs(ScaledClock(20.0))


@pytest.fixture
def pymeasure_daq6510(inputs: AnalogInputs) -> Iterator[Any]:
    pytest.importorskip("pyvisa_py", reason="PyVISA-py is not installed: pip install pyvisa-py")
    keithley = pytest.importorskip("pymeasure.instruments.keithley", reason="PyMeasure is not installed")
    with SimulatedDAQ6510(inputs) as twin:
        address = parse_address(twin.address)
        meter = keithley.KeithleyDAQ6510(
            f"TCPIP::{address.host}::{address.port}::SOCKET",
            visa_library="@py",
            read_termination="\n",
            write_termination="\n",
        )
        yield meter
        meter.adapter.close()


@pytest.mark.foreign_client(
    "keithley_daq6510",
    "PyMeasure KeithleyDAQ6510, PyVISA-py",
    "closes channels, measures, settings, errors",
    package="pymeasure",
)
def test_pymeasures_daq6510_measures_the_channel_that_it_closes(pymeasure_daq6510: Any) -> None:
    meter = pymeasure_daq6510
    assert meter.id == "KEITHLEY INSTRUMENTS,MODEL DAQ6510,00000001,1.7.12b"
    meter.reset()
    meter.measure_voltage(nplc=5, auto_range=False, voltage=10.0)
    assert (meter.voltage_nplc, meter.voltage_range) == (5.0, 10.0)
    assert meter.voltage == 0.0  # nothing is connected to the front terminals
    meter.close_channel(101)
    assert meter.voltage == 1.25
    meter.close_channels([102])
    assert meter.voltage == 0.25
    meter.open_channels([102])
    assert meter.voltage == 0.0
    meter.sense_mode = "current"
    meter.current_nplc = 2
    assert meter.current_nplc == 2.0
    meter.beep(1000, 0.1)
    assert meter.check_errors() == []


@by_pymeasure("fetches the buffer of a scan")
def test_pymeasures_daq6510_fetches_the_buffer_of_a_scan(pymeasure_daq6510: Any) -> None:
    """Its own methods for buffers are those of a Keithley 2000; of these, a DAQ6510 knows some."""
    meter = pymeasure_daq6510
    meter.reset()
    meter.write('SENS:FUNC "VOLT",(@101:102);:ROUT:SCAN:CRE (@101:102);:ROUT:SCAN:INT 1;:ROUT:SCAN:COUN:SCAN 3')
    meter.buffer_points = 100
    assert meter.buffer_points == 100
    meter.start_buffer()
    assert meter.ask("*OPC?").strip() == "1"
    assert meter.values('TRAC:DATA? 1,6,"defbuffer1",READ') == [1.25, 0.25] * 3
    assert meter.values('TRAC:DATA? 5,6,"defbuffer1",REL') == [2.0, 2.04]
    meter.stop_buffer()
    assert meter.check_errors() == []
    meter.write(":TRAC:FEED SENSE")
    assert [int(error[0]) for error in meter.check_errors()] == [-113]


# Dialogues ------------------------------------------------------------------------------------------------------------

DESY_CMS = """
*IDN? -> KEITHLEY INSTRUMENTS,MODEL DAQ6510,00000001,1.7.12b
*RST
*CLS
:SENS:FUNC 'TEMP', (@101:102);:SENS:TEMP:TRAN FRTD, (@101:102);:SENS:TEMP:RTD:FOUR PT100, (@101:102)
:SENS:TEMP:UNIT CELS, (@101:102)
:ROUT:SCAN:CRE (@101,102)
:ROUT:SCAN:MODE ALL
:TRAC:CLE 'defbuffer1'
:INIT:IMM
:TRAC:DATA? 1, 2, 'defbuffer1', CHAN, READ -> 101,1.25000000E+00,102,2.50000000E-01
:TRAC:CLE 'defbuffer1'
:ROUT:OPEN:ALL
"""

FREIA = """
*idn? -> KEITHLEY INSTRUMENTS,MODEL DAQ6510,00000001,1.7.12b
*RST
:FUNCtion 'TEMPerature', (@101:104)
:SENSe:TEMPerature:TRANsducer FRTD, (@101:104)
:SENSe:TEMPerature:RTD:FOUR PT100, (@101:104)
:ROUTe:SCAN:CREate (@101:104)
:ROUTe:SCAN:COUNt:SCAN 1
:ROUTe:SCAN:RESTart ON
:INIT
*WAI
:trac:data? 1, 4 -> 1.25000000E+00,2.50000000E-01,0.00000000E+00,0.00000000E+00
"""

CGSE = """
SENS:FUNC "TEMP", (@101:102)
SENS:TEMP:TRAN FRTD, (@101:102)
SENS:TEMP:RTD:FOUR PT100, (@101:102)
ROUT:SCAN:CRE (@101:102)
ROUT:CHAN:OPEN (@101:102)
ROUT:SCAN:COUN:SCAN 1
INIT:IMM
*WAI
TRAC:DATA? 1, 2, "defbuffer1", CHAN, REL, READ -> 101,0.000000,1.25000000E+00,102,0.040000,2.50000000E-01
"""

PYTHON_EQUIPMENT_DRIVERS = """
CONF:VOLT (@101)
CONF:VOLT:DC 10,(@102)
VOLT:DC:NPLC 0.02,(@101)
ROUT:SCAN (@102,101)
ROUT:SCAN? -> #210(@101,102)
TRIG:SOUR IMMediate
TRIG:SOUR? -> IMM
TRIG:COUN 2
TRIG:COUN? -> +2.00000000E+00
INITiate
FETC? -> +1.25000000E+00,+2.50000000E-01,+1.25000000E+00,+2.50000000E-01
TRIG:TIM 0.5
TRIG:TIM? -> +5.00000000E-01
"""

DUDEYARVIE = """
CONF:VOLT:DC 100,0.003, (@101, 102, 103)
ROUTe:CHANnel:DELay 1,(@101, 102, 103)
ROUTe:SCAN (@101, 102, 103)
READ? -> +1.25000000E+00,+2.50000000E-01,+0.00000000E+00
"""

DAQ970A_WRAPPER = """
*IDN? -> Keysight Technologies,DAQ970A,MY00000001,A.03.02-01.00-01.00-00.02-02-01
ROUT:SCAN (@101:102)
VOLT:DC:NPLC 1,(@101:102)
VOLT:DC:NPLC? (@101:102) -> +1.00000000E+00,+1.00000000E+00
CONF:VOLT:DC 10,0.0001,(@101:102)
TRIG:SOUR TIM
TRIG:TIM 0.1
TRIG:COUN 3
TRIG:SOUR? -> TIM
TRIG:TIM? -> +1.00000000E-01
ROUT:SCAN:SIZE? -> +2
READ? -> +1.25000000E+00,+2.50000000E-01,+1.25000000E+00,+2.50000000E-01,+1.25000000E+00,+2.50000000E-01
"""

SHABAZ123 = """
*RST
CONF:TEMP THER,5000,(@102)
ROUT:SCAN (@102)
TRIG:SOUR IMM
INIT
FETC? -> +2.50000000E-01
"""


@pytest.mark.parametrize(
    ("make", "dialogue", "no_error"),
    [
        pytest.param(
            make,
            dialogue,
            no_error,
            id=client,
            marks=pytest.mark.foreign_client(model, client, "its commands, each answer checked"),
        )
        for make, model, no_error, dialogues in (
            (
                SimulatedDAQ6510,
                "keithley_daq6510",
                '0,"No error',
                {
                    "DESY CMStkModLab KeithleyDAQ6510.cpp": DESY_CMS,
                    "freia-lab/e3-daq6510 daq6510.proto": FREIA,
                    "IvS-KULeuven CGSE daq6510_devif.py": CGSE,
                },
            ),
            (
                Simulated34970A,
                "keysight_34970a",
                '+0,"No error"',
                {
                    "PythonEquipmentDrivers AG_34972A.py": PYTHON_EQUIPMENT_DRIVERS,
                    "DudeYarvie/HP34970A-and-HP34901A": DUDEYARVIE,
                },
            ),
            (
                SimulatedDAQ970A,
                "keysight_daq970a",
                '+0,"No error"',
                {
                    "a laboratory's wrapper of a DAQ970A": DAQ970A_WRAPPER,
                    "shabaz123/DAQ970A-tools daq_therm.m": SHABAZ123,
                },
            ),
        )
        for client, dialogue in dialogues.items()
    ],
)
def test_a_public_clients_dialogue_is_answered_as_it_needs(
    inputs: AnalogInputs, make: Any, dialogue: str, no_error: str
) -> None:
    """At its end the queue of errors is empty: the meter knew each command."""
    with make(inputs) as twin:
        where = parse_address(twin.address)
        with socket.create_connection((where.host, where.port), timeout=10.0) as wire, wire.makefile("rb") as answers:
            for line in dialogue.strip().splitlines():
                sent, arrow, wanted = line.partition(" -> ")
                wire.sendall(f"{sent}\n".encode())
                if arrow:
                    assert answers.readline() == f"{wanted}\n".encode(), sent
            wire.sendall(b"SYST:ERR?\n")
            assert answers.readline().decode().startswith(no_error)


@pytest.mark.parametrize(
    ("make", "line", "code"),
    [
        (SimulatedDAQ6510, "FOO:BAR", -113),
        (SimulatedDAQ6510, "SENS:VOLT:NPLC", -109),
        (SimulatedDAQ6510, "SENS:VOLT:NPLC 100,(@101)", -222),
        (SimulatedDAQ6510, "ROUT:CLOS (@201)", -222),
        (SimulatedDAQ6510, "TRAC:DATA? 1,2", -222),
        (SimulatedDAQ6510, "INIT", 5076),
        (SimulatedDAQ6510, "ROUT:SCAN (@101);SCAN:COUN:SCAN 0;:ROUT:SCAN:INT 1;:INIT;:INIT", -213),
        (Simulated34970A, "ROUT:SCAN (@101,121)", -222),
        (Simulated34970A, "INIT", 308),
        (Simulated34970A, "FETC?", -230),
        (Simulated34970A, "VOLT:DC:NPLC 5,(@101)", -222),
        (Simulated34970A, "CONF:TEMP PT100,85,(@101)", -224),
    ],
)
def test_a_command_that_a_meter_does_not_execute_is_an_error_in_its_queue_and_has_no_answer(
    inputs: AnalogInputs, make: Any, line: str, code: int
) -> None:
    with make(inputs) as twin:
        where = parse_address(twin.address)
        with socket.create_connection((where.host, where.port), timeout=10.0) as wire, wire.makefile("rb") as answers:
            wire.sendall(f"{line}\nSYST:ERR?\nSYST:ERR?\n".encode())
            assert [int(answers.readline().partition(b",")[0]) for _ in range(2)] == [code, 0]
