"""Instruments that speak in lines: ACL, ESPEC, Weiss, Aerotech Ensemble, Newport ESP301, KVH's settings; both sides."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from benchctl_instruments.errors import BenchError
from benchctl_instruments.protocols import acl, ascii2, ensemble, esp301, kvh1760, p300, simserv, thermotron
from benchctl_instruments.protocols.lines import LineCutter, parse_number
from tests.fuzz.harness import Harness, pieces, refusals

_READERS: tuple[Callable[[str], Any], ...] = (
    parse_number,
    lambda line: list(acl.parse_commands(line)),
    ensemble.parse_command,
    ensemble.parse_reply,
    ensemble.parse_bits,
    ensemble.is_bare,
    lambda line: list(esp301.parse_commands(line)),
    esp301.parse_error,
    esp301.parse_flag,
    esp301.is_unasked,
    p300.is_accepted,
    lambda line: p300.refusal_words(p300.refusal(line) or ""),
    p300.read_temperatures,
    p300.read_mode,
    p300.read_alarms,
    p300.read_type,
    p300.read_heater,
    lambda line: p300.parse_settings(p300.parse_request(line).parameters),
    ascii2.read_description,
    ascii2.read_accepted,
    acl.reply_data,
    simserv.parse_command,
    thermotron.parse_command,
    thermotron.read_code,
    simserv.read_whole,
    simserv.read_accepted,
)


def one_input(data: bytes) -> None:
    streams: list[Any] = [LineCutter(trimmed=acl.AROUND), LineCutter(), LineCutter(b"\r"), kvh1760.CommandReader()]
    for piece in pieces(data):
        for stream in streams:
            with refusals():
                stream.feed(piece)
    kvh1760.after_echo(data, "config", 1)
    kvh1760.after_leaving(data)
    kvh1760.refusal_in(data)
    for line in _lines(data):
        for read in _READERS:
            with refusals():
                read(line)


def _lines(data: bytes) -> list[str]:
    try:
        return LineCutter().feed(data[1:] + b"\n")[:4]
    except BenchError:
        return []


def seeds() -> list[bytes]:
    return [
        b"\x05:read:pos? 1;rate? 1;acc? 1\r\n:mode 1,rate\r\n*stb?\r\n",
        b"\x00hhhhhhhh 12.5;0.0;0.0\r\nhhhhhhhhOK\r\n",
        b"\x0727.0,50.0,185.0,-90.0\r\nOK:TEMP, S25.0\r\nNA:DATA OUT OF RANGE\r\n",
        b"\x01TEMP, S25.0 H130.0 L-45.0\r\n3,TEMP?\r\nMODE?,DETAIL\r\n1,TK,3\r\n2,45.0,0.0\r\n00100010\r\n",
        b"\x08%12.5\n!\n#\n$\nAXISFAULT(X)\nRAMP RATE X 10\n-2147483648\n",
        b"\x091PR+10.5;2VA?;1TP;TB?\r\n0, 451322, NO ERROR DETECTED\r\n38, 120, COMMAND PARAMETER MISSING\r\n",
        b"\x00=config,1\r\n=rotfmt,rate\r\nCONFIG,1\r\n",
    ]


HARNESS = Harness(
    name="lines",
    weight=200,
    one_input=one_input,
    seeds=seeds,
    tokens=(b":read", b"*idn?", b"OK:", b"NA:", b"\r\n", b"MODE?", b"TE?", b"%", b"1e999", b"=config,1", b"_"),
)
