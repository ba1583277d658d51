r"""ACL, the command language of the Acutronic ACUTROL3000, as it goes over TCP. Bytes in, replies out; no I/O here.

Source: openly published driver code of three laboratories (IEAv-EFO/acutrol3000, williamsea/Acutrol,
AcutronicRobotics/acutrol); the vendor's manuals were not used. Not tried on hardware.

A command is a line of ASCII, and every line gets one line back::

    :read:pos? 1;rate? 1;acc? 1 CR LF          request: :main:sub? axis,argument;sub? axis,...
    \__/ \__/  \ `------------.
    subtree     axis           continues in the same subtree

    hhhhhhhh 12.5;0.0;0.0 CR LF                reply: 8 characters of header, then data, or OK for a command
    \______/ \___________/
    header    data, one item a query, parted by ;

Names are case-insensitive and may be cut short, down to one letter (`:d:p 1,10`); where several names begin with the
same letters the one that is listed first in `TREE` is meant. `:mode 1,rate` is another spelling of `:mode:rate 1`;
below `:read` the question mark may be missing; a blank may precede a colon, or part arguments (`:L :R P 1 60`). A
command that begins with `:` or `*` starts at the root again.

Assumed, because no source says so: the reply's line ends with LF, a CR before it is optional; anything but OK as the
answer to a command is a refusal. The meaning of the header is unknown, so it is kept and not interpreted.

Survived: replies and requests cut into packets at any byte, several in one packet, empty lines, CR LF or LF. A line
beyond `lines.MAX_LINE` bytes or one shorter than the header ends the dialogue: whatever talks there is not an ACUTROL.
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
    """One line from the controller: its header, uninterpreted, and what follows, without blanks around it."""

    header: str
    data: str

    @property
    def ok(self) -> bool:
        """Whether it acknowledges a command."""
        return self.data.upper() == "OK"


@dataclass(frozen=True, slots=True, kw_only=True)
class AclCommand:
    """One command, names in full: `path` ("read", "position"), ("mode",) or ("*stb",); `arguments` without blanks."""

    path: tuple[str, ...]
    query: bool
    arguments: tuple[str, ...] = ()


class AclLines:
    """Cuts a byte stream into lines without their ends; raises `InstrumentError` as `LineCutter` does."""

    def __init__(self, terminator: bytes = b"\n") -> None:
        self._cutter = LineCutter(terminator, trimmed=b"\r\n")  # a header may begin with blanks

    def feed(self, data: bytes) -> list[str]:
        """The lines that are complete now, empty ones left out; bytes that are not ASCII show as escapes."""
        try:
            return self._cutter.feed(data)
        except InstrumentError as err:
            raise InstrumentError(f"{err}: this is not ACL") from err


class ReplyReader:
    """The client's side: feed it whatever arrives."""

    def __init__(self, terminator: bytes = b"\n") -> None:
        self._lines = AclLines(terminator)

    def feed(self, data: bytes) -> list[Reply]:
        """The replies that are complete now; `InstrumentError` for what cannot be a reply."""
        return [_reply(line) for line in self._lines.feed(data)]


def _reply(line: str) -> Reply:
    if len(line) < HEADER_LENGTH:
        raise InstrumentError(
            f"a reply of {len(line)} characters, {line!r}, is shorter than ACL's header of {HEADER_LENGTH}"
        )
    return Reply(header=line[:HEADER_LENGTH], data=line[HEADER_LENGTH:].strip())


def encode(command: str) -> bytes:
    """A command line as it is sent; `UsageError` where it is not one line of ASCII."""
    if not command.isascii() or not command.isprintable() or not command.strip():
        raise UsageError(f"{command!r} is not one line of printable ASCII, which an ACL command is")
    return command.encode("ascii") + b"\r\n"


def encode_reply(header: str, data: str) -> bytes:
    """A reply line as the controller sends it; `UsageError` where the header does not have its 8 characters."""
    if len(header) != HEADER_LENGTH:
        raise UsageError(f"the header {header!r} must have {HEADER_LENGTH} characters")
    return f"{header}{data}\r\n".encode("ascii", "backslashreplace")


def parse_commands(line: str) -> Iterator[AclCommand]:
    """The commands of one line, names in full; `UsageError` on reaching one that the language does not have."""
    subtree = ""
    for item in line.split(";"):
        command, subtree = _parse(item.strip(), subtree)
        yield command


@lru_cache(maxsize=256)  # a host asks the same few things all day
def _parse(text: str, subtree: str) -> tuple[AclCommand, str]:
    """One command, where the one before it left off in `subtree`; and where this one leaves off."""
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
