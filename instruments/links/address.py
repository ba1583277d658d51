"""Addresses of instruments: `tcp://HOST:PORT`, `serial://DEVICE?baud=N`, `socket://HOST:PORT`, `visa://…`, `daqmx://…`.

`tcp://` is a plain TCP connection. `serial://` is a port of this machine (`serial:///dev/ttyUSB0?baud=19200`,
`serial://COM3?baud=9600`). `socket://` is a serial line at the far end of a TCP connection, opened by pyserial's
handler of that name: a serial-to-Ethernet box, or a simulated instrument. `visa://` is a resource of VISA, for drivers
whose instruments answer in lines: `visa://GPIB0::7::INSTR`. `daqmx://` is a device of NI-DAQmx: `daqmx://Dev1` of this
computer, `daqmx://HOST:PORT/Dev1` of one with an NI gRPC Device Server.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal
from urllib.parse import SplitResult, parse_qs, urlsplit

from benchctl_instruments.errors import LinkError, UsageError

_EXPECTED = (
    "expected tcp://HOST:PORT, serial:///dev/ttyUSB0?baud=19200, serial://COM3?baud=9600, socket://HOST:PORT,"
    " visa://GPIB0::7::INSTR or daqmx://Dev1"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Address:
    """A parsed address; `str()` returns the original text.

    `host` and `port` are set for tcp and socket, `device` for serial and visa; daqmx has a device, and a host if that
    is on another computer. `baud` is None if the address does not state it.
    """

    text: str
    scheme: Literal["tcp", "serial", "socket", "visa", "daqmx"]
    host: str = ""
    port: int = 0
    device: str = ""
    baud: int | None = None

    def __str__(self) -> str:
        return self.text

    @property
    def pyserial_url(self) -> str:
        """The URL for `serial.serial_for_url`; for serial and socket addresses."""
        return self.device if self.scheme == "serial" else self.text

    @property
    def is_gpib(self) -> bool:
        """Whether it is a GPIB instrument, reached through VISA."""
        return self.scheme == "visa" and self.device.upper().startswith("GPIB")

    def left_out(self, err: LinkError) -> str:
        """Return a link's error message without the address, for an error that already names the address."""
        return str(err).removeprefix(f"{self}: ")


def parse_address(text: str) -> Address:
    """Parse an address; raises `UsageError` with the expected forms."""
    try:
        parts = urlsplit(text)
        if parts.scheme == "serial":
            return _serial_address(text, parts)
        if parts.scheme == "visa":
            return _visa_address(text)
        if parts.scheme == "daqmx":
            return _daqmx_address(text, parts)
        if parts.scheme == "tcp":
            return Address(text=text, scheme="tcp", host=_host(parts), port=_port(parts))
        if parts.scheme == "socket":
            return Address(text=text, scheme="socket", host=_host(parts), port=_port(parts))
    except ValueError as err:
        raise UsageError(f"address {text!r}: {err}; {_EXPECTED}") from err
    raise UsageError(
        f"address {text!r}: {f'unknown scheme {parts.scheme!r}' if parts.scheme else 'no scheme'}; {_EXPECTED}"
    )


def refuse_timeout(address: Address, timeout_s: float) -> None:
    """Raise `UsageError` if the timeout is not a usable time."""
    if not 0.0 < timeout_s < math.inf:
        raise UsageError(f"address {str(address)!r}: a time-out of {timeout_s} s; give a finite one above 0")


def _host(parts: SplitResult) -> str:
    if parts.path or parts.query or parts.fragment or parts.username is not None:
        raise ValueError("only host and port are allowed")
    if not parts.hostname:
        raise ValueError("the host is missing")
    return parts.hostname


def _port(parts: SplitResult) -> int:
    port = parts.port  # urllib raises ValueError if it is not a number or above 65535
    if not port:
        raise ValueError("the port is missing or 0")
    return port


def _visa_address(text: str) -> Address:
    device = text.partition("://")[2]
    if "::" not in device or not device.isprintable() or " " in device:
        raise ValueError("the VISA resource is missing, or is none")
    return Address(text=text, scheme="visa", device=device)


def _daqmx_address(text: str, parts: SplitResult) -> Address:
    remote = parts.path.removeprefix("/")
    device = remote or parts.netloc
    if not device.isidentifier():
        raise ValueError("the name of the device is missing, or is none")
    if not remote:
        return Address(text=text, scheme="daqmx", device=device)
    return Address(text=text, scheme="daqmx", host=_host(parts._replace(path="")), port=_port(parts), device=device)


def _serial_address(text: str, parts: SplitResult) -> Address:
    device = parts.netloc + parts.path
    if not device:
        raise ValueError("the device is missing")
    settings = parse_qs(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
    unknown = settings.keys() - {"baud"}
    if unknown:
        raise ValueError(f"unknown setting {min(unknown)!r}")
    baud: int | None = None
    if "baud" in settings:
        written = settings["baud"][-1]
        if not written.isascii() or not written.isdecimal() or int(written) == 0:
            raise ValueError(f"baud must be a whole number above 0, not {written!r}")
        baud = int(written)
    return Address(text=text, scheme="serial", device=device, baud=baud)
