"""The drivers of scanning multimeters: byte for byte, against their simulated meters, and what they refuse."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from benchctl_instruments.digitizers.keithley_daq6510 import KeithleyDAQ6510
from benchctl_instruments.digitizers.keysight_34970a import Keysight34970A
from benchctl_instruments.digitizers.keysight_daq970a import KeysightDAQ970A
from benchctl_instruments.digitizers.scanning_meter import MAINS_HZ, ScanningMeter
from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Digitizer
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.keithley_daq6510 import SimulatedDAQ6510
from benchctl_instruments.simulated.keysight_34970a import Simulated34970A
from benchctl_instruments.simulated.keysight_daq970a import SimulatedDAQ970A
from benchctl_instruments.simulated.serial_line import line_conversation
from benchctl_instruments.simulated.tcp_server import TcpServer
from tests.instruments.simulated.fake_inputs import FakeInputs
from tests.instruments.wire_transcript import Transcript

MODELS: list[tuple[Any, Any]] = [
    (KeithleyDAQ6510, SimulatedDAQ6510),
    (Keysight34970A, Simulated34970A),
    (KeysightDAQ970A, SimulatedDAQ970A),
]


@pytest.fixture
def inputs() -> FakeInputs:
    return FakeInputs(VirtualClock())


@pytest.fixture(params=MODELS, ids=lambda model: model[0].__name__)
def meter(inputs: FakeInputs, request: pytest.FixtureRequest) -> Iterator[ScanningMeter]:
    make, make_twin = request.param
    with make_twin(inputs) as twin, make(twin.address, clock=inputs.clock) as meter:
        yield meter


def scripted(*answers: tuple[str, str]) -> TcpServer:
    """A meter that knows one answer a line; commands with `SYST:ERR?` succeed."""
    known = dict(answers)

    def execute(line: str) -> str | None:
        return known.get(line) or ('0,"No error"' if line.endswith("SYST:ERR?") else None)

    return TcpServer(lambda: line_conversation(execute, end=b"\n"))


def sent(transcript: Transcript) -> list[str]:
    return [bytes.fromhex(line[2:]).decode() for line in transcript.lines if line.startswith(">")]


IDN = {"6510": "KEITHLEY INSTRUMENTS,MODEL DAQ6510,04569510,1.7.12b", "34970A": "HEWLETT-PACKARD,34970A,0,13-2-2"}


def test_a_daq6510_is_set_up_and_read_byte_for_byte() -> None:
    """The commands are those of public clients: DESY CMS, IvS-KULeuven CGSE, the maker's own examples."""
    transcript = Transcript()
    with (
        scripted(
            ("*IDN?", IDN["6510"]),
            ("TRIG:STAT?", "IDLE;IDLE;0"),
            ('TRAC:ACT? "defbuffer1"', "4"),
            ('TRAC:DATA? 1,2,"defbuffer1",READ,REL', "1.50000000E+00,0.000000,2.50000000E-01,0.042000"),
            (
                'TRAC:DATA? 1,4,"defbuffer1",READ,REL',
                "1.5,0.000000,0.25,0.042,-1.5,0.200100,0.26,0.242",
            ),
        ) as server,
        KeithleyDAQ6510(server.address, clock=VirtualClock(), wire_log=transcript.log) as meter,
    ):
        once = meter.read_once()
        meter.start_stream(5.0)
        block = meter.read_stream(2, 1.0)
        meter.stop_stream()
    assert (once.gyro_v, once.thermistor_v, once.encoder_count) == (1.5, 0.25, 0)
    assert (block.gyro_v.tolist(), block.thermistor_v.tolist(), block.first_index) == ([1.5, -1.5], [0.25, 0.26], 0)
    set_up = [
        "TRIG:STAT?\n",
        "*RST;*CLS;:SYST:ERR?\n",
        'SENS:FUNC "VOLT",(@101,102);:SYST:ERR?\n',
        "SENS:VOLT:RANG 10,(@101,102);:SYST:ERR?\n",
        "SENS:VOLT:NPLC 1,(@101,102);:SYST:ERR?\n",
        'TRAC:POIN 1000000,"defbuffer1";:SYST:ERR?\n',
        'TRAC:FILL:MODE ONCE,"defbuffer1";:SYST:ERR?\n',
        "ROUT:SCAN:CRE (@101,102);:SYST:ERR?\n",
        'ROUT:SCAN:BUFF "defbuffer1";:SYST:ERR?\n',
    ]
    assert sent(transcript) == [
        "*IDN?\n",
        *set_up,
        'ROUT:SCAN:COUN:SCAN 1;:TRAC:CLE "defbuffer1";:INIT;*WAI;:SYST:ERR?\n',
        'TRAC:DATA? 1,2,"defbuffer1",READ,REL\n',
        *(line.replace("NPLC 1", "NPLC 2") for line in set_up),
        "ROUT:SCAN:COUN:SCAN 0;:ROUT:SCAN:INT 0.200;:SYST:ERR?\n",
        'ABOR;:TRAC:CLE "defbuffer1";:INIT;:SYST:ERR?\n',
        'TRAC:ACT? "defbuffer1"\n',
        'TRAC:DATA? 1,4,"defbuffer1",READ,REL\n',
        "*CLS;ABOR;:SYST:ERR?\n",
        "TRIG:STAT?\n",
    ]


