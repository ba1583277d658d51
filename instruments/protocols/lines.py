"""Lines of ASCII in a byte stream, for every line-based protocol, and numbers in them. No I/O.

Accepted input: lines split into packets at any byte, several in one packet, empty lines, a CR before the LF, and noise:
non-printing bytes before and after a line's text are dropped (a break on a serial line appears as NUL), others inside
it become escapes. A line longer than `MAX_LINE` bytes is an error, and its memory is released.
"""

from __future__ import annotations

import math
import re

from benchctl_instruments.errors import InstrumentError, UsageError

MAX_LINE = 4096
MOST_SHOWN = 64
"""Largest part of a line that an error quotes."""

_NUMBER = re.compile(r"[+-]?([0-9]{1,20}(\.[0-9]{0,20})?|\.[0-9]{1,20})([eE][+-]?[0-9]{1,3})?")

_ANY_END = re.compile(rb"[\r\n]")
_PRINTING = bytes(range(0x21, 0x7F))
NOT_PRINTING = bytes(set(range(256)) - set(_PRINTING))  # includes blanks


class UnreadableError(InstrumentError):
    """An answer does not fit the question: it is corrupted, or another instrument's."""


class LineCutter:
    """Split a byte stream into lines.

    Parameters
    ----------
    end
        The bytes that end a line; LF accepts both CR LF and LF. None: CR, LF or both.
    trimmed
        The bytes that are dropped before and after a line's text.
    encoding
        Of the text; bytes that it does not have become escapes.
    """

    def __init__(self, end: bytes | None = b"\n", *, trimmed: bytes = NOT_PRINTING, encoding: str = "ascii") -> None:
        self._end = end
        self._trimmed = trimmed
        self._encoding = encoding
        self._pending = b""

    def feed(self, data: bytes) -> list[str]:
        """Add received bytes and return the lines that are complete, without empty ones.

        Raises
        ------
        InstrumentError
            If more than `MAX_LINE` bytes arrived without an end; complete lines before them are lost too.
        """
        data = self._pending + data
        *complete, self._pending = _ANY_END.split(data) if self._end is None else data.split(self._end)
        longest = max((*complete, self._pending), key=len)
        if len(longest) > MAX_LINE:
            self._pending = b""
            raise InstrumentError(f"more than {MAX_LINE} bytes without an end of line, beginning {longest[:32]!r}")
        texts = (line.strip(self._trimmed).decode(self._encoding, "backslashreplace") for line in complete)
        return [text for text in texts if text.strip()]


def parse_number(text: str) -> float:
    """Return a finite number in decimal digits, ignoring blanks around it; raises `UnreadableError` otherwise.

    Python itself would also accept words, digits of other scripts and digits separated by `_`.
    """
    number = float(text) if _NUMBER.fullmatch(text.strip(" ")) else math.nan
    if not math.isfinite(number):
        raise UnreadableError(f"expected a number, got {text[:MOST_SHOWN]!r}")
    return number


def tenths(value: float) -> float:
    """Return the nearest number with one decimal, as many chambers have it on the wire, without negative zero."""
    return round(value, 1) + 0.0


def encode_line(text: str, end: bytes = b"\r\n", *, encoding: str = "ascii") -> bytes:
    """Return a line as bytes; raises `UsageError` if it is not one line of printable text of the encoding."""
    try:
        data = text.encode(encoding)
    except UnicodeEncodeError:
        data = b""
    if not data or not text.isprintable() or not text.strip():
        raise UsageError(f"{text!r} is not one line of printable {encoding.upper()}")
    return data + end
