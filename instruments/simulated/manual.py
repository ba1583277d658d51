"""A simulated manual table: its knob is a TCP server, for an operator at `benchctl sim`.

The driver has no wire; the operator's program, such as `nc HOST PORT`, sends lines instead: a rate [deg/s], positive
counter-clockwise from above, or 0. The answer to each is the rate that the table goes to.
"""

from __future__ import annotations

import math

from benchctl_instruments.simulated.machines import TableMachine
from benchctl_instruments.simulated.tcp_server import TcpServer

_LONGEST_LINE = 100


class SimulatedManualTable(TcpServer):
    """Serves the knob of a table at `tcp://host:port`."""

    def __init__(self, table: TableMachine) -> None:
        super().__init__(lambda: _Knob(table))


class _Knob:
    """A `Conversation`."""

    def __init__(self, table: TableMachine) -> None:
        self._table, self._rest = table, b""

    def feed(self, data: bytes) -> bytes:
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest[:_LONGEST_LINE]
        return b"".join(self._set(line) for line in lines)

    def _set(self, line: bytes) -> bytes:
        try:
            rate_dps = float(line)
        except ValueError:
            rate_dps = math.nan
        if not math.isfinite(rate_dps):
            return b"expected a rate in deg/s, such as +20\n"
        turn_by_hand(self._table, rate_dps)
        return f"{rate_dps:+g} deg/s\n".encode()


def turn_by_hand(table: TableMachine, rate_dps: float) -> None:
    """Turn a simulated table at a rate [deg/s], or stop it (0)."""
    table.close_loop()
    table.demand_rate(rate_dps)


Twin = SimulatedManualTable
