"""The driver against whatever else may answer at its address: nothing, something else, or a controller that lies."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import TableLimits, TableState
from benchctl_instruments.links.tcp import LinkCutError, Reconnect
from benchctl_instruments.protocols.lines import LineCutter
from benchctl_instruments.rate_tables.aerotech_ensemble import Ensemble
from benchctl_instruments.simulated.tcp_server import TcpServer
from tests.instruments.table_machine import CountedClock

LIMITS = TableLimits(rate_dps=300.0, acceleration_dps2=500.0)
GOOD = {
    "AXISSTATUS(@0)": "%-2147483637",  # enabled, homed, and its move is active
    "AXISFAULT(@0)": "%0",
    "PLANESTATUS(0)": "%0",
    "PFBKPROG(@0)": "%0",
    "VFBK(@0)": "%0",
    "GETPARM(@0, 73)": "%500",
}


class Scripted:
    """Answers queries from a table, and everything else with `%`."""

    def __init__(self, **answers: str) -> None:
        self.lines = LineCutter()
        self.answers = GOOD | answers
        self.heard: list[str] = []

    def feed(self, data: bytes) -> bytes:
        lines = self.lines.feed(data)
        self.heard += lines
        return b"".join(self.answers.get(line, "%").encode() + b"\n" for line in lines)


class Raw:
    """Answers every packet with the same bytes."""

    def __init__(self, answer: bytes) -> None:
        self.answer = answer

    def feed(self, data: bytes) -> bytes:
        return self.answer


def connected(server: TcpServer, timeout_s: float = 1.0) -> Ensemble:
    return Ensemble(
        server.address, clock=CountedClock(), timeout_s=timeout_s, reconnect=Reconnect(attempts=2, wait_s=0.01)
    )


def scripted(**answers: str) -> TcpServer:
    conversation = Scripted(**answers)
    return TcpServer(lambda: conversation)


def test_a_silent_address_is_named_with_what_was_asked_and_how_long_was_waited() -> None:
    with TcpServer(lambda: Raw(b"")) as server, pytest.raises(LinkError) as caught:
        connected(server, timeout_s=0.1).open()
    message = str(caught.value)
    assert f"rate table at {server.address}: sent 'AXISSTATUS(@0)', no answer within 0.1 s" in message
    assert "check power, cable" in message
    assert "\n" not in message


def test_bare_lines_and_nothing_behind_them_are_silence() -> None:
    with TcpServer(lambda: Raw(b"%\n%\n")) as server, pytest.raises(LinkError, match=r"no answer within 0.1 s"):
        connected(server, timeout_s=0.1).open()


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
        b"00000001Rate\r\n",
        b"%ready\n",
        b"%1.5\n",
        b"!\n",
        b"#\n",
        b"$\n",
    ],
)
def test_another_instrument_or_axis_at_the_address_is_an_instrument_error(banner: bytes) -> None:
    with TcpServer(lambda: Raw(banner)) as server:
        driver = connected(server)
        with pytest.raises(InstrumentError, match=rf"{server.address}.*check that the address is an Ensemble's") as err:
            driver.open()
        assert "\n" not in str(err.value)
        with pytest.raises(UsageError, match="open"):
            driver.read()


def test_what_never_ends_a_line_is_not_an_ensemble() -> None:
    with TcpServer(lambda: Raw(b"x" * 5000)) as server, pytest.raises(InstrumentError, match="without an end of line"):
        connected(server).open()


def test_a_query_that_is_cut_off_is_asked_again() -> None:
    cut: list[str] = []

    class CutOnce(Scripted):
        def feed(self, data: bytes) -> bytes:
            if data.startswith(b"VFBK") and not cut:
                cut.append("VFBK")
                raise ConnectionResetError
            return super().feed(data)

    with TcpServer(CutOnce) as server, connected(server) as driver:
        assert driver.read().rate_dps == 0.0
    assert cut == ["VFBK"]


def test_a_move_by_an_increment_is_never_sent_twice_and_a_rate_may_be() -> None:
    heard: list[str] = []
    cut: set[str] = set()

    class CutOnce(Scripted):
        def feed(self, data: bytes) -> bytes:
            line = data.decode().strip()
            heard.append(line)
            name = line.split()[0]
            if name in ("LINEAR", "FREERUN") and name not in cut:
                cut.add(name)
                raise ConnectionResetError
            return super().feed(data)

    answers = {"AXISSTATUS(@0)": "%3"}
    with TcpServer(lambda: CutOnce(**answers)) as server, connected(server) as driver:
        driver.set_limits(LIMITS)
        with pytest.raises(LinkCutError, match=r"sent 'LINEAR @0 -10.000000 F300.000000'"):
            driver.go_to_angle(10.0)
        assert [line for line in heard if line.startswith("LINEAR")] == ["LINEAR @0 -10.000000 F300.000000"]
    with TcpServer(CutOnce) as server, connected(server) as driver:
        driver.set_limits(LIMITS)
        driver.go_to_rate(10.0)
        assert heard.count("FREERUN @0 -10.000000") == 2


@pytest.mark.parametrize("line", ["VFBK(@0)", "FREERUN @0 -10.000000"])
def test_an_answer_that_is_junk_is_asked_for_again(line: str) -> None:
    class OnceJunk(Scripted):
        def feed(self, data: bytes) -> bytes:
            answer = super().feed(data)
            return b"\xfe?" + answer if data.decode().strip() == line and self.heard.count(line) == 1 else answer

    conversation = OnceJunk()
    with TcpServer(lambda: conversation) as server, connected(server) as driver:
        driver.set_limits(LIMITS)
        driver.go_to_rate(10.0)
        assert driver.read().rate_dps == 0.0
        assert conversation.heard.count(line) == 2


def test_a_move_and_an_acknowledgement_of_faults_are_not_said_again_for_junk() -> None:
    move, acknowledge = "LINEAR @0 -10.000000 F300.000000", "FAULTACK @0"
    conversation = Scripted(**{move: "?", acknowledge: "?", "AXISSTATUS(@0)": "%3"})
    with TcpServer(lambda: conversation) as server, connected(server) as driver:
        driver.set_limits(LIMITS)
        with pytest.raises(InstrumentError, match=r"sent 'LINEAR.* expected a line that begins with"):
            driver.go_to_angle(10.0)
        conversation.answers["AXISFAULT(@0)"] = "%1"
        with pytest.raises(InstrumentError, match=r"sent 'FAULTACK.* expected a line that begins with"):
            driver.enable()
    assert (conversation.heard.count(move), conversation.heard.count(acknowledge)) == (1, 1)


def test_a_percent_sign_before_a_refusal_is_not_taken_for_an_acknowledgement() -> None:
    answers = {"FREERUN @0 -10.000000": "%\n!", "AXISSTATUS(@0)": "%1"}
    with scripted(**answers) as server, connected(server) as driver:
        driver.set_limits(LIMITS)
        with pytest.raises(InstrumentError, match="a rate of 10 deg/s was commanded and acknowledged, its status"):
            driver.go_to_rate(10.0)


def test_a_late_reply_never_answers_the_next_question() -> None:
    asked = 0

    class Late(Scripted):
        def feed(self, data: bytes) -> bytes:
            nonlocal asked
            if data.startswith(b"VFBK"):
                asked += 1
                if asked <= 2:
                    time.sleep(0.4)
                    return b"%77\n"
            return super().feed(data)

    with TcpServer(Late) as server, connected(server, timeout_s=0.2) as driver:
        with pytest.raises(LinkError, match=r"sent 'VFBK\(@0\)', no answer within 0.2 s"):
            driver.read()
        time.sleep(0.4)
        assert driver.read().rate_dps == 0.0


Act = Callable[[Ensemble], object]


@pytest.mark.parametrize(
    ("answers", "act", "complaint"),
    [
        ({"AXISSTATUS(@0)": "%1"}, lambda d: d.go_to_rate(10.0), "a rate of 10 deg/s was commanded and acknowledged"),
        ({"AXISSTATUS(@0)": "%0"}, lambda d: d.enable(), "enabling was commanded and acknowledged"),
        ({"AXISSTATUS(@0)": "%2"}, lambda d: d.go_to_angle(0.0), "an angle of 0 deg was commanded and acknowledged"),
        ({"FREERUN @0 -10.000000": "$"}, lambda d: d.go_to_rate(10.0), "did not finish in time"),
        ({"FREERUN @0 -10.000000": "!"}, lambda d: d.go_to_rate(10.0), "does not understand that"),
        ({"FREERUN @0 -10.000000": "#limit"}, lambda d: d.go_to_rate(10.0), "got '#limit'; no fault is reported"),
        ({"FREERUN @0 -10.000000": "OK"}, lambda d: d.go_to_rate(10.0), "expected a line that begins with"),
        ({"ABORT @0": "#"}, lambda d: d.stop(), r"sent 'ABORT @0', expected %, got '#'"),
        ({"AXISFAULT(@0)": "%4"}, lambda d: d.go_to_rate(10.0), r"fault 0x4 \(clockwise end of travel\)"),
        ({"AXISFAULT(@0)": "%4"}, lambda d: d.stop(), r"a stop was commanded: fault 0x4"),
        ({"AXISFAULT(@0)": "%8"}, lambda d: d.enable(), "its faults were acknowledged and are back"),
        ({"AXISFAULT(@0)": "%none"}, lambda d: d.state(), "expected an integer of 32 bits, got 'none'"),
        ({"VFBK(@0)": "%nan"}, lambda d: d.read(), "expected a number, got 'nan'"),
        ({"VFBK(@0)": "%1_0"}, lambda d: d.read(), "expected a number, got '1_0'"),
        ({"VFBK(@0)": "%" + "9" * 4000}, lambda d: d.read(), "expected a number, got '9{64}';"),
        ({"PFBKPROG(@0)": "#" + "x" * 4000}, lambda d: d.read(), "expected % and data, got '#x{63}';"),
        ({"PFBKPROG(@0)": "#"}, lambda d: d.read(), "expected % and data, got '#'"),
        ({"GETPARM(@0, 73)": "%100"}, lambda d: d.set_limits(LIMITS), "should be 500 deg/s².*reads back 100"),
        ({}, lambda d: d.disable(), "disabling was commanded, and the axis is still enabled"),
        ({}, lambda d: d.go_to_angle(5.0), "a stop before its next motion was commanded, and it still moves"),
    ],
)
def test_an_acknowledgement_is_not_believed(answers: dict[str, str], act: Act, complaint: str) -> None:
    conversation = Scripted()
    with TcpServer(lambda: conversation) as server, connected(server) as driver:
        driver.set_limits(LIMITS)
        conversation.answers |= answers
        with pytest.raises(InstrumentError, match=complaint) as caught:
            act(driver)
        assert str(caught.value).startswith(f"rate table at {server.address}: ")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("status", "fault", "plane", "rate", "state"),
    [
        ("%-2147483647", "%0", "%0", "%0.04", TableState.AT_REST),
        ("%-2147483647", "%0", "%0", "%-0.06", TableState.MOVING),
        ("%9", "%0", "%0", "%0", TableState.MOVING),
        ("%1", "%0", "%1", "%0", TableState.MOVING),
        ("%-2147483648", "%0", "%0", "%0", TableState.DISABLED),
        ("%1", "%1", "%0", "%0", TableState.FAULT),
        ("%0", "%-2147483648", "%0", "%0", TableState.FAULT),
    ],
)
def test_the_state_follows_from_fault_status_and_motion(
    status: str, fault: str, plane: str, rate: str, state: TableState
) -> None:
    answers = {"AXISSTATUS(@0)": status, "AXISFAULT(@0)": fault, "PLANESTATUS(0)": plane, "VFBK(@0)": rate}
    with scripted(**answers) as server, connected(server) as driver:
        assert driver.state() is state


def test_a_fault_ends_a_motion_even_where_the_controller_lets_it_go_on() -> None:
    conversation = Scripted(**{"AXISFAULT(@0)": "%1"})
    with TcpServer(lambda: conversation) as server, connected(server) as driver:
        assert driver.state() is TableState.FAULT
        assert "ABORT @0" in conversation.heard


def test_a_fault_in_which_even_a_stop_is_refused_is_told_as_it_is() -> None:
    with scripted(**{"AXISFAULT(@0)": "%1", "ABORT @0": "#"}) as server, connected(server) as driver:
        assert driver.state() is TableState.FAULT
        with pytest.raises(InstrumentError, match=r"a stop was commanded: fault 0x1 \(position error\)"):
            driver.stop()


def test_a_stop_is_sent_before_anything_is_asked() -> None:
    conversation = Scripted()
    with TcpServer(lambda: conversation) as server, connected(server) as driver:
        conversation.heard.clear()
        driver.stop()
    assert conversation.heard[0] == "ABORT @0"


def test_another_axis_is_addressed_by_its_number() -> None:
    conversation = Scripted(**{"AXISSTATUS(@2)": "%0", "PFBKPROG(@2)": "%10", "VFBK(@2)": "%-1"})
    with (
        TcpServer(lambda: conversation) as server,
        Ensemble(server.address, clock=CountedClock(), axis=2) as driver,
    ):
        reading = driver.read()
    assert (reading.angle_deg, reading.rate_dps) == (350.0, 1.0)
