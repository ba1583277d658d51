"""A simulated Ensemble on the wire. It shares only the protocol with the driver."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

from instruments.errors import InstrumentError
from instruments.protocols.ensemble import END, Outcome, Reply, encode_reply
from instruments.protocols.lines import LineCutter
from instruments.simulated.aerotech_ensemble_controller import EnsembleController
from instruments.simulated.faults.link_faults import LinkFaults
from instruments.simulated.faults.wires import Lines, Wire
from instruments.simulated.machines import TableMachine
from instruments.simulated.tcp_server import TcpServer


class SimulatedEnsemble:
    """Serves a simulated table, axis 0, at `tcp://host:port`; several clients may talk to it at once.

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
        self._controller = EnsembleController(table)
        self._server = TcpServer(
            lambda: _Conversation(self._controller.execute, bare_lines), host=host, port=port, pace_baud=pace_baud
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
        """Press the emergency stop: the axis is disabled and in fault, until it is released and acknowledged."""
        self._controller.open_interlock()

    def close_interlock(self) -> None:
        """Release the emergency stop; the fault stays latched."""
        self._controller.close_interlock()

    def trip(self) -> None:
        """Disable the axis by a position error, which is latched."""
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
