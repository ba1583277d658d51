"""NI-DAQmx by NI's package `nidaqmx`: a device of this computer, `daqmx://Dev1`, or of another one.

`daqmx://HOST:PORT/Dev1` is a device of the computer on which an NI gRPC Device Server runs; its calls are those of
NI-DAQmx's C interface, one by one. Over the network each call has a timeout; nothing is ever sent twice.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError, in_line
from benchctl_instruments.links.address import parse_address

OVERRUNS = frozenset({-200279, -200361, -200222, -200283, -200019, -200141, -201314, -201319})
"""A buffer or the device's memory was full, or a clock too fast: codes of `nidaqmx.error_codes.DAQmxErrors`."""


class DaqmxLink:
    """One NI device; `grpc_options` are those of `nidaqmx`, None for a device of this computer."""

    def __init__(self, address: str, *, name: str, timeout_s: float) -> None:
        self.address = parse_address(address)
        if self.address.scheme != "daqmx":
            raise UsageError(f"address {address!r}: expected daqmx://Dev1, or daqmx://HOST:PORT/Dev1, for an {name}")
        self.who, self.timeout_s = f"{name} at {self.address}", timeout_s
        self.grpc_options: Any = None
        self._channel: Any = None

    def open(self) -> None:
        """Connect; raises `UsageError` if a package is not installed, `LinkError` if no server answers."""
        try:
            import nidaqmx

            if not self.address.host:
                return
            import grpc
        except ImportError as err:
            raise UsageError(
                f"{self.who}: it needs NI's package nidaqmx, which is not installed: pip install 'benchctl[daqmx]'"
            ) from err
        target = f"{self.address.host}:{self.address.port}"
        self._channel = grpc.intercept_channel(grpc.insecure_channel(target), _timed(grpc, self.timeout_s))
        try:
            grpc.channel_ready_future(self._channel).result(timeout=self.timeout_s)
        except grpc.FutureTimeoutError as err:
            self.close()
            raise LinkError(
                f"{self.who}: no NI gRPC Device Server answers within {self.timeout_s:g} s; check that it runs there,"
                " its port and the firewall"
            ) from err
        self.grpc_options = nidaqmx.GrpcSessionOptions(self._channel, "")

    def close(self) -> None:
        """Close the connection; safe to call twice, and never raises."""
        self.grpc_options = None
        if self._channel is not None:
            self._channel.close()
            self._channel = None

    @contextmanager
    def doing(self, what: str) -> Iterator[None]:
        """Raise the errors of NI-DAQmx as those of `errors`, naming the device and the attempted action."""
        from nidaqmx import errors

        try:
            yield
        except errors.RpcError as err:
            raise LinkError(f"{self.who}: could not {what}: {_first_line(err)}; check that computer") from err
        except errors.DaqError as err:
            do = "check that no other program has it, its name, wiring and options"
            if err.error_code in OVERRUNS:
                do = "scans are lost: lower sample_rate_hz, or end other programs of that computer"
            raise InstrumentError(
                f"{self.who}: could not {what}: NI-DAQmx states {err.error_code}, {_first_line(err)}; {do}"
            ) from err
        except errors.Error as err:
            raise UsageError(
                f"{self.who}: {_first_line(err)}; install NI's driver NI-DAQmx on this computer (python -m nidaqmx"
                " installdriver, or ni.com/downloads), or state one that has it: daqmx://HOST:PORT/Dev1"
            ) from err


def _first_line(err: Exception) -> str:
    """Return NI's text up to its first full stop or line break."""
    return in_line(str(err).strip().splitlines()[0].partition(". ")[0])


def _timed(grpc: Any, timeout_s: float) -> Any:
    """Return an interceptor that limits the time of each call, which `nidaqmx` leaves unlimited."""

    class Timed(grpc.UnaryUnaryClientInterceptor):  # type: ignore[misc] # grpc is loaded where it is needed
        def intercept_unary_unary(self, continuation: Any, client_call_details: Any, request: Any) -> Any:
            return continuation(client_call_details._replace(timeout=timeout_s), request)

    return Timed()
