"""The driver against whatever else may answer at its address: nothing, something else, or a controller that lies."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import pytest

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Identity, TableLimits, TableState
from benchctl_instruments.links.tcp import LinkCutError, Reconnect
from benchctl_instruments.protocols.acl import encode_reply
from benchctl_instruments.protocols.lines import LineCutter
from benchctl_instruments.rate_tables.acutrol3000 import Acutrol3000
from benchctl_instruments.simulated.tcp_server import TcpServer
from tests.instruments.table_machine import CountedClock

GOOD = {
    ":mode? 1": "Rate",
    ":interlock? 1": "Closed",
    "*stb?": "0",
    ":dem:rate? 1": "10.000000",
    ":read:pos? 1;rate? 1;acc? 1": "0;10.0;0",
}


class Scripted:
    """Answers queries from a table, and everything else with OK."""

    def __init__(self, **answers: str) -> None:
        self.lines = LineCutter()
        self.answers = GOOD | answers
        self.heard: list[str] = []

    def feed(self, data: bytes) -> bytes:
        lines = self.lines.feed(data)
        self.heard += lines
        return b"".join(encode_reply("????????", self.answers.get(line, "OK")) for line in lines)


class Raw:
    """Answers every packet with the same bytes."""

    def __init__(self, answer: bytes) -> None:
        self.answer = answer

    def feed(self, data: bytes) -> bytes:
        return self.answer


def connected(server: TcpServer, timeout_s: float = 1.0) -> Acutrol3000:
    return Acutrol3000(
        server.address, clock=CountedClock(), timeout_s=timeout_s, reconnect=Reconnect(attempts=2, wait_s=0.01)
    )


def scripted(**answers: str) -> TcpServer:
    conversation = Scripted(**answers)
    return TcpServer(lambda: conversation)


def test_a_silent_address_is_named_with_what_was_asked_and_how_long_was_waited() -> None:
    with TcpServer(lambda: Raw(b"")) as server:
        started_s = time.monotonic()
        with pytest.raises(LinkError) as caught:
            connected(server, timeout_s=0.1).open()
        assert time.monotonic() - started_s < 0.5
    message = str(caught.value)
    assert f"rate table at {server.address}: sent ':mode? 1', no answer within 0.1 s" in message
    assert "check that" in message
    assert r"> b':mode? 1\r\n'" in message
    assert "\n" not in message


def test_a_reply_without_its_end_is_shown_when_the_time_is_over() -> None:
    with TcpServer(lambda: Raw(b"00000001Ra")) as server, pytest.raises(LinkError, match=r"< b'00000001Ra'"):
        connected(server, timeout_s=1.0).open()


def test_where_nobody_listens_the_table_and_its_address_are_named() -> None:
    with TcpServer(lambda: Raw(b"")) as server:
        address = server.address
    with pytest.raises(LinkError, match=rf"rate table at {address}: .*could not connect in 2 attempts"):
        connected(server).open()


@pytest.mark.parametrize(
    "banner",
    [
        b"HTTP/1.1 400 Bad Request\r\n\r\n",
        b"SSH-2.0-OpenSSH_9.6\r\n",
        b"NA:CMD ERR\r\n",
        b"login\r\n",
        b"\x00" * 5000,
        b"00000001ERROR unknown command\r\n",
    ],
)
def test_another_instrument_at_the_address_is_an_instrument_error(banner: bytes) -> None:
    with TcpServer(lambda: Raw(banner)) as server:
        driver = connected(server)
        with pytest.raises(
            InstrumentError, match=rf"{server.address}.*check that (the address is an ACUTROL|it is the right)"
        ):
            driver.open()
        with pytest.raises(UsageError, match="open"):
            driver.read()


def test_a_late_reply_never_answers_the_next_question() -> None:
    class Late(Scripted):
        def feed(self, data: bytes) -> bytes:
            if data.startswith(b":read"):
                time.sleep(0.3)
            return super().feed(data)

    with TcpServer(Late) as server, connected(server, timeout_s=0.1) as driver:
        with pytest.raises(LinkError, match=r"no answer within 0\.1 s"):
            driver.read()
        time.sleep(0.4)
        assert driver.identify() == Identity()


def test_what_is_cut_off_is_said_again_but_not_a_command_that_changes_things_by_some_amount() -> None:
    heard: list[str] = []
    cut: set[str] = set()

    class CutOnce(Scripted):
        def feed(self, data: bytes) -> bytes:
            line = data.decode().strip()
            heard.append(line)
            if line.startswith((":read", ":dem:rate 1", ":dem:delta", ":interlock:reset")) and line not in cut:
                cut.add(line)
                raise ConnectionResetError
            return super().feed(data)

    with TcpServer(CutOnce) as server, connected(server) as driver:
        assert driver.read().rate_dps == 10.0
        driver.go_to_rate(10.0)
        assert heard.count(":read:pos? 1;rate? 1;acc? 1") == 2
        assert heard.count(":dem:rate 1,10.000000") == 2
        with pytest.raises(LinkCutError, match=r"sent ':interlock:reset', and the link broke"):
            driver.enable()
        assert heard.count(":interlock:reset") == 1


@pytest.mark.parametrize(
    ("answers", "act", "complaint"),
    [
        ({":dem:rate? 1": "9.0"}, lambda d: d.go_to_rate(10.0), r"rate demand \[deg/s\] should be 10, .* reads back 9"),
        ({":dem:rate? 1": "fast"}, lambda d: d.go_to_rate(10.0), "expected a number, got 'fast'"),
        ({":dem:rate 1,10.000000": "?"}, lambda d: d.go_to_rate(10.0), r"expected OK, got '\?'; no fault is reported"),
        ({":interlock? 1": "Fault"}, lambda d: d.go_to_rate(10.0), "RATE mode was asked for: interlock Fault"),
        (
            {":lim:rate? pos,1": "200"},
            lambda d: d.set_limits(TableLimits(rate_dps=100, acceleration_dps2=50)),
            "back 200",
        ),
        ({":read:pos? 1;rate? 1;acc? 1": "1;2"}, lambda d: d.read(), "expected 3 numbers parted by ';', got '1;2'"),
        ({":read:pos? 1;rate? 1;acc? 1": "1;nan;3"}, lambda d: d.read(), "got '1;nan;3'"),
        ({":read:pos? 1;rate? 1;acc? 1": "1;1_0;3"}, lambda d: d.read(), "got '1;1_0;3'"),
        ({":read:pos? 1;rate? 1;acc? 1": "1;2;" + "3" * 3000}, lambda d: d.read(), "got '1;2;3{60}';"),
        ({":con:osc 1,Enable,0.795775,0.500000,Pos,Lin": "no"}, lambda d: d.oscillate(10.0, 1.0), "got 'no'"),
        ({":dem:osc? 1": "1.591549,2,0"}, lambda d: d.oscillate(10.0, 1.0), "should be 1.59155, 1, 0"),
        ({":dem:pos? 1": "180"}, lambda d: d.go_to_angle(90.0), "angle demand"),
    ],
)
def test_an_acknowledgement_is_not_believed(
    answers: dict[str, str], act: Callable[[Acutrol3000], object], complaint: str
) -> None:
    with scripted(**answers) as server, connected(server) as driver:
        with pytest.raises(InstrumentError, match=complaint) as caught:
            act(driver)
        assert str(caught.value).startswith(f"rate table at {server.address}: ")


def test_a_mode_that_was_acknowledged_and_not_entered_is_an_error() -> None:
    answers = {":dem:osc? 1": "1.591549,1.0,0.0"}
    complaint = r"SYNTHESIZER mode was asked for and acknowledged, .* in RATE mode"
    with (
        scripted(**answers) as server,
        connected(server) as driver,
        pytest.raises(InstrumentError, match=complaint),
    ):
        driver.oscillate(10.0, 1.0)


@pytest.mark.parametrize(
    ("interlock", "mode", "state"),
    [
        ("Fault", "Rate", TableState.FAULT),
        ("FAULT", "Off", TableState.FAULT),
        ("Closed", "Abort", TableState.FAULT),
        ("Open", "Rate", TableState.DISABLED),
        ("Closed", "Off", TableState.DISABLED),
        ("Closed", "Rate", TableState.MOVING),
        ("1", "Position", TableState.MOVING),
        ("Closed", "Absolute Rate", TableState.MOVING),
        ("Closed", "Relative", TableState.MOVING),
        ("Closed", "Synthesis", TableState.MOVING),
    ],
)
def test_the_state_follows_from_interlock_mode_and_rate(interlock: str, mode: str, state: TableState) -> None:
    with scripted(**{":interlock? 1": interlock, ":mode? 1": mode}) as server, connected(server) as driver:
        assert driver.state() is state


def test_a_table_that_turns_slower_than_its_threshold_is_at_rest() -> None:
    with scripted(**{":read:pos? 1;rate? 1;acc? 1": "359.99; -0.04 ;0.1"}) as server, connected(server) as driver:
        assert driver.state() is TableState.AT_REST


def test_angles_are_read_within_one_turn() -> None:
    with scripted(**{":read:pos? 1;rate? 1;acc? 1": "-10.5;0;0"}) as server, connected(server) as driver:
        assert driver.read().angle_deg == pytest.approx(349.5)


def test_a_controller_that_does_not_introduce_itself_remains_unknown() -> None:
    with scripted(**{"*idn?": "ERROR"}) as server, connected(server) as driver:
        assert driver.identify() == Identity()


def test_closing_waits_for_the_exchange_that_is_under_way() -> None:
    asked = threading.Event()

    class Slow(Scripted):
        def feed(self, data: bytes) -> bytes:
            if data.startswith(b":read"):
                asked.set()
                time.sleep(0.2)
            return super().feed(data)

    rates_dps: list[float] = []
    with TcpServer(Slow) as server, connected(server) as driver:
        asking = threading.Thread(target=lambda: rates_dps.append(driver.read().rate_dps))
        asking.start()
        asked.wait(5.0)
        driver.close()
        asking.join()
    assert rates_dps == [10.0]
