"""The driver against whatever else may answer at its address: nothing, something else, or a controller that lies."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import TableLimits, TableState
from benchctl_instruments.links.tcp import LinkCutError, Reconnect
from benchctl_instruments.protocols.lines import LineCutter
from benchctl_instruments.rate_tables.newport_esp301 import Esp301
from benchctl_instruments.simulated.newport_esp301 import SimulatedEsp301
from benchctl_instruments.simulated.serial_line import SerialLine
from benchctl_instruments.simulated.tcp_server import TcpServer
from tests.instruments.table_machine import CountedClock, InstantTable

LIMITS = TableLimits(rate_dps=300.0, acceleration_dps2=500.0)
GOOD = {
    "VE?": "ESP301 Version 3.0.1",
    "1SN?": "7",
    "TE?": "0",
    "1MO?": "1",
    "1MD?": "1",
    "1TP?": "0",
    "1TV?": "0",
    "1VA?": "10",
    "1AC?": "500",
    "1AG?": "500",
}


class Scripted:
    """Answers queries from a table, and errors of `TE?` from a list as long as there are some."""

    def __init__(self, **answers: str) -> None:
        self.lines = LineCutter(b"\r")
        self.answers = GOOD | answers
        self.errors: list[str] = []
        self.heard: list[str] = []

    def feed(self, data: bytes) -> bytes:
        lines = self.lines.feed(data)
        self.heard += lines
        answers = (self.errors.pop(0) if line == "TE?" and self.errors else self.answers.get(line) for line in lines)
        return b"".join(answer.encode() + b"\r\n" for answer in answers if answer is not None)


class Raw:
    """Answers every packet with the same bytes."""

    def __init__(self, answer: bytes) -> None:
        self.answer = answer

    def feed(self, data: bytes) -> bytes:
        return self.answer


def connected(address: str, timeout_s: float = 1.0) -> Esp301:
    return Esp301(address, clock=CountedClock(), timeout_s=timeout_s, reconnect=Reconnect(attempts=2, wait_s=0.01))


@pytest.fixture
def scripted() -> Scripted:
    return Scripted()


@pytest.mark.parametrize("over_tcp", [False, True])
def test_a_silent_address_is_named_with_what_was_asked_and_how_long_was_waited(over_tcp: bool) -> None:
    with SerialLine(lambda: Raw(b""), over_tcp=over_tcp) as line, pytest.raises(LinkError) as caught:
        connected(line.address, timeout_s=0.1).open()
    message = str(caught.value)
    assert f"rate table at {line.address}: sent 'VE?', no answer within 0.1 s" in message
    assert "check power, cable, speed" in message
    assert "\n" not in message


def test_a_port_that_is_not_there_is_named() -> None:
    with pytest.raises(LinkError, match=r"rate table at serial:///dev/nowhere: .*cannot be opened"):
        connected("serial:///dev/nowhere").open()


@pytest.mark.parametrize("banner", [b"HTTP/1.1 400 Bad Request\r\n", b"%\r\n", b"00000001Rate\r\n", b"\xffNA:\r\n"])
def test_another_instrument_at_the_address_is_an_instrument_error(banner: bytes) -> None:
    with TcpServer(lambda: Raw(banner)) as server:
        driver = connected(server.address)
        with pytest.raises(InstrumentError, match=rf"{server.address}.*check that the address is an ESP301's") as err:
            driver.open()
        assert "\n" not in str(err.value)
        with pytest.raises(UsageError, match="open"):
            driver.read()


def test_what_never_ends_a_line_is_not_an_esp301() -> None:
    with (
        TcpServer(lambda: Raw(b"x" * 5000)) as server,
        pytest.raises(InstrumentError, match="without an end of line"),
    ):
        connected(server.address).open()


@pytest.mark.parametrize(
    ("axis", "reported"), [(2, r"208 \(axis 2: motor or stage not connected\)"), (5, r"9 \(no such axis\)")]
)
def test_an_axis_that_is_not_there_is_named_although_it_is_never_answered_for(axis: int, reported: str) -> None:
    with (
        SimulatedEsp301(InstantTable(), over_tcp=True) as server,
        pytest.raises(InstrumentError, match=rf"checked axis {axis}, it reports {reported}.*; check the axis"),
    ):
        Esp301(server.address, clock=CountedClock(), axis=axis, timeout_s=0.3).open()


def test_an_axis_that_does_not_count_in_degrees_is_refused(scripted: Scripted) -> None:
    scripted.answers["1SN?"] = "2"
    with (
        TcpServer(lambda: scripted) as server,
        pytest.raises(InstrumentError, match="counts in units 2, expected 7, degrees"),
    ):
        connected(server.address).open()


@pytest.mark.parametrize("unasked", ["E38", "E35 HARDWARE LIMIT"])
def test_an_error_said_unasked_before_an_answer_is_survived(scripted: Scripted, unasked: str) -> None:
    scripted.answers |= {"1MD?": f"{unasked}\r\n1", "1TV?": f"{unasked}\r\n2.5"}
    with TcpServer(lambda: scripted) as server, connected(server.address) as driver:
        assert driver.read().rate_dps == 2.5
        assert driver.state() is TableState.MOVING


def test_a_query_that_is_cut_off_is_asked_again_and_a_command_is_not() -> None:
    heard: list[str] = []
    cut: set[str] = set()

    class CutOnce(Scripted):
        def feed(self, data: bytes) -> bytes:
            lines = data.decode().split()  # a packet may hold several
            heard.extend(lines)
            if to_cut := [line for line in lines if line in ("1TV?", "1MV+") and line not in cut]:
                cut.update(to_cut)
                raise ConnectionResetError
            return super().feed(data)

    conversation = CutOnce(**{"1MD?": "1"})
    with TcpServer(lambda: conversation) as server, connected(server.address) as driver:
        driver.set_limits(LIMITS)
        assert driver.read().rate_dps == 0.0
        assert heard.count("1TV?") == 2
        conversation.answers["1MD?"] = "1"
        with pytest.raises(InstrumentError, match="come to rest by itself without an error"):
            driver.go_to_rate(10.0)  # nobody answers a command, so that its loss shows in what follows
    assert heard.count("1MV+") == 1


def test_a_late_answer_never_answers_the_next_question() -> None:
    asked = 0

    class Late(Scripted):
        def feed(self, data: bytes) -> bytes:
            nonlocal asked
            if data == b"1TV?\r":
                asked += 1
                if asked <= 2:
                    time.sleep(0.4)
                    return b"77\r\n"
            return super().feed(data)

    with TcpServer(Late) as server, connected(server.address, timeout_s=0.2) as driver:
        with pytest.raises(LinkError, match=r"sent '1TV\?', no answer within 0.2 s"):
            driver.read()
        time.sleep(0.4)
        assert driver.read().rate_dps == 0.0


def test_a_link_that_is_cut_for_good_is_a_link_error() -> None:
    class Mortal(Scripted):
        def feed(self, data: bytes) -> bytes:
            if data == b"1TP?\r":
                raise ConnectionResetError
            return super().feed(data)

    with TcpServer(Mortal) as server, connected(server.address) as driver:
        with pytest.raises(LinkCutError, match=r"sent '1TP\?', and the link broke"):
            driver.read()
        assert driver.state() is TableState.AT_REST


Act = Callable[[Esp301], object]


@pytest.mark.parametrize(
    ("answers", "act", "complaint"),
    [
        ({"1VA?": "9"}, lambda d: d.go_to_rate(10.0), "1VA should be 10, it was not refused and reads back 9"),
        ({"1VA?": "fast"}, lambda d: d.go_to_rate(10.0), r"sent '1VA\?', expected a number, got 'fast'"),
        ({"1AC?": "9"}, lambda d: d.set_limits(LIMITS), "1AC should be 500.*reads back 9"),
        ({"1MO?": "0"}, lambda d: d.enable(), "enabling was commanded, and its motor is off"),
        ({"1MO?": "yes"}, lambda d: d.state(), r"sent '1MO\?', expected 0 or 1, got 'yes'"),
        ({"TE?": "none"}, lambda d: d.stop(), "expected the code of an error, 0 to 999, got 'none'"),
        ({"TE?": "6"}, lambda d: d.state(), "queue of errors does not come to an end"),
        ({"1TV?": "nan"}, lambda d: d.read(), "expected a number, got 'nan'"),
        ({"1TV?": "1_0"}, lambda d: d.read(), "expected a number, got '1_0'"),
        ({"1TV?": "9" * 4000}, lambda d: d.read(), "expected a number, got '9{64}';"),
        ({"1MD?": "1"}, lambda d: d.go_to_rate(10.0), "in fault: it turned, and has come to rest by itself"),
        ({}, lambda d: d.go_to_angle(5.0), "1VA should be 300"),
        ({"1VA?": "300"}, lambda d: d.go_to_angle(5.0), "commanded and not refused, but the table rests at 0"),
        (
            {"1MD?": "0"},
            lambda d: d.go_to_rate(10.0),
            "a stop before its next motion was commanded, and it still",
        ),
        ({}, lambda d: d.disable(), "its motor was commanded off, and is still on"),
    ],
)
def test_silence_is_not_taken_for_obedience(
    scripted: Scripted, answers: dict[str, str], act: Act, complaint: str
) -> None:
    with TcpServer(lambda: scripted) as server, connected(server.address) as driver:
        driver.set_limits(LIMITS)
        scripted.answers |= answers
        with pytest.raises(InstrumentError, match=complaint) as caught:
            act(driver)
        assert str(caught.value).startswith(f"rate table at {server.address}: ")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("on", "done", "rate", "errors", "state"),
    [
        ("1", "1", "0.04", [], TableState.AT_REST),
        ("1", "1", "-0.06", [], TableState.MOVING),
        ("1", "0", "0", [], TableState.MOVING),
        ("0", "1", "0", [], TableState.DISABLED),
        ("0", "1", "0", ["113"], TableState.DISABLED),
        ("1", "1", "0", ["6", "7", "113"], TableState.AT_REST),
        ("1", "0", "20", ["6", "103"], TableState.FAULT),
        ("0", "1", "0", ["8"], TableState.FAULT),
    ],
)
def test_the_state_follows_from_errors_motor_and_motion(
    scripted: Scripted, on: str, done: str, rate: str, errors: list[str], state: TableState
) -> None:
    scripted.answers |= {"1MO?": on, "1MD?": done, "1TV?": rate}
    with TcpServer(lambda: scripted) as server, connected(server.address) as driver:
        scripted.errors += errors
        assert driver.state() is state


def test_a_fault_is_remembered_after_the_queue_has_told_it(scripted: Scripted) -> None:
    with TcpServer(lambda: scripted) as server, connected(server.address) as driver:
        driver.set_limits(LIMITS)
        scripted.errors += ["104"]
        assert [driver.state() for _ in range(3)] == [TableState.FAULT] * 3
        assert scripted.heard.count("1ST") == 1  # it is stopped, whatever the controller does at a limit
        for move in (driver.stop, lambda: driver.go_to_rate(1.0)):
            with pytest.raises(InstrumentError, match=r"in fault: 104 \(axis 1: positive hardware limit\)"):
                move()
        driver.enable()
        assert driver.state() is TableState.AT_REST


class Damaged(Scripted):
    """The next answers to `TE?` are `damaged`, one after the other; None is no answer."""

    damaged: list[bytes | None]

    def feed(self, data: bytes) -> bytes:
        answer = super().feed(data)
        if data.endswith(b"TE?\r") and self.damaged:  # a packet may hold the command before it, too
            return self.damaged.pop(0) or b""
        return answer


@pytest.fixture
def damaged() -> Damaged:
    conversation = Damaged()
    conversation.damaged = []
    return conversation


@pytest.mark.parametrize("line", [b"10\xff4\r\n", b"1\x004\r\n", b"?\r\n"])
def test_an_error_whose_code_was_lost_on_the_line_is_a_fault_and_stops_the_table(damaged: Damaged, line: bytes) -> None:
    damaged.answers["1MD?"] = "0"
    with TcpServer(lambda: damaged) as server, connected(server.address) as driver:
        damaged.damaged = [line]
        assert [driver.state() for _ in range(2)] == [TableState.FAULT] * 2
        assert damaged.heard.count("1ST") == 1
        with pytest.raises(InstrumentError, match="in fault: an error whose code was lost on the line; remove the"):
            driver.go_to_rate(0.0)
        driver.enable()
        assert driver.state() is TableState.MOVING


def test_an_error_that_is_lost_behind_a_command_is_reported_with_it(damaged: Damaged) -> None:
    with TcpServer(lambda: damaged) as server, connected(server.address) as driver:
        damaged.damaged = [b"1\xff4\r\n", b"6\r\n"]
        complaint = r"sent '1AC500.000000', it reports an error whose code was lost on the line, 6 \(no such command\)"
        with pytest.raises(InstrumentError, match=complaint):
            driver.set_limits(LIMITS)


def test_a_lost_code_is_remembered_where_the_line_falls_silent_behind_it(damaged: Damaged) -> None:
    with TcpServer(lambda: damaged) as server, connected(server.address, timeout_s=0.3) as driver:
        damaged.damaged = [b"10\xff4\r\n", None, None]
        with pytest.raises(LinkError, match=r"sent 'TE\?', no answer within 0.3 s"):
            driver.state()
        assert driver.state() is TableState.FAULT


@pytest.mark.parametrize("line", [b"0\xff\x00Z\r\n", b"Z\x910\r\n"])
def test_a_0_with_junk_in_it_is_no_error(damaged: Damaged, line: bytes, caplog: pytest.LogCaptureFixture) -> None:
    with TcpServer(lambda: damaged) as server, connected(server.address) as driver:
        damaged.damaged = [line]
        assert driver.state() is TableState.AT_REST
    (record,) = caplog.records
    assert "sent 'TE?', expected the code of an error, 0 to 999, got " in record.getMessage()


def test_where_no_answer_came_it_is_told_that_an_error_may_be_lost(
    damaged: Damaged, caplog: pytest.LogCaptureFixture
) -> None:
    with TcpServer(lambda: damaged) as server, connected(server.address, timeout_s=0.3) as driver:
        damaged.damaged = [None]
        assert driver.state() is TableState.AT_REST
    said = [record.getMessage() for record in caplog.records]
    assert said[-1].endswith("sent 'TE?' twice; an error may have been lost on the line")


def test_errors_that_nobody_asked_for_are_told_and_change_nothing(
    scripted: Scripted, caplog: pytest.LogCaptureFixture
) -> None:
    with TcpServer(lambda: scripted) as server, connected(server.address) as driver:
        scripted.errors += ["6", "113"]
        assert driver.state() is TableState.AT_REST
        scripted.errors += ["7"]
        driver.enable()
        scripted.errors += ["27"]
        driver.stop()  # says it twice
    assert [record.getMessage().partition(": ")[2] for record in caplog.records] == [
        "it reports 6 (no such command), 113 (axis 1: motor not enabled); none of that is a fault",
        "it reports 7 (parameter out of range); none of that is a fault",
        "it reports 27 (command not allowed); none of that is a fault",
    ]


def test_a_stop_is_sent_before_anything_is_asked(scripted: Scripted) -> None:
    with TcpServer(lambda: scripted) as server, connected(server.address) as driver:
        scripted.heard.clear()
        driver.stop()
    assert scripted.heard[0] == "1ST"


def test_a_stop_is_sent_twice_and_one_of_them_may_be_rejected(scripted: Scripted) -> None:
    with TcpServer(lambda: scripted) as server, connected(server.address) as driver:
        scripted.errors += ["6"]
        driver.stop()
        assert scripted.heard.count("1ST") == 2
        scripted.errors += ["27", "0", "27"]
        with pytest.raises(InstrumentError, match=r"a stop was commanded and it reports 27 \(command not allowed\)"):
            driver.stop()


@pytest.mark.parametrize("junk", ["2.\x005", "\xfe2.5", "2.5x"])
def test_an_answer_with_junk_in_it_is_asked_for_again(scripted: Scripted, junk: str) -> None:
    class OnceJunk(Scripted):
        def feed(self, data: bytes) -> bytes:
            answer = super().feed(data)
            if data == b"1TV?\r" and self.heard.count("1TV?") == 1:
                return junk.encode("latin-1") + b"\r\n"
            return answer

    conversation = OnceJunk(**{"1TV?": "2.5"})
    with TcpServer(lambda: conversation) as server, connected(server.address) as driver:
        assert driver.read().rate_dps == 2.5
