r"""ACL, the command language of the Acutronic ACUTROL3000 over TCP and GPIB. Converts bytes and replies; no I/O.

Source: openly published driver code of three laboratories (IEAv-EFO/acutrol3000, williamsea/Acutrol,
AcutronicRobotics/acutrol); the vendor's manuals were not used. Not tried on hardware.

A command is a line of ASCII, and over TCP every line is answered with one line::

    :read:pos? 1;rate? 1;acc? 1 CR LF          request: :main:sub? axis,argument;sub? axis,...
    \__/ \__/  \ `------------.
    subtree     axis           continues in the same subtree

    hhhhhhhh 12.5;0.0;0.0 CR LF                reply: 8 characters of header, then data, or OK for a command
    \______/ \___________/
    header    data, one item a query, separated by ;

On GPIB only queries are answered, and a reply has no header; errors are shown by the status byte (`*stb?`).

Names are case-insensitive and may be abbreviated, down to one letter (`:d:p 1,10`); if several names begin with the
same letters, the first one in `TREE` is used. `:mode 1,rate` is another spelling of `:mode:rate 1`; below `:read` the
question mark may be missing; a blank may precede a colon, or separate arguments (`:L :R P 1 60`). A command that begins
with `:` or `*` starts at the root again.

Assumptions without a source: a reply ends with LF, optionally preceded by CR; any answer to a command other than OK is
a refusal. The meaning of the header is unknown, so it is kept and not interpreted.

Accepted input: replies and requests split into packets at any byte, several in one packet, empty lines, CR LF or LF. A
line longer than `lines.MAX_LINE` bytes or shorter than the header ends the dialogue: the other side is not an ACUTROL.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.protocols.lines import LineCutter

HEADER_LENGTH = 8

TREE: Mapping[str, tuple[str, ...]] = {
    "read": ("position", "rate", "acceleration"),
    "demand": ("position", "rate", "acceleration", "oscillator", "delta"),
    "mode": ("position", "rate", "arate", "synthesizer", "off"),
    "interlock": ("open", "close", "reset"),
    "limit": ("acceleration", "rate", "vtrip", "absolute", "lposition", "hposition"),
    "configure": ("oscillator", "window"),
    "utility": ("lockout", "format", "touch"),
}
COMMON = ("*idn", "*stb")
_BLANK_COLON = re.compile(r"\s+:")


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """One line from the controller: its header, uninterpreted, and the following text, stripped of blanks."""

    header: str
    data: str

    @property
    def ok(self) -> bool:
        """Whether it acknowledges a command."""
        return self.data.upper() == "OK"


@dataclass(frozen=True, slots=True, kw_only=True)
class AclCommand:
    """One command with full names: `path` ("read", "position"), ("mode",) or ("*stb",); `arguments` without blanks."""

    path: tuple[str, ...]
    query: bool
    arguments: tuple[str, ...] = ()


class AclLines:
    """Split a byte stream into lines without their ends; raises `InstrumentError` as `LineCutter` does."""

    def __init__(self, terminator: bytes = b"\n") -> None:
        self._cutter = LineCutter(terminator, trimmed=b"\r\n")  # a header may begin with blanks

    def feed(self, data: bytes) -> list[str]:
        """Return the lines that are now complete, without empty ones; bytes that are not ASCII become escapes."""
        try:
            return self._cutter.feed(data)
        except InstrumentError as err:
            raise InstrumentError(f"{err}: this is not ACL") from err


class ReplyReader:
    """Split the controller's bytes into replies, on the client's side; on GPIB `header_length` is 0."""

    def __init__(self, terminator: bytes = b"\n", *, header_length: int = HEADER_LENGTH) -> None:
        self._lines = AclLines(terminator)
        self._header_length = header_length

    def feed(self, data: bytes) -> list[Reply]:
        """Return the replies that are now complete; raises `InstrumentError` for an invalid reply."""
        return [self._reply(line) for line in self._lines.feed(data)]

    def _reply(self, line: str) -> Reply:
        length = self._header_length
        if len(line) < length:
            raise InstrumentError(
                f"a reply of {len(line)} characters, {line!r}, is shorter than ACL's header of {length}"
            )
        return Reply(header=line[:length], data=line[length:].strip())


def encode(command: str) -> bytes:
    """Return a command line as bytes; raises `UsageError` if it is not one line of ASCII."""
    if not command.isascii() or not command.isprintable() or not command.strip():
        raise UsageError(f"{command!r} is not one line of printable ASCII, which an ACL command is")
    return command.encode("ascii") + b"\r\n"


def encode_reply(header: str, data: str) -> bytes:
    """Return a reply line as bytes; raises `UsageError` if the header does not have 8 characters."""
    if len(header) != HEADER_LENGTH:
        raise UsageError(f"the header {header!r} must have {HEADER_LENGTH} characters")
    return f"{header}{data}\r\n".encode("ascii", "backslashreplace")


def parse_commands(line: str) -> Iterator[AclCommand]:
    """Yield the commands of one line, with full names; raises `UsageError` at a command that does not exist."""
    subtree = ""
    for item in line.split(";"):
        command, subtree = _parse(item.strip(), subtree)
        yield command


@lru_cache(maxsize=256)  # a host repeats the same few requests
def _parse(text: str, subtree: str) -> tuple[AclCommand, str]:
    """Return one command, given the subtree of the previous one, and the subtree after it."""
    names, _, arguments = _BLANK_COLON.sub(":", text).partition(" ")
    query = names.endswith("?")
    names = names.removesuffix("?").lower()
    if names.startswith("*"):
        path = _common(names, text)
    elif subtree and not names.startswith(":"):
        path = (subtree, _full(names, TREE[subtree], text))
    else:
        path = _from_root(names.removeprefix(":"), text)
        subtree = path[0]
    words = tuple(re.split(r"\s*,\s*|\s+", arguments.strip())) if arguments.strip() else ()
    return _usual_spelling(AclCommand(path=path, query=query or path[0] == "read", arguments=words), text), subtree


def _common(names: str, text: str) -> tuple[str, ...]:
    if names not in COMMON:
        raise UsageError(f"unknown command {text[:64]!r}")
    return (names,)


def _from_root(names: str, text: str) -> tuple[str, ...]:
    main, _, sub = names.partition(":")
    main = _full(main, tuple(TREE), text)
    return (main, _full(sub, TREE[main], text)) if sub else (main,)


def _full(name: str, candidates: tuple[str, ...], text: str) -> str:
    for candidate in candidates:
        if name and candidate.startswith(name):
            return candidate
    raise UsageError(f"unknown command {text[:64]!r}")


def _usual_spelling(command: AclCommand, text: str) -> AclCommand:
    if command.path != ("mode",) or command.query:
        return command
    if len(command.arguments) != 2:
        raise UsageError(f"{text[:64]!r}: expected an axis and a mode")
    axis, mode = command.arguments
    return AclCommand(path=("mode", _full(mode.lower(), TREE["mode"], text)), query=False, arguments=(axis,))
