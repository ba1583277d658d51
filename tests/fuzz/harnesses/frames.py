"""Instruments that speak in frames: Modbus, the LabJack's stream, KVH and Sensonor gyros."""

from __future__ import annotations

import struct

import numpy as np

from benchctl_instruments.protocols import kvh1760, modbus, stim300
from benchctl_instruments.protocols.frames import FrameReader, SequenceNumbers
from benchctl_instruments.protocols.t7_stream import StreamReader, encode_packets
from tests.fuzz.harness import Harness, pieces, refusals

_STIM_FORMATS = [
    *(stim300.frame_format(number, crlf=crlf) for number, crlf in ((0x90, False), (0xAF, True))),
    *stim300.CONFIGURATION_FORMATS,
    *stim300.SERIAL_FORMATS,
]


def one_input(data: bytes) -> None:
    _modbus(data)
    _t7(data)
    _gyros(data)
    if len(data) >= 4:
        pair = struct.unpack(">HH", data[:4])
        modbus.f32_from_words(pair, "low_first"), modbus.u32_from_words(pair, "high_first")
        modbus.signed_from_word(pair[0])


def _modbus(data: bytes) -> None:
    for framing in (modbus.TcpFraming(), modbus.RtuFraming()):
        for piece in pieces(data):
            for request in framing.feed(piece):
                modbus.exception_words(request.fault)
                if not request.fault and request.function in modbus.READS:
                    framing.reply(request, [0] * request.count)
                framing.refuse(request, modbus.ILLEGAL_VALUE)


def _t7(data: bytes) -> None:
    reader = StreamReader(3)
    with refusals():
        for piece in pieces(data):
            for run in reader.feed(piece):
                assert run.samples.shape[1] == 3


def _gyros(data: bytes) -> None:
    kvh, stim, numbers = FrameReader([kvh1760.FORMAT]), FrameReader(_STIM_FORMATS), SequenceNumbers(128)
    for piece in pieces(data):
        for run in kvh.feed(piece):
            found = kvh1760.decode_frames(run.rows)
            numbers.unwrap(found.sequence)
            kvh1760.status_words(int(found.status[0]))
        for run in stim.feed(piece):
            with refusals():
                _read_stim(run.format.header[0], run.rows)
    assert kvh.waiting < kvh1760.FORMAT.length


def _read_stim(number: int, rows: np.ndarray[tuple[int, int], np.dtype[np.uint8]]) -> None:
    if number in stim300.PARTS:
        stim300.status_words(int(stim300.decode_frames(number, rows).status[0]))
    elif number in (0xBC, 0xBD):
        stim300.decode_configuration(rows[0])
    else:
        stim300.decode_serial(rows[0])


def seeds() -> list[bytes]:
    scans = np.arange(36, dtype=np.uint16).reshape(3, 12)
    configuration = stim300.StimConfiguration(datagram_id=0x90, crlf=False, rate_hz=125.0, gyro_unit="angular rate")
    return [
        b"\x00" + encode_packets(scans, first_transaction=65534),
        b"\x00" + encode_packets(scans, first_transaction=5, status=2941, additional=4),
        b"\x03" + bytes.fromhex("000100000006 11 03 006B 0003 000200000009 01 10 0001 0001 02 1234"),
        b"\x00" + modbus.with_crc(bytes.fromhex("11 03 006B 0003")) + modbus.with_crc(bytes.fromhex("01 06 0001 0003")),
        b"\x00" + kvh1760.encode_frames(np.ones((3, 3)), 2500, first_sequence=126),
        b"\x07" + stim300.encode_frames(0x94, np.ones((2, 3)), counter=[1, 2], temperature_c=25.0),
        b"\x00" + stim300.encode_configuration(configuration),
        b"\x00" + stim300.encode_serial("12345678901234"),
    ]


HARNESS = Harness(
    name="frames",
    weight=15,
    one_input=one_input,
    seeds=seeds,
    tokens=(kvh1760.HEADER, b"\x90", b"\xbc", b"\x4c\x10", b"\x0b\x7d", b"\x01\x10\x00\x00\x00\x7b\xf6", b"\xff\xff"),
)
