"""A simulated ACUTROL3000 on the wire. It shares only ACL with the driver."""

from __future__ import annotations

import itertools
from collections.abc import Callable

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.acl import Lines, encode_reply
from benchctl_instruments.simulated.acutrol3000_controller import AcutrolController
from benchctl_instruments.simulated.faults.wires import Lines as LinesWire
from benchctl_instruments.simulated.faults.wires import Wire
from benchctl_instruments.simulated.machines import TableMachine
from benchctl_instruments.simulated.table_server import TableServer
from benchctl_instruments.simulated.tcp_server import TcpServer


class SimulatedAcutrol3000(TableServer):
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
        controller = AcutrolController(table)
        server = TcpServer(lambda: _Conversation(controller.execute), host=host, port=port, pace_baud=pace_baud)
        super().__init__(controller, server)


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
