"""Several units on one serial line: they take turns, and one that is silent closes the line for none of the others."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from threading import Lock

import pytest

from benchctl_instruments.errors import LinkError, UsageError
from benchctl_instruments.links.modbus import ModbusLink, Retry
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.protocols.modbus import RtuFraming
from benchctl_instruments.simulated.modbus_server import ModbusSession
from benchctl_instruments.simulated.serial_line import SerialLine
from tests.instruments.modbus_device import Memory

SILENT_UNIT = 3


class TwoUnits:
    """Units 1 and 2 on one line; unit 3 is switched off."""

    def __init__(self, memories: tuple[Memory, Memory]) -> None:
        self._sessions = [
            ModbusSession(RtuFraming(), memory, unit_id=unit_id, lock=Lock())
            for unit_id, memory in enumerate(memories, start=1)
        ]

    def feed(self, data: bytes) -> bytes:
        return b"".join(session.feed(data) for session in self._sessions)


@pytest.fixture
def memories() -> tuple[Memory, Memory]:
    return Memory(), Memory()


@pytest.fixture(params=[False, True], ids=["pty", "serial over tcp"])
def line(request: pytest.FixtureRequest, memories: tuple[Memory, Memory]) -> Iterator[SerialLine]:
    with SerialLine(lambda: TwoUnits(memories), over_tcp=request.param) as line:
        yield line


def link_to(line: SerialLine, unit_id: int, timeout_s: float = 0.3) -> ModbusLink:
    link = ModbusLink(line.address, unit_id=unit_id, timeout_s=timeout_s, retry=Retry(attempts=2, wait_s=0.01))
    link.open()
    return link


def test_two_units_answer_on_one_line(line: SerialLine, memories: tuple[Memory, Memory]) -> None:
    one, two = link_to(line, 1), link_to(line, 2)
    one.write(5, [111])
    two.write(5, [222])
    assert (one.read(5), two.read(5)) == ([111], [222])
    assert (memories[0].words[5], memories[1].words[5]) == (111, 222)
    one.close()
    assert two.read(5) == [222]
    two.close()


@pytest.mark.slow
def test_one_silent_unit_does_not_close_its_neighbours_line(line: SerialLine) -> None:
    one, two, silent = link_to(line, 1), link_to(line, 2), link_to(line, SILENT_UNIT, timeout_s=0.05)
    wrong: list[list[int]] = []
    over = threading.Event()

    def keep_reading(link: ModbusLink, register: int) -> None:
        while not over.is_set():
            if (words := link.read(register)) != [register]:
                wrong.append(words)

    readers = [threading.Thread(target=keep_reading, args=pair) for pair in ((one, 5), (two, 7))]
    for reader in readers:
        reader.start()
    for _ in range(3):
        with pytest.raises(LinkError, match=r"unit 3: reading register 1 came to nothing, tried 2 times: no answer"):
            silent.read(1)
    silent.close()
    time.sleep(0.05)
    over.set()
    for reader in readers:
        reader.join()
    assert wrong == []
    assert (one.read(5), two.read(7)) == ([5], [7])
    one.close()
    two.close()


def test_each_unit_has_its_own_time_out_and_its_own_log(line: SerialLine) -> None:
    log = WireLog()
    patient = ModbusLink(line.address, unit_id=1, timeout_s=5.0, wire_log=log)
    patient.open()
    hasty = link_to(line, SILENT_UNIT, timeout_s=0.05)
    before = len(log.last(100))
    started_s = time.monotonic()
    with pytest.raises(LinkError, match=r"no answer within 0\.05 s"):
        hasty.read(1)
    assert time.monotonic() - started_s < 2.0
    assert len(log.last(100)) == before
    assert patient.read(9) == [9]
    hasty.close()
    patient.close()


def test_units_on_one_line_talk_at_one_speed(line: SerialLine) -> None:
    if not line.address.startswith("serial:"):
        pytest.skip("a line over TCP has no speed in its address")
    link = link_to(line, 1)
    slower = ModbusLink(line.address.replace("19200", "9600"), unit_id=2)
    with pytest.raises(UsageError, match="9600 baud, but another unit on this line talks at 19200"):
        slower.open()
    assert link.read(5) == [5]
    link.close()
    slower.open()
    assert slower.read(5) == [5]
    slower.close()


def test_a_line_is_closed_with_its_last_link_and_can_be_opened_anew(line: SerialLine) -> None:
    for _ in range(2):
        one, two = link_to(line, 1), link_to(line, 2)
        one.close()
        two.close()
        two.close()
    link = link_to(line, 1)
    assert link.read(3) == [3]
    link.close()
