r"""SCPI, the command language of measuring instruments (SCPI-1999, IEEE 488.2): commands and channel lists. No I/O.

::

    :SENS:FUNC "VOLT",(@101:102);:INIT LF      request: commands, separated by ;
    \________/ \____/ \________/
    header     text   channel list

Headers are case-insensitive; each mnemonic has a long and a short form, written as in manuals: `VOLTage`. A mnemonic in
brackets may be missing: `[SENSe:]VOLTage[:DC]:NPLC`. A header that does not begin with a colon continues at the level
of the previous one, unless it is a common command, which begins with `*`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.lines import MOST_SHOWN, UnreadableError, parse_number

OVERLOAD = 9.9e37
"""The magnitude of a reading that is outside its range."""
IDENTITY, NEXT_ERROR = "*IDN?", "SYST:ERR?"
_QUOTED_OR_LIST = r"\"[^\"]*\"|'[^']*'|\([^)]*\)"
_PARTS = {sign: re.compile(rf"(?:{_QUOTED_OR_LIST}|[^{sign}])+") for sign in ";,"}
_CHANNELS = re.compile(r"\(@\s*(\d+(?:\s*[:,]\s*\d+)*)\s*\)")


@dataclass(frozen=True, slots=True, kw_only=True)
class ScpiCommand:
    """One command: its complete header in capitals, without the first colon, and its arguments without quotes."""

    header: str
    arguments: tuple[str, ...] = ()


def parse_commands(line: str) -> Iterator[ScpiCommand]:
    """Yield the commands of one line."""
    level = ""
    for text in _PARTS[";"].findall(line):
        words = text.split(maxsplit=1)
        if not words:
            continue
        header = words[0].upper()
        if not header.startswith("*"):
            header = header[1:] if header.startswith(":") else level + header
            level = header[: header.rfind(":") + 1]
        arguments = (part.strip().strip("\"'") for part in _PARTS[","].findall(words[1] if words[1:] else ""))
        yield ScpiCommand(header=header, arguments=tuple(arguments))


@lru_cache(maxsize=512)
def header_pattern(written: str) -> re.Pattern[str]:
    """Return the pattern of the headers that mean a command, which is written as in manuals."""
    text = written.replace("*", r"\*").replace("?", r"\?").replace("[", "(?:").replace("]", ")?")
    return re.compile(re.sub(r"(?<=[A-Z0-9])[a-z]+", lambda rest: f"(?:{rest[0].upper()})?", text))


def channel_list(channels: Iterable[int]) -> str:
    """Return `(@101,102)`."""
    return f"(@{','.join(map(str, channels))})"


def parse_channels(text: str) -> tuple[int, ...]:
    """Return the channels of `(@101,103:105)`; raises `InstrumentError` if it is no list of channels."""
    found = _CHANNELS.fullmatch(text)
    if found is None:
        raise InstrumentError(f"expected a list of channels such as (@101,102), got {text[:MOST_SHOWN]!r}")
    channels: list[int] = []
    for part in found[1].split(","):
        first, _, last = part.partition(":")
        channels += range(int(first), int(last or first) + 1)
    return tuple(channels)


def parse_numbers(text: str, count: int) -> tuple[float, ...]:
    """Return `count` numbers, separated by commas; raises `UnreadableError` otherwise."""
    words = text.split(",")
    if len(words) != count:
        raise UnreadableError(f"expected {count} numbers, got {len(words)}: {text[:MOST_SHOWN]!r}")
    return tuple(map(parse_number, words))


def parse_error(text: str) -> tuple[int, str]:
    """Return code and text of the answer to `SYST:ERR?`, `0,"No error"`; raises `UnreadableError` otherwise."""
    code, comma, says = text.partition(",")
    number = parse_number(code)
    if not comma or number != int(number):
        raise UnreadableError(f"expected a code and a text, got {text[:MOST_SHOWN]!r}")
    return int(number), says.strip().strip('"')
