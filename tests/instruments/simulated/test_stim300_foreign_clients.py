"""The simulated STIM300 before programs by others, whose calls are replayed over a real line.

geirhovland/stim300 `stim300_read.py` waits for the byte AFh and reads the 64 bytes after it. cookednoodle/pystim300
(`client.py`, `datagrams.py`, `configuration.py`, `crc.py`) asks with one letter between the measurements and takes the
answers apart by the tables of the maker's data sheet, TS1524 r31.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import serial

from benchctl_instruments.simulated.clock import ScaledClock
from benchctl_instruments.simulated.sensonor_stim300 import SimulatedStim300
from tests.instruments.gyros.gyro_inputs import SETTINGS, RampInputs

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")

RATE_DPS, LATENCY_US = -30.0, 500


@contextmanager
def port_of(**options: Any) -> Iterator[serial.Serial]:
    with (
        SimulatedStim300(RampInputs(ScaledClock(1.0), rate_dps=RATE_DPS), SETTINGS, **options) as twin,
        serial.Serial(twin.address.removeprefix("serial://").partition("?")[0], timeout=2.0) as port,
    ):
        yield port


def crc32_of(data: bytes) -> int:
    """Bit by bit, as pystim300's own tests do: polynomial 04C11DB7h, from ones, nothing reflected or inverted."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ (0x04C11DB7 if crc & 0x80000000 else 0)) & 0xFFFFFFFF
    return crc


def signed(data: bytes) -> int:
    return int.from_bytes(data, "big", signed=True)


@pytest.mark.foreign_client("sensonor_stim300", "geirhovland/stim300 stim300_read.py", "reads a complete datagram")
def test_a_reader_of_complete_datagrams_finds_rates_temperatures_and_checksum() -> None:
    with port_of(datagram_id=0xAF, crlf=True, rate_hz=125.0, baud=115_200) as port:
        found: list[bytes] = []
        while len(found) < 3:
            while port.read() != b"\xaf":
                pass
            if (datagram := port.read(64))[62:] == b"\r\n":
                found.append(datagram)
    for datagram in found:
        rates_dps = [signed(datagram[at : at + 3]) / 16384 for at in (0, 3, 6)]
        temperatures_c = [signed(datagram[at : at + 2]) / 256 for at in (30, 32, 34, 37, 39, 41, 44, 46, 48)]
        assert rates_dps == pytest.approx([0.0, 0.0, RATE_DPS], abs=2**-14)
        assert temperatures_c == pytest.approx([21.75] * 9)
        assert [datagram[at] for at in (9, 19, 29, 36, 43, 50, 54)] == [0] * 7  # the status bytes
        assert int.from_bytes(datagram[56:58], "big") == LATENCY_US
        assert int.from_bytes(datagram[58:62], "big") == crc32_of(b"\xaf" + datagram[:58] + b"\0")
    counters = [datagram[55] for datagram in found]
    assert counters == sorted(counters)


@pytest.mark.foreign_client(
    "sensonor_stim300", "cookednoodle/pystim300", "asks for serial number and configuration, follows the stream"
)
@pytest.mark.parametrize("crlf", [False, True])
def test_a_client_of_the_data_sheets_tables_gets_its_answers_between_the_measurements(crlf: bool) -> None:
    options = {"datagram_id": 0xA7, "crlf": crlf, "rate_hz": 250.0, "serial": "25582100000042"}
    measurement, answers = (0xA7, 54, 1), {(0xB5, 0xB7)[crlf]: (15, 0), (0xBC, 0xBD)[crlf]: (21, 2)}
    catalogue = {measurement[0]: measurement[1:], **answers}  # bytes between identifier and CRC, and its dummy bytes
    payloads: dict[int, list[bytes]] = {identifier: [] for identifier in catalogue}
    with port_of(**options) as port:
        port.write(b"I\r")
        port.write(b"C\r")
        buffer, give_up_s = b"", time.monotonic() + 5.0
        while not all(payloads.values()) and time.monotonic() < give_up_s:
            buffer += port.read(64)
            while buffer:
                length, dummy = catalogue.get(buffer[0], (0, 0))
                whole = 1 + length + 4 + 2 * crlf
                if length and len(buffer) < whole:
                    break
                contents, crc = buffer[: 1 + length], buffer[1 + length : 5 + length]
                if not length or crc32_of(contents + bytes(dummy)) != int.from_bytes(crc, "big"):
                    buffer = buffer[1:]  # its parser walks on by one byte
                    continue
                payloads[contents[0]].append(contents[1:])
                buffer = buffer[whole:]
    (number,), (configuration, *_), samples = (payloads[identifier] for identifier in (*answers, 0xA7))
    assert (number[:1], number[1:8].hex()) == (b"N", options["serial"])
    assert chr(configuration[0]) == "F"
    assert configuration[2] >> 5 == 1  # 250 Hz
    assert [bool(configuration[2] & bit) for bit in (0x10, 0x08, 0x04, 0x02, 0x01)] == [False, True, True, True, crlf]
    assert (configuration[4] & 0x70, configuration[4] & 0x0F) == (0x70, 0)  # three axes, angular rate
    assert signed(samples[0][6:9]) / 16384 == pytest.approx(RATE_DPS, abs=2**-14)
