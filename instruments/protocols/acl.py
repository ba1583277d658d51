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
a refusal. The meaning of the header is unknown, so it is dropped. Accepted input is that of `protocols.lines`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

from benchctl_instruments.errors import UsageError
from benchctl_instruments.protocols.lines import MOST_SHOWN, UnreadableError

HEADER_LENGTH = 8
OK = "OK"
"""The data of a reply that acknowledges a command, in upper case."""
AROUND = b"\r\n"
"""The bytes that are dropped before and after a reply; blanks may belong to its header."""

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
class AclCommand:
    """One command with full names: `path` ("read", "position"), ("mode",) or ("*stb",); `arguments` without blanks."""

    path: tuple[str, ...]
    query: bool
    arguments: tuple[str, ...] = ()


def reply_data(line: str, *, header_length: int = HEADER_LENGTH) -> str:
    """Return the data of a reply without blanks around them; on GPIB `header_length` is 0.

    Raises `UnreadableError` if the line has bytes that are not ASCII, which are escapes in it, or is shorter than the
    header.
    """
    if "\\x" in line:
        raise UnreadableError(f"expected ASCII, got {line[:MOST_SHOWN]!r}")
    if len(line) < header_length:
        raise UnreadableError(f"expected a header of {header_length} characters and data, got {line!r}")
    return line[header_length:].strip()


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
