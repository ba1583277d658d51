from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols import stim300 as stim
from benchctl_instruments.protocols.frames import FrameFormat, FrameReader, crc32_mpeg2
from benchctl_instruments.protocols.stim300 import StimConfiguration

IDS = sorted(stim.PARTS)
INT24 = st.integers(-0x800000, 0x7FFFFF)


def row_of(data: bytes, *formats: FrameFormat) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
    """The one frame in some bytes; what follows decides what they are."""
    (run,) = FrameReader(formats).feed(data + bytes(70))
    (row,) = run.rows
    return row


def test_lengths_and_padding_are_those_of_the_sources() -> None:
    padding = {0x90: 2, 0x91: 0, 0x92: 0, 0x93: 2, 0x94: 3, 0xA5: 2, 0xA6: 2, 0xA7: 1}
    padding |= {0x98: 2, 0x99: 0, 0x9A: 0, 0x9B: 2, 0x9C: 3, 0xAD: 2, 0xAE: 2, 0xAF: 1}
    assert {number: stim.frame_format(number).padding for number in IDS} == padding
    assert stim.frame_format(0x90).length == 18
    assert stim.frame_format(0xA7).length == 59
    assert stim.frame_format(0xAF).length == 63
    assert stim.frame_format(0xAF, crlf=True).length == 65


def test_a_datagram_is_encoded_to_the_last_byte() -> None:
    data = stim.encode_frames(0x94, [[1, -2, 0x7FFFFF]], counter=257, temperature_c=-1.5, status=0x40, latency_us=506)
    contents = bytes.fromhex("94 000001 FFFFFE 7FFFFF 40 FE80 FE80 FE80 40 01 01FA")
    assert data == contents + crc32_mpeg2(contents + bytes(3)).to_bytes(4, "big")
    assert stim.encode_frames(0x90, [[0, 0, 0]], counter=0, crlf=True)[-2:] == b"\r\n"


REAL = bytes.fromhex(
    "AF 000124 FFFAD6 00035B 00 FFE7A6 FFDD36 081C52 00 FF7E70 FEBA0C 3FFA1D 00"
    "23A0 23C0 23A0 00 2319 230A 231C 00 2395 23B6 2395 00 FFEF02 00 E1 01FA"
)
REAL_CRC = 3_326_689_990


def test_the_checksum_of_a_datagram_of_a_real_stim300_is_right_and_it_is_read() -> None:
    """geirhovland/stim300, README: the numbers that a STIM300 sent, put into bytes here, and its checksum."""
    datagram = REAL + REAL_CRC.to_bytes(4, "big") + b"\r\n"
    row = row_of(datagram, stim.frame_format(0xAF, crlf=True))
    frames = stim.decode_frames(0xAF, row[np.newaxis])
    rates_dps = (0.017822265625, -0.0806884765625, 0.05242919921875)
    assert tuple(frames.gyro[0] * stim.RATE_STEP_DPS) == rates_dps
    assert tuple(frames.temperature_c[0]) == (35.625, 35.75, 35.625)
    assert (frames.status[0], frames.counter[0], frames.latency_us[0]) == (0, 225, 506)


@pytest.mark.parametrize("datagram_id", IDS)
@settings(deadline=None)
@given(
    crlf=st.booleans(),
    gyro=st.lists(st.tuples(INT24, INT24, INT24), min_size=1, max_size=5),
    counter=st.integers(0, 255),
    steps_c=st.integers(-0x8000, 0x7FFF),
    status=st.integers(0, 255),
    latency_us=st.integers(0, 0xFFFF),
)
def test_what_is_encoded_is_read_back(
    datagram_id: int,
    crlf: bool,
    gyro: list[tuple[int, int, int]],
    counter: int,
    steps_c: int,
    status: int,
    latency_us: int,
) -> None:
    data = stim.encode_frames(
        datagram_id,
        gyro,
        counter=counter + np.arange(len(gyro)),
        temperature_c=steps_c / 256,
        status=status,
        latency_us=latency_us,
        crlf=crlf,
    )
    (run,) = FrameReader([stim.frame_format(datagram_id, crlf=crlf)]).feed(data)
    frames = stim.decode_frames(datagram_id, run.rows)
    assert frames.gyro.tolist() == [list(row) for row in gyro]
    assert frames.counter.tolist() == [(counter + place) % 256 for place in range(len(gyro))]
    assert set(frames.status) == {status}
    assert set(frames.latency_us) == {latency_us}
    warm = frames.temperature_c if "temperature" in stim.PARTS[datagram_id] else np.full((1, 3), steps_c / 256)
    assert (warm == steps_c / 256).all()
    assert np.isnan(frames.temperature_c).all() == ("temperature" not in stim.PARTS[datagram_id])


def test_numbers_of_three_bytes_that_do_not_fit_are_the_nearest_that_do() -> None:
    assert stim.to_int24(np.array([1 << 23, -(1 << 23) - 1])).tolist() == [[0x7F, 0xFF, 0xFF], [0x80, 0, 0]]


def test_a_status_is_told_in_words_with_its_axes() -> None:
    assert stim.status_words(0) == ()
    assert stim.status_words(1 << 6) == ("starting up",)
    assert stim.status_words(1 << 4 | 0b101) == ("overload (XZ)",)
    assert stim.status_words(0b010) == ("not valid (Y)",)
    assert stim.status_words(0xFF)[0] == "system integrity error (XYZ)"


@pytest.mark.parametrize("crlf", [False, True])
@pytest.mark.parametrize("datagram_id", IDS)
def test_a_configuration_is_read_back(datagram_id: int, crlf: bool) -> None:
    for rate_hz in (*stim.RATES_HZ, None):
        for unit in stim.GYRO_UNITS:
            stated = StimConfiguration(
                datagram_id=datagram_id, crlf=crlf, rate_hz=rate_hz, gyro_unit=unit, revision="F", firmware=31
            )
            data = stim.encode_configuration(stated)
            assert len(data) == (28 if crlf else 26)
            assert stim.decode_configuration(row_of(data, *stim.CONFIGURATION_FORMATS)) == stated


def test_a_configuration_is_encoded_to_the_last_byte() -> None:
    data = stim.encode_configuration(
        StimConfiguration(datagram_id=0xA7, crlf=False, rate_hz=2000.0, gyro_unit="incremental angle", firmware=7)
    )
    contents = bytes.fromhex("BC 2D 07 8E 00 71") + bytes(16)
    assert data == contents + crc32_mpeg2(contents + bytes(2)).to_bytes(4, "big")


def test_a_unit_that_the_sources_read_differently_is_refused_with_what_to_do() -> None:
    data = stim.encode_configuration(
        StimConfiguration(datagram_id=0xA7, crlf=False, rate_hz=125.0, gyro_unit="angular rate")
    )
    row = row_of(data, *stim.CONFIGURATION_FORMATS)
    row[5] = 0x78
    with pytest.raises(InstrumentError, match=r"unit 8, expected 0 to 3; have it set to angular rate"):
        stim.decode_configuration(row)


@pytest.mark.parametrize("crlf", [False, True])
def test_a_serial_number_is_read_back(crlf: bool) -> None:
    data = stim.encode_serial("25582100000042", crlf=crlf)
    assert data[:9] == (b"\xb7" if crlf else b"\xb5") + b"N" + bytes.fromhex("25582100000042")
    assert stim.decode_serial(row_of(data, *stim.SERIAL_FORMATS)) == "25582100000042"
