"""Lines of ASCII cut out of a byte stream, for every protocol that speaks in lines, and numbers in them. No I/O here.

Survived: lines cut into packets at any byte, several in one packet, empty lines, a CR before the LF, and noise: bytes
before and after a line's text that print nothing (a break on a serial line shows as NUL) are dropped, others inside it
show as escapes. A line beyond `MAX_LINE` bytes is an error, and the memory it took is let go.
"""

from __future__ import annotations

import math
import re

from benchctl_instruments.errors import InstrumentError, UsageError

MAX_LINE = 4096
MOST_SHOWN = 64
"""So much of a line an error repeats."""

_NUMBER = re.compile(r"[+-]?([0-9]{1,20}(\.[0-9]{0,20})?|\.[0-9]{1,20})([eE][+-]?[0-9]{1,3})?")

_PRINTING = bytes(range(0x21, 0x7F))
_NOT_PRINTING = bytes(set(range(256)) - set(_PRINTING))  # blanks among them


class LineCutter:
    """Cuts a byte stream into lines; `end` is what ends one.

    Parameters
    ----------
    end
        One byte or several; LF takes CR LF and LF alike.
    trimmed
        The bytes that are dropped before and after a line's text.
    """

    def __init__(self, end: bytes = b"\n", *, trimmed: bytes = _NOT_PRINTING) -> None:
        self._end = end
        self._trimmed = trimmed
        self._pending = b""

    def feed(self, data: bytes) -> list[str]:
        """The lines that are complete now, empty ones left out.

        Raises
        ------
        InstrumentError
            Where more than `MAX_LINE` bytes came without an end; lines that were complete before it are lost with it.
        """
        *complete, self._pending = (self._pending + data).split(self._end)
        longest = max((*complete, self._pending), key=len)
        if len(longest) > MAX_LINE:
            self._pending = b""
            raise InstrumentError(f"more than {MAX_LINE} bytes without an end of line, beginning {longest[:32]!r}")
        texts = (line.strip(self._trimmed).decode("ascii", "backslashreplace") for line in complete)
        return [text for text in texts if text.strip()]


def parse_number(text: str) -> float:
    """A finite number in decimal digits, blanks around it left out; `InstrumentError` for whatever else.

    Python itself would take words, digits of other scripts and digits parted by `_` too.
    """
    number = float(text) if _NUMBER.fullmatch(text.strip(" ")) else math.nan
    if not math.isfinite(number):
        raise InstrumentError(f"expected a number, got {text[:MOST_SHOWN]!r}")
    return number


def encode_line(text: str, end: bytes = b"\r\n") -> bytes:
    """A line as it is sent; `UsageError` where it is not one line of printable ASCII."""
    if not text.isascii() or not text.isprintable() or not text.strip():
        raise UsageError(f"{text!r} is not one line of printable ASCII")
    return text.encode("ascii") + end