def test_a_34970a_with_a_temperature_sensor_is_set_up_and_read_byte_for_byte() -> None:
    """The form of a reading with its time is one that a laboratory's program notes: -4.30000000E-08,00000000.370."""
    transcript = Transcript()
    with (
        scripted(
            ("*IDN?", IDN["34970A"]),
            ("STAT:OPER:COND?", "+0"),
            ("DATA:POIN?", "+5"),
            (
                "DATA:REM? 4",
                "-4.30000000E-08,00000000.370,+2.50000000E+01,00000000.410"
                ",+1.00000000E+00,00000002.370,+2.60000000E+01,00000002.411",
            ),
        ) as server,
        Keysight34970A(
            server.address,
            clock=VirtualClock(),
            gyro_channel=103,
            thermistor_channel=105,
            temperature="rtd",
            range_v=100.0,
            wire_log=transcript.log,
        ) as meter,
    ):
        start = meter.start_stream(0.5)
        block = meter.read_stream(2, 1.0)
    assert (start.rate_hz, block.first_index) == (0.5, 0)
    assert (block.gyro_v.tolist(), block.thermistor_v.tolist()) == ([-4.3e-8, 1.0], [25.0, 26.0])
    assert sent(transcript) == [
        "*IDN?\n",
        "STAT:OPER:COND?\n",
        "*RST;*CLS;:SYST:ERR?\n",
        "CONF:VOLT:DC 100,(@103);:SYST:ERR?\n",
        "VOLT:DC:NPLC 10,(@103);:SYST:ERR?\n",
        "CONF:TEMP FRTD,85,(@105);:SYST:ERR?\n",
        "UNIT:TEMP C,(@105);:SYST:ERR?\n",
        "TEMP:NPLC 10,(@105);:SYST:ERR?\n",
        "ROUT:SCAN (@103,105);:SYST:ERR?\n",
        "FORM:READ:TIME ON;:FORM:READ:TIME:TYPE REL;:SYST:ERR?\n",
        "TRIG:SOUR TIM;:TRIG:TIM 2.000;:TRIG:COUN INF;:SYST:ERR?\n",
        "ABOR;:INIT;:SYST:ERR?\n",
        "DATA:POIN?\n",
        "DATA:REM? 4\n",
    ]


def test_a_meter_streams_what_its_terminals_see_on_its_own_timer(meter: ScanningMeter, inputs: FakeInputs) -> None:
    digitizer: Digitizer = meter
    once = digitizer.read_once()
    assert once.gyro_v == pytest.approx(inputs.gyro_v(np.array([0.0]))[0], abs=2e-5)
    inputs.clock.sleep(3.0)
    start = digitizer.start_stream(4.0)
    blocks = []
    for _ in range(3):
        inputs.clock.sleep(30.0)
        blocks.append(digitizer.read_stream(100, 1.0))
    seen_v = np.concatenate([block.gyro_v for block in blocks])
    index = np.concatenate([block.first_index + np.arange(block.gyro_v.size) for block in blocks])
    assert index.tolist() == list(range(361))
    assert start.start_s == pytest.approx(3.0)
    assert seen_v == pytest.approx(inputs.gyro_v(3.0 + index / 4.0), abs=2e-5)
    assert set(np.concatenate([block.thermistor_v for block in blocks])) == {0.25}
    assert not any(block.encoder_count.any() for block in blocks)
    digitizer.stop_stream()
    assert inputs.held_since_s is None
    assert digitizer.read_once().thermistor_v == 0.25


def test_scans_are_waited_for_and_a_silent_meter_is_named() -> None:
    with (
        scripted(("*IDN?", IDN["6510"]), ("TRIG:STAT?", "IDLE;IDLE;0"), ('TRAC:ACT? "defbuffer1"', "1")) as server,
        KeithleyDAQ6510(server.address, clock=VirtualClock()) as meter,
    ):
        meter.start_stream(10.0)
        with pytest.raises(LinkError, match=r"expected 3 scans within 0\.05 s, 0 came; look whether it scans"):
            meter.read_stream(3, 0.05)


