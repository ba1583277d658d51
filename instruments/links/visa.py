"""A link through PyVISA, for instruments that answer in lines: GPIB, USBTMC, VXI-11 and what else a VISA reaches.

PyVISA finds an installed VISA (NI, Keysight), otherwise PyVISA-py; the environment variable `PYVISA_LIBRARY` names
another one. The policy is that of `links.tcp`: nothing is ever sent twice, and failures raise errors. The next `send`
reopens a resource that was given up; on GPIB it first sends a device clear, so that a late reply is never taken for
the answer to the next question.

A message ends with LF, or with the signal EOI of GPIB. Tried with PyVISA-sim, not on hardware.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from benchctl_instruments.errors import LinkError, UsageError, in_line
from benchctl_instruments.links.address import parse_address, refuse_timeout
from benchctl_instruments.links.tcp import LinkCutError
from benchctl_instruments.links.wirelog import WireLog

if TYPE_CHECKING:
    from pyvisa.resources import MessageBasedResource


class VisaLink:
    """One resource at a `visa://RESOURCE` address. Not thread-safe.

    Every `LinkError` names the address and the attempted action.
    """

    def __init__(self, address: str, *, wire_log: WireLog | None = None) -> None:
        self.address = parse_address(address)
        if self.address.scheme != "visa":
            raise UsageError(f"address {address!r}: expected a VISA resource, visa://GPIB0::7::INSTR")
        self.wire_log = wire_log if wire_log is not None else WireLog()
        self._resource: MessageBasedResource | None = None
        self._timeout_s: float | None = None  # None: not open
        self._was_cut = False

    def open(self, timeout_s: float) -> None:
        """Open the resource; `timeout_s` is the timeout, in wall time, of opening and of all writes.

        Raises `UsageError` if PyVISA is not installed.
        """
        refuse_timeout(self.address, timeout_s)
        self.close()
        self._timeout_s = timeout_s
        try:
            self._connect()
        except (LinkError, UsageError):
            self._timeout_s = None
            raise

    def close(self) -> None:
        """Close the resource; safe to call twice, and never raises."""
        self._timeout_s, self._was_cut = None, False
        self._drop("closed")

    def cut(self, why: str) -> None:
        """Close the resource but stay open: the next `send` reopens it, without input received meanwhile."""
        self._drop(why)
        self._was_cut = True

    def send(self, data: bytes) -> None:
        """Send all data as one message."""
        resource = self._resource if self._resource is not None else self._connect()
        self.wire_log.sent(data)
        try:
            resource.timeout = _milliseconds(self._timeout_s)
            resource.write_raw(data)
        except _failures() as err:
            self.cut(f"cut while sending: {err}")
            raise LinkCutError(
                f"{self.address}: could not send {data[:64]!r}: {in_line(str(err))}; check the cable and the"
                " instrument's address"
            ) from err

    def receive(self, max_bytes: int, timeout_s: float) -> bytes:
        """Return the next message, within `timeout_s` of wall time; it is read in pieces of `max_bytes`."""
        if self._resource is None:
            raise LinkCutError(f"{self.address}: the resource was given up, nothing can be received; send first")
        try:
            self._resource.timeout = _milliseconds(timeout_s)
            data = self._resource.read_raw(max_bytes)
        except _failures() as err:
            if _is_timeout(err):
                raise LinkError(f"{self.address}: nothing came within {timeout_s:.3g} s") from err
            self.cut(f"cut while receiving: {err}")
            raise LinkCutError(
                f"{self.address}: the link broke while receiving: {in_line(str(err))}; check the cable"
            ) from err
        self.wire_log.received(data)
        return data

    def _connect(self) -> MessageBasedResource:
        if self._timeout_s is None:
            raise UsageError(f"{self.address}: the link is not open; call open() first")
        try:
            import pyvisa
            from pyvisa.resources import MessageBasedResource
        except ImportError as err:
            raise UsageError(
                f"{self.address}: visa:// needs PyVISA, which is not installed: pip install 'benchctl[visa]'"
            ) from err
        try:
            resource = pyvisa.ResourceManager().open_resource(
                self.address.device, open_timeout=_milliseconds(self._timeout_s)
            )
            if not isinstance(resource, MessageBasedResource):
                raise UsageError(
                    f"{self.address}: this VISA resource has no messages; expected GPIB0::7::INSTR or such"
                )
            resource.timeout = _milliseconds(self._timeout_s)
            resource.read_termination = "\n"
            if self._was_cut and self.address.is_gpib:
                with contextlib.suppress(NotImplementedError):  # PyVISA-sim
                    resource.clear()
        except _failures() as err:
            raise LinkError(
                f"{self.address}: cannot be opened: {in_line(str(err))}; check that the instrument is switched on, its"
                " address, and that the VISA of this computer serves that interface"
            ) from err
        self._resource, self._was_cut = resource, False
        self.wire_log.note(f"opened {self.address}")
        return resource

    def _drop(self, why: str) -> None:
        if self._resource is None:
            return
        self.wire_log.note(why)
        resource, self._resource = self._resource, None
        with contextlib.suppress(*_failures()):  # a resource that is already gone cannot be closed cleanly
            resource.close()


def _milliseconds(seconds: float | None) -> int:
    return max(1, round(1000.0 * (seconds or 0.0)))


def _failures() -> tuple[type[Exception], ...]:
    """Return what PyVISA and its backends raise; a missing backend is a ValueError."""
    from pyvisa.errors import Error

    return Error, OSError, ValueError


def _is_timeout(err: Exception) -> bool:
    from pyvisa.constants import StatusCode

    return getattr(err, "error_code", None) == StatusCode.error_timeout
