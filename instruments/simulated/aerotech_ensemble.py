"""A simulated Ensemble on the wire. It shares only the protocol with the driver."""

from __future__ import annotations

from collections.abc import Callable

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.ensemble import END, Outcome, Reply, encode_reply
from benchctl_instruments.protocols.lines import LineCutter
from benchctl_instruments.simulated.aerotech_ensemble_controller import EnsembleController
from benchctl_instruments.simulated.faults.wires import Lines, Wire
from benchctl_instruments.simulated.machines import TableMachine
from benchctl_instruments.simulated.table_server import TableServer
from benchctl_instruments.simulated.tcp_server import TcpServer


class SimulatedEnsemble(TableServer):
    """Serves a simulated table, axis X of three, at `tcp://host:port`; several clients may talk to it at once.

    Parameters
    ----------
    table
        The axis; its limits at this moment are those of the drive.
    host, port, pace_baud
        As of `TcpServer`.
    bare_lines
        Data come behind a bare `%` line, as was seen on real ones.
    """

    wire: Wire = Lines(refusal_line=encode_reply(Reply(outcome=Outcome.REFUSED)))

    def __init__(
        self,
        table: TableMachine,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        pace_baud: int | None = None,
        bare_lines: bool = False,
    ) -> None:
        controller = EnsembleController(table)
        server = TcpServer(
            lambda: _Conversation(controller.execute, bare_lines), host=host, port=port, pace_baud=pace_baud
        )
        super().__init__(controller, server)


class _Conversation:
    """One client's connection: lines in, lines out."""

    def __init__(self, execute: Callable[[str], Reply], bare_lines: bool) -> None:
        self._execute = execute
        self._bare_lines = bare_lines
        self._lines = LineCutter(END)

    def feed(self, data: bytes) -> bytes:
        try:
            lines = self._lines.feed(data)
        except InstrumentError:
            return encode_reply(Reply(outcome=Outcome.NOT_UNDERSTOOD))
        return b"".join(self._answer(self._execute(line)) for line in lines)

    def _answer(self, reply: Reply) -> bytes:
        bare = encode_reply(Reply(outcome=Outcome.DONE)) if self._bare_lines and reply.data else b""
        return bare + encode_reply(reply)


Twin = SimulatedEnsemble
