"""The protocol ASCII-2 of Weiss and Vötsch chambers. Converts texts and values; no I/O.

Sources: the descriptions that four chambers gave of themselves and that their owners published (a temperature and
climate chamber of 2 firmwares in the tests of a C# driver, a Vc3 7060 and a Vt3 7060 in a simulator), and the clients
ondrejh/VT4002, Embida/pyVT4002 and of a Weiss WT120. Not tried on hardware.

Every request begins with "$", the chamber's address in two digits and a letter::

    $01I CR                                the state: values, then digital channels
    0050.0 0024.6 0080.0 0066.7 … 0110… CR
    $01E 0050.0 0080.0 … 0110… CR          writes set values and all digital channels; answered with 0
    $01? CR                                the description of both strings, several lines

The strings of a chamber depend on its equipment, so the description is needed: CV01 is the temperature (nominal, then
actual value in the state), further CVs are other controlled values, SVs are set values, MVs measured ones, DO01 is the
start channel. Values have four digits before the decimal point, a sign included, and one after it.

Accepted input: that of `protocols.lines`; for any text, a reader returns or raises `UnreadableError`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from benchctl_instruments.protocols.lines import MOST_SHOWN, UnreadableError, tenths

START = 1
"""The digital channel that starts the chamber, counted from 0."""
TEMPERATURE = "CV01"
ACCEPTED = "0"

_NAMES = r"((?:(?:CV|SV|MV|DO)[0-9]{2})+)"
_WRITTEN = re.compile(rf"\$[0-9]{{2}}E{_NAMES}")
_STATE = re.compile(rf"\$[0-9]{{2}}I<CR>{_NAMES}")
_RANGE = re.compile(
    r"CV01\s+value\s+min:\s*(-?[0-9]{1,4}\.[0-9])\s+value\s+max:\s*(-?[0-9]{1,4}\.[0-9])", re.IGNORECASE
)
_LINE = re.compile(r"((?:-?[0-9]{3,4}\.[0-9] )+)([01]{2,64})")


@dataclass(frozen=True, slots=True, kw_only=True)
class Description:
    """Names of the values in a written string and in the state, the digital channels written, the range of CV01."""

    written: tuple[str, ...]
    state: tuple[str, ...]
    channels: int
    low_c: float
    high_c: float


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """Values in the order of the description, and the digital channels as text of 0 and 1."""

    values: tuple[float, ...]
    channels: str

    @property
    def setpoint_c(self) -> float:
        """The nominal value of CV01, which all descriptions have first."""
        return self.values[0]

    @property
    def air_c(self) -> float:
        """The actual value of CV01."""
        return self.values[1]

    @property
    def started(self) -> bool:
        """Whether the start channel is on."""
        return self.channels[START] == "1"


def request(address: int, letter: str) -> str:
    """Return a request without parameters: I for the state, ? for the description."""
    return f"${address:02d}{letter}"


def set_request(address: int, values: tuple[float, ...], channels: str) -> str:
    """Return the request that writes all set values and channels."""
    return " ".join((request(address, "E"), *map(value_text, values), channels))


def value_text(value: float) -> str:
    """Return a value as on the wire."""
    return f"{tenths(value):06.1f}"


def changed(
    description: Description, state: State, *, setpoint_c: float | None, start: bool
) -> tuple[tuple[float, ...], str]:
    """Return the values and channels to write that change only the set point and the start channel.

    The nominal or set value of each name is the first one in the state; MVs are not set.
    """
    present = dict(zip(reversed(description.state), reversed(state.values), strict=True))
    if setpoint_c is not None:
        present[TEMPERATURE] = setpoint_c
    values = tuple(0.0 if name.startswith("MV") else present[name] for name in description.written)
    channels = state.channels[:START] + str(int(start)) + state.channels[START + 1 :]
    return values, channels[: description.channels].ljust(description.channels, "0")


def read_state(line: str, description: Description) -> State:
    """Parse the answer to I."""
    found = _LINE.fullmatch(line)
    values = () if found is None else tuple(map(float, found[1].split()))
    if found is None or len(values) != len(description.state):
        raise UnreadableError(f"expected {len(description.state)} values and the channels, got {line[:MOST_SHOWN]!r}")
    return State(values=values, channels=found[2])


def recognised(line: str) -> str:
    """Describe a chamber by its answer to I, without the description of its values."""
    found = _LINE.fullmatch(line)
    if found is None:
        raise UnreadableError(f"expected values and channels, got {line[:MOST_SHOWN]!r}")
    return f"Weiss/Vötsch, ASCII-2, {len(found[1].split())} values, {len(found[2])} channels"


def read_accepted(line: str) -> None:
    """Check the answer to a request that writes."""
    if line != ACCEPTED:
        raise UnreadableError(f"expected {ACCEPTED}, got {line[:MOST_SHOWN]!r}")


def read_description(text: str) -> Description:
    """Parse the answer to ?; its lines may break inside a name."""
    squeezed = re.sub(r"\s", "", text).upper()
    written, state, limits = _WRITTEN.search(squeezed), _STATE.search(squeezed), _RANGE.search(text)
    if written is None or state is None or limits is None:
        raise UnreadableError(f"expected a description of its E and I strings, got {text[:MOST_SHOWN]!r}")
    set_names, set_channels = _split(written[1])
    names, _ = _split(state[1])
    unknown = [name for name in set_names if name not in names and not name.startswith("MV")]
    if names[:2] != (TEMPERATURE, TEMPERATURE) or unknown or len(set_channels) <= START:
        raise UnreadableError(f"expected a state with CV01 first and all set values, got {' '.join(names)}")
    return Description(
        written=set_names,
        state=names,
        channels=max(int(name[2:]) for name in set_channels) + 1,
        low_c=float(limits[1]),
        high_c=float(limits[2]),
    )


def _split(names: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of values and of digital channels."""
    parts = re.findall("[A-Z]{2}[0-9]{2}", names)
    return (
        tuple(part for part in parts if not part.startswith("DO")),
        tuple(part for part in parts if part.startswith("DO")),
    )
