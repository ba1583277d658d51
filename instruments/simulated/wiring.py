"""What bench.toml says of an instrument's wire, as keywords of its simulated twin: the two ends have to agree.

A keyword that a driver and its twin both have means the same at both ends: a unit's number, a loop, a channel, the
order of words. Keywords that only the driver has are the host's own affair (time-outs, pauses), but for those of
`BOTH_ENDS`: a twin that does not take them would be wired otherwise than the driver believes.

An address says on what kind of line to serve, nothing else: the twin takes a device or a port of its own.

| address     | the twin serves                                                                             |
|-------------|---------------------------------------------------------------------------------------------|
| (none)      | what it serves by itself                                                                    |
| `serial://` | a pseudo-terminal; where the system has none, the same bytes over TCP                       |
| `tcp://`    | TCP; a controller that has only a serial line: its bytes over TCP, as behind a server of    |
| `socket://` | serial ports                                                                                |
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

from benchctl_instruments.catalog import Kind, driver, twin
from benchctl_instruments.errors import UsageError
from benchctl_instruments.links.address import parse_address

BOTH_ENDS = frozenset(
    {
        "axis",
        "changes",
        "clockwise",
        "encoder_channel",
        "gyro_ain",
        "loop",
        "on_by",
        "on_event",
        "on_number",
        "rs485_address",
        "thermistor_ain",
        "unit_id",
        "word_order",
    }
)
LINE = "over_tcp"


def twin_keywords(
    kind: Kind, model: str, *, options: Mapping[str, Any], address: str | None = None, profile: str = ""
) -> dict[str, Any]:
    """The keywords with which the twin of a model is wired as its driver with these options at that address.

    `profile` is as of `benchctl_instruments.catalog.twin`.

    Raises
    ------
    UsageError
        Where the twin cannot be wired so.
    """
    takes = inspect.signature(twin(kind, model, profile)).parameters
    usual = inspect.signature(driver(kind, model, profile)).parameters
    for name in sorted(BOTH_ENDS & options.keys() - takes.keys()):
        if name not in usual or options[name] != usual[name].default:
            raise UsageError(
                f"{kind}.options: {name} = {options[name]!r}: the simulated {model} cannot be wired so; leave it out "
                "where simulated is true"
            )
    found = {name: value for name, value in options.items() if name in takes}
    if address is None:
        return found
    serial = parse_address(address).scheme == "serial"
    if LINE in takes:
        return found | {LINE: not serial}
    if serial:
        raise UsageError(
            f"{kind}.address {address!r}: the simulated {model} has no serial line; leave the address out where "
            "simulated is true"
        )
    return found
