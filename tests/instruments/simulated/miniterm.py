"""pyserial's terminal program as somebody sits before it: a process of its own, typed into, its screen read."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import termios
import time
from typing import Self

PATIENCE_S = 40.0  # a busy machine takes its time to start a process
LEAVE = "\x1d"  # Ctrl+]
GREETING_LINES = 2
LOCAL_MODES = 3  # their place in what `termios.tcgetattr` gives


class Miniterm:
    """`python -m serial.tools.miniterm PORT BAUD` in a `with`; on entry it has said that it is connected."""

    def __init__(self, port: str, *, baud: int) -> None:
        self._command = [sys.executable, "-m", "serial.tools.miniterm", port, str(baud)]
        self._unread = b""

    def __enter__(self) -> Self:
        self._screen, keyboard = os.openpty()
        self._process = subprocess.Popen(
            self._command, stdin=keyboard, stdout=keyboard, stderr=keyboard, start_new_session=True
        )
        os.close(keyboard)
        for _ in range(GREETING_LINES):
            self.next_line()
        self._wait_for_keyboard()
        return self

    def __exit__(self, *exc: object) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._screen)

    def _wait_for_keyboard(self) -> None:
        """Until it has taken the keyboard over: what is typed before is echoed by the system."""
        give_up_s = time.monotonic() + PATIENCE_S
        while termios.tcgetattr(self._screen)[LOCAL_MODES] & termios.ECHO:
            assert time.monotonic() < give_up_s, "it never took the keyboard over"
            time.sleep(0.01)

    def type(self, text: str) -> None:
        """Type; "\\r" is the Return key."""
        os.write(self._screen, text.encode("ascii"))

    def next_line(self) -> str:
        """The next line that appears on the screen."""
        give_up_s = time.monotonic() + PATIENCE_S
        while b"\n" not in self._unread:
            ready, _, _ = select.select([self._screen], [], [], max(0.0, give_up_s - time.monotonic()))
            assert ready, f"no further line appeared on the screen, only {self._unread!r}"
            self._unread += os.read(self._screen, 4096)
        line, _, self._unread = self._unread.partition(b"\n")
        return line.decode("ascii", "backslashreplace").strip()

    def leave(self) -> int:
        """Leave it as its greeting says; its exit status."""
        self.type(LEAVE)
        return self._process.wait(PATIENCE_S)