def test_readings_that_were_lost_on_the_way_are_a_gap_and_what_follows_it_is_kept() -> None:
    answers = iter(
        (
            "1.0,0000.070,0.1,0000.110,2.0,0000.270,0.1,0000.310",
            "5.0,0000.871,0.1,0000.910,6.0,0001.070,0.1,0001.110",  # 0.47 and 0.67 s were deleted with an answer
        )
    )

    def execute(line: str) -> str | None:
        if line.startswith("DATA:REM"):
            return next(answers)
        known = {"*IDN?": IDN["34970A"], "STAT:OPER:COND?": "+0", "DATA:POIN?": "+4"}
        return known.get(line, '0,"No error"')

    with (
        TcpServer(lambda: line_conversation(execute, end=b"\n")) as server,
        Keysight34970A(server.address, clock=VirtualClock()) as meter,
    ):
        meter.start_stream(5.0)
        before, after = meter.read_stream(1, 1.0), meter.read_stream(1, 1.0)
    assert (before.first_index, before.gyro_v.tolist()) == (0, [1.0, 2.0])
    assert (after.first_index, after.gyro_v.tolist()) == (4, [5.0, 6.0])


def test_a_gap_ends_a_block_and_the_next_one_begins_after_it() -> None:
    text = "1.0,0,0.1,0.04,2.0,0.2,0.1,0.24,3.0,1.0,0.1,1.04"
    with (
        scripted(
            ("*IDN?", IDN["34970A"]), ("STAT:OPER:COND?", "+0"), ("DATA:POIN?", "+6"), ("DATA:REM? 6", text)
        ) as server,
        Keysight34970A(server.address, clock=VirtualClock()) as meter,
    ):
        meter.start_stream(5.0)
        block = meter.read_stream(3, 1.0)
    assert (block.first_index, block.gyro_v.tolist(), block.backlog) == (0, [1.0, 2.0], 1)


@pytest.mark.parametrize(
    ("answers", "says"),
    [
        ([("TRIG:STAT?", "RUNNING;RUNNING;3")], "a scan runs that this program did not start"),
        (
            [('SENS:FUNC "VOLT",(@101,102);:SYST:ERR?', '-222,"Data out of range;1;2026/01/01"')],
            r"""sent 'SENS:FUNC "VOLT",\(@101,102\)', it answers -222, 'Data out of range;1;2026/01/01'""",
        ),
        (
            [('TRAC:DATA? 1,2,"defbuffer1",READ,REL', "9.90000000E+37,0.0,0.25,0.04")],
            "channel 101, the gyro, is outside its range, or open; check the wiring",
        ),
        ([('TRAC:DATA? 1,2,"defbuffer1",READ,REL', "1.0,0.0,0.25")], "expected 4 numbers, got 3"),
        (
            [("*RST;*CLS;:SYST:ERR?", "hello")],
            "expected a number, got 'hello'; check the cable, and that it is a Keithley DAQ6510",
        ),
    ],
)
def test_what_a_meter_answers_wrongly_is_one_clear_error(answers: list[tuple[str, str]], says: str) -> None:
    usual = [("*IDN?", IDN["6510"]), ("TRIG:STAT?", "IDLE;IDLE;0")]
    with (
        scripted(*usual, *answers) as server,
        KeithleyDAQ6510(server.address, clock=VirtualClock()) as meter,
        pytest.raises(InstrumentError, match=f"^Keithley DAQ6510 at tcp://127.0.0.1:[0-9]+: .*{says}"),
    ):
        meter.read_once()


def test_another_instrument_is_refused_when_it_is_opened() -> None:
    with scripted(("*IDN?", IDN["34970A"])) as server:
        meter = KeithleyDAQ6510(server.address, clock=VirtualClock())
        with pytest.raises(InstrumentError, match="expected a DAQ6510, got 'HEWLETT-PACKARD,34970A,0,13-2-2'"):
            meter.open()
        with Keysight34970A(server.address, clock=VirtualClock()) as right:
            assert (right.identify().model, right.identify().firmware) == ("34970A", "13-2-2")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"gyro_channel": 102}, "gyro_channel and thermistor_channel are both 102"),
        ({"temperature": "pt100"}, "temperature = 'pt100': expected one of volts, rtd, thermistor, thermocouple"),
        ({"range_v": 5.0}, r"range_v 5: expected one of the ranges of a Keithley DAQ6510, \(0\.1, 1\.0, 10\.0,"),
    ],
)
def test_an_option_that_is_wrong_is_refused_before_anything_is_sent(options: dict[str, Any], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        KeithleyDAQ6510("tcp://127.0.0.1:1", clock=VirtualClock(), **options)


def test_a_rate_that_the_meter_cannot_keep_is_refused(meter: ScanningMeter) -> None:
    with pytest.raises(UsageError, match=rf"scans at most {meter.FASTEST_HZ:g} times a second: lower sample_rate_hz"):
        meter.start_stream(2.0 * meter.FASTEST_HZ)


@pytest.mark.parametrize("make", [make for make, _ in MODELS])
def test_two_readings_of_a_mains_period_with_their_zeros_fit_into_the_fastest_scan(make: type[ScanningMeter]) -> None:
    assert 2.0 * (2.0 / MAINS_HZ + make.SWITCH_S) < 1.0 / make.FASTEST_HZ
