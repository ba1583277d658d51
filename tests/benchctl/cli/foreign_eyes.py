"""The simulated bench as somebody else sees it: raw bytes and a foreign Modbus client, nothing of ours."""

from __future__ import annotations

import socket
import subprocess
import time
from typing import Self
from urllib.parse import urlsplit

import pytest
from pymodbus.client import ModbusTcpClient

F4T_SET_POINT = 2782


class ForeignEyes:
    """Asks the simulated instruments over connections of its own, with nothing of ours but the addresses."""

    def __init__(self, addresses: dict[str, str]) -> None:
        table, chamber = urlsplit(addresses["rate_table"]), urlsplit(addresses["chamber"])
        self._table = socket.create_connection((table.hostname, table.port), timeout=5)
        self._replies = self._table.makefile("rb")
        self._chamber = ModbusTcpClient(str(chamber.hostname), port=int(chamber.port or 0))
        self._chamber.connect()

    def rate_dps(self) -> float:
        self._table.sendall(b":read:rate? 1\r\n")
        return float(self._replies.readline()[8:])

    def chamber_setpoint_c(self) -> float:
        registers = self._chamber.read_holding_registers(F4T_SET_POINT, count=2, device_id=1).registers
        return float(
            self._chamber.convert_from_registers(registers, self._chamber.DATATYPE.FLOAT32, word_order="little")
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._replies.close()
        self._table.close()
        self._chamber.close()

    def wait_for_swing(self, runner: subprocess.Popen[str], timeout_s: float = 30.0) -> None:
        """Until the table turns at 100 deg/s, which the runner has told it to."""
        deadline_s = time.monotonic() + timeout_s
        while abs(self.rate_dps()) < 100.0:
            assert runner.poll() is None, runner.communicate()
            assert time.monotonic() < deadline_s, "the table never swung"
            time.sleep(0.02)

    def wait_for_chamber(self, beyond_c: float, runner: subprocess.Popen[str], timeout_s: float = 30.0) -> None:
        """Until the chamber is set to more than `beyond_c`."""
        deadline_s = time.monotonic() + timeout_s
        while self.chamber_setpoint_c() <= beyond_c:
            assert runner.poll() is None, runner.communicate()
            assert time.monotonic() < deadline_s, "the chamber was never sent anywhere"
            time.sleep(0.02)

    def wait_for_rest(self, safe_c: float, timeout_s: float) -> float:
        """Until the table rests and the chamber is set to `safe_c`; returns the seconds that it took."""
        began_s = time.monotonic()
        while abs(self.rate_dps()) > 0.05 or self.chamber_setpoint_c() != pytest.approx(safe_c):
            assert time.monotonic() - began_s < timeout_s, "the bench did not come to rest"
            time.sleep(0.02)
        return time.monotonic() - began_s
