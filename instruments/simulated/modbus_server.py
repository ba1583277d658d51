"""Modbus servers over a register map: TCP for any number of clients, RTU on a line.

Written here and not taken from pymodbus, whose server answers for units that are not there and only the first of
several pipelined requests, so that a client's time-outs and queues could not be tried on it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from threading import Lock

from benchctl_instruments.protocols.modbus import (
    READS,
    ModbusRefusal,
    Request,
    RtuFraming,
    ServerFraming,
    TcpFraming,
)
from benchctl_instruments.simulated.faults.wires import MODBUS_RTU, MODBUS_TCP, Wire
from benchctl_instruments.simulated.registers import RegisterMap
from benchctl_instruments.simulated.serial_line import SerialLine
from benchctl_instruments.simulated.tcp_server import TcpServer

BROADCAST = 0


class ModbusSession:
    """One connection: bytes in, bytes out. Requests for other units are met with silence, as on a shared line.

    Parameters
    ----------
    framing
        TCP or RTU, new for each connection.
    registers
        What the unit keeps; used under `lock`, so that a request is never carried out in the middle of another one.
    unit_id
        The unit; None answers whatever unit is asked for, as devices with a network socket of their own do.
    broadcasts
        Whether unit 0 means every unit: writes are then carried out and not answered.
    ignores
        The writes that the unit acknowledges and does not carry out.
    functions
        Functions of the unit's own, by code: from the data of a request to that of its reply.
    """

    def __init__(
        self,
        framing: ServerFraming,
        registers: RegisterMap,
        *,
        unit_id: int | None,
        lock: Lock,
        broadcasts: bool = False,
        ignores: Callable[[Request], bool] = lambda _: False,
        functions: Mapping[int, Callable[[bytes], bytes]] | None = None,
    ) -> None:
        self._functions = functions or {}
        self._framing = framing
        self._registers = registers
        self._unit_id = unit_id
        self._lock = lock
        self._broadcasts = broadcasts
        self._ignores = ignores

    def feed(self, data: bytes) -> bytes:
        """Take bytes as they come; the replies to what is complete with them, in order."""
        return b"".join(self._answer(request) for request in self._framing.feed(data))

    def _answer(self, request: Request) -> bytes:
        if self._broadcasts and request.unit == BROADCAST:
            if request.function not in READS:
                self._carry_out(request)
            return b""
        if self._unit_id not in (None, request.unit):
            return b""
        return self._carry_out(request)

    def _carry_out(self, request: Request) -> bytes:
        own = self._functions.get(request.function)
        if request.fault and own is None:
            return self._framing.refuse(request, request.fault)
        try:
            with self._lock:
                if own is not None:
                    return self._framing.reply(request, own(request.data))
                if request.function in READS:
                    return self._framing.reply(request, self._registers.read(request.address, request.count))
                if not self._ignores(request):
                    self._registers.write(request.address, list(request.values))
        except ModbusRefusal as refusal:
            return self._framing.refuse(request, refusal.code)
        return self._framing.reply(request)


class ModbusTcpServer(TcpServer):
    """Modbus TCP at `address` ("tcp://127.0.0.1:PORT"), from `start()` to `stop()`, or in a `with`.

    Parameters
    ----------
    registers
        What it serves.
    unit_id
        The unit that answers; None: whatever unit is asked for.
    host, port
        Where; port 0 takes a free one.
    pace_baud
        Bytes leave as a line at this speed would let them; None: at once.
    functions
        See `ModbusSession`.
    """

    wire: Wire = MODBUS_TCP

    def __init__(
        self,
        registers: RegisterMap,
        *,
        unit_id: int | None,
        host: str = "127.0.0.1",
        port: int = 0,
        pace_baud: int | None = None,
        functions: Mapping[int, Callable[[bytes], bytes]] | None = None,
    ) -> None:
        lock = Lock()
        super().__init__(
            lambda: ModbusSession(TcpFraming(), registers, unit_id=unit_id, lock=lock, functions=functions),
            host=host,
            port=port,
            pace_baud=pace_baud,
        )


class ModbusRtuServer(SerialLine):
    """Modbus RTU on a simulated serial line; see `SerialLine` for its address and the settings it shares.

    Parameters
    ----------
    registers
        What it serves.
    unit_id
        The unit that answers; unit 0 is carried out and not answered.
    ignores
        See `ModbusSession`.
    """

    wire: Wire = MODBUS_RTU

    def __init__(
        self,
        registers: RegisterMap,
        *,
        unit_id: int,
        baud: int = 19200,
        pace_baud: int | None = None,
        over_tcp: bool = False,
        ignores: Callable[[Request], bool] = lambda _: False,
    ) -> None:
        lock = Lock()
        super().__init__(
            lambda: ModbusSession(
                RtuFraming(), registers, unit_id=unit_id, lock=lock, broadcasts=True, ignores=ignores
            ),
            baud=baud,
            pace_baud=pace_baud,
            over_tcp=over_tcp,
        )
