"""A controller on GPIB, in the place of a VISA resource: it answers only queries, and a device clear drops answers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import pyvisa
from pyvisa.constants import StatusCode
from pyvisa.errors import VisaIOError
from pyvisa.resources import MessageBasedResource


class GpibController(MessageBasedResource):
    """What a driver's link needs of a PyVISA resource.

    `answer` returns the answer to a line; `wire` lists what happened: "> …", "< …" and "clear". `fails` are errors of
    the next reads, of which None is a read without an error.
    """

    timeout = 0
    read_termination = None

    def __init__(self, answer: Callable[[str], str | None]) -> None:
        self.answer = answer
        self.wire: list[str] = []
        self.fails: list[StatusCode | None] = []
        self.opened: list[str] = []
        self._waiting: list[bytes] = []

    def write_raw(self, message: bytes) -> int:
        assert message.endswith(b"\r\n")
        line = message.decode("ascii").removesuffix("\r\n")
        self.wire.append(f"> {line}")
        if (answer := self.answer(line)) is not None:
            self._waiting.append(f"{answer}\n".encode())
        return len(message)

    def read_raw(self, size: int | None = None) -> bytes:
        if (fails := self.fails.pop(0) if self.fails else None) is not None:
            raise VisaIOError(fails)
        if not self._waiting:
            raise VisaIOError(StatusCode.error_timeout)
        message = self._waiting.pop(0)
        self.wire.append(f"< {message.decode().removesuffix(chr(10))}")
        return message

    def clear(self) -> None:
        self.wire.append("clear")
        self._waiting.clear()

    def close(self) -> None:
        """The controller keeps what it wanted to say."""

    def __del__(self) -> None:
        """No session was opened."""


def on_gpib(monkeypatch: pytest.MonkeyPatch, answer: Callable[[str], str | None]) -> GpibController:
    """Return a controller that is every resource of this computer's VISA."""
    controller = GpibController(answer)

    class Manager:
        def open_resource(self, name: str, **_: Any) -> GpibController:
            controller.opened.append(name)
            return controller

    monkeypatch.setattr(pyvisa, "ResourceManager", Manager)
    return controller
