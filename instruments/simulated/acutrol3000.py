"""A simulated ACUTROL3000 on the wire. It shares only ACL with the driver."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Self

from instruments.errors import InstrumentError
from instruments.protocols.acl import Lines, encode_reply
from instruments.simulated.acutrol3000_controller import AcutrolController
from instruments.simulated.faults.link_faults import LinkFaults
from instruments.simulated.faults.wires import Lines as LinesWire
from instruments.simulated.faults.wires import Wire
from instruments.simulated.machines import TableMachine
from instruments.simulated.tcp_server import TcpServer


class SimulatedAcutrol3000:
    """Serves a simulated table, axis 1, at `tcp://host:port`; several clients may talk to it at once.

    Parameters
    ----------
    table
        The axis; its limits at this moment are the factory's limits.
    host, port, pace_baud
        As of `TcpServer`.
    """

    wire: Wire = LinesWire(refusal_line=encode_reply("00000000", "ERROR not now"))

    def __init__(
        self, table: TableMachine, *, host: str = "127.0.0.1", port: int = 0, pace_baud: int | None = None
    ) -> None:
        self._controller = AcutrolController(table)
        self._server = TcpServer(
            lambda: _Conversation(self._controller.execute), host=host, port=port, pace_baud=pace_baud
        )

    @property
    def address(self) -> str:
        """Where it answers."""
        return self._server.address

    @property
    def faults(self) -> LinkFaults | None:
        """What befalls the requests; to be set before the start."""
        return self._server.faults

    @faults.setter
    def faults(self, faults: LinkFaults | None) -> None:
        self._server.faults = faults

    def start(self) -> None:
        """Serve; when it returns, a client can connect."""
        self._server.start()

    def stop(self) -> None:
        """Stop serving; the table goes on with what it was doing."""
        self._server.stop()

    def cut_connections(self) -> None:
        """Pull the cable for a moment."""
        self._server.cut_connections()

    def open_interlock(self) -> None:
        """Open the interlock by hand, as an emergency stop does: un-servoed and in fault, until closed and reset."""
        self._controller.open_interlock()

    def close_interlock(self) -> None:
        """Close the interlock by hand; the fault stays latched."""
        self._controller.close_interlock()

    def trip(self) -> None:
        """Lead to Abort, as a following error does: un-servoed and in fault, until reset."""
        self._controller.trip()

    def restart(self) -> None:
        """Start anew, as after a power failure."""
        self._controller.restart()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.stop()


class _Conversation:
    """One client's connection: lines in, lines out, each reply under a header of its own."""

    def __init__(self, execute: Callable[[str], str]) -> None:
        self._execute = execute
        self._lines = Lines()
        self._count = itertools.count(1)

    def feed(self, data: bytes) -> bytes:
        try:
            lines = self._lines.feed(data)
        except InstrumentError as err:
            return self._reply(f"ERROR {err}")
        return b"".join(self._reply(self._execute(line)) for line in lines)

    def _reply(self, data: str) -> bytes:
        return encode_reply(f"{next(self._count) % 10**8:08d}", data)


Twin = SimulatedAcutrol3000
