"""The pseudo-terminal that stands for a serial line; only where the system has any."""

from __future__ import annotations

import os
import sys
import time

import pytest

if sys.platform == "win32":
    pytest.skip("Windows has no pseudo-terminals", allow_module_level=True)

from benchctl_instruments.simulated.serial_line import PtyLine


class Flood:
    """Answers every byte with a thousand."""

    def feed(self, data: bytes) -> bytes:
        return bytes(1000 * len(data))


class Echo:
    """Says what it hears."""

    def feed(self, data: bytes) -> bytes:
        return data


def test_every_byte_passes_unchanged_in_both_directions() -> None:
    line = PtyLine(Echo(), pace_baud=None)
    line.start()
    port = os.open(line.port, os.O_RDWR | os.O_NOCTTY)
    try:
        everything = bytes(range(256))
        os.write(port, everything)
        heard = b""
        while len(heard) < len(everything):
            heard += os.read(port, 256)
    finally:
        os.close(port)
        line.stop()
    assert heard == everything


def test_what_nobody_reads_is_dropped_and_counted_and_does_not_block_the_device() -> None:
    line = PtyLine(Flood(), pace_baud=None)
    line.start()
    port = os.open(line.port, os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(port, bytes(60))
        deadline_s = time.monotonic() + 5
        while line.dropped_bytes == 0 and time.monotonic() < deadline_s:
            time.sleep(0.01)
    finally:
        line.stop()
        os.close(port)
    assert 0 < line.dropped_bytes < 60_000
