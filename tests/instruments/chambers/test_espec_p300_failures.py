"""The P-300 driver byte for byte, against whatever else may answer at its address, or lie there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from benchctl_instruments.chambers.espec_p300 import EspecP300
from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.links.lines import NoAnswerError
from benchctl_instruments.links.tcp import Reconnect
from benchctl_instruments.protocols.lines import LineCutter
from benchctl_instruments.simulated.tcp_server import TcpServer
from tests.instruments.chamber_machine import InstantClock

GOOD = {
    "TYPE?": b"T,SCP220,190.0\r\n",
    "ROM?": b"JMIC 4.00\r\n",
    "TEMP?": b"27.0,50.0,185.0,-90.0\r\n",
    "MODE?": b"STANDBY\r\n",
    "ALARM?": b"0\r\n",
    "%?": b"1,0.0\r\n",
}
Answer = bytes | Callable[[int], bytes]


class Scripted:
    """One chamber behind all connections that answers from a table; a command that is not in it with OK.

    An answer may depend on how often its line came before.
    """

    def __init__(self, answers: dict[str, Answer]) -> None:
        self.answers: dict[str, Answer] = {**GOOD, **answers}
        self.heard: list[str] = []
        self.raw = b""

    def connect(self) -> _Connection:
        return _Connection(self)

    def answer(self, line: str) -> bytes:
        before = self.heard.count(line)
        self.heard.append(line)
        answer = self.answers.get(line, b"OK:" + line.encode() + b"\r\n")
        return answer(before) if callable(answer) else answer


class _Connection:
    def __init__(self, scripted: Scripted) -> None:
        self._scripted = scripted
        self._lines = LineCutter()

    def feed(self, data: bytes) -> bytes:
        self._scripted.raw += data
        return b"".join(map(self._scripted.answer, self._lines.feed(data)))


class Bench:
    """A scripted chamber and the driver at its wire, open."""

    def __init__(self, answers: dict[str, Answer] | None = None, **options: Any) -> None:
        self.scripted = Scripted(answers or {})
        self.clock = InstantClock()
        self._server = TcpServer(self.scripted.connect)
        self._options = options

    def __enter__(self) -> EspecP300:
        self._server.start()
        options: dict[str, Any] = {"reconnect": Reconnect(attempts=2, wait_s=0.01), **self._options}
        self._driver = EspecP300(self._server.address, clock=self.clock, **options)
        try:
            self._driver.open()
        except BaseException:
            self._server.stop()
            raise
        return self._driver

    def __exit__(self, *exc: object) -> None:
        self._driver.close()
        self._server.stop()


def shows(setpoint_c: float) -> bytes:
    return f"27.0,{setpoint_c:.1f},185.0,-90.0\r\n".encode()


def test_a_whole_session_byte_for_byte_without_a_word_about_humidity() -> None:
    bench = Bench({"TEMP?": lambda before: shows(50.0 if before < 2 else -40.0), "MODE?": _standby_then_constant})
    with bench as chamber:
        chamber.go_to(-40.0)
        chamber.start()
        chamber.read()
    assert bench.scripted.raw == (
        b"TYPE?\r\nTEMP?\r\n"
        b"TEMP?\r\nTEMP, S-40.0\r\nTEMP?\r\n"
        b"MODE?\r\nMODE,CONSTANT\r\nMODE?\r\n"
        b"TEMP?\r\n%?\r\nALARM?\r\n"
    )


def _standby_then_constant(before: int) -> bytes:
    return b"STANDBY\r\n" if before == 0 else b"CONSTANT\r\n"


def test_limits_go_out_byte_for_byte_in_one_line() -> None:
    bench = Bench({"TEMP?": lambda before: shows(50.0) if before < 2 else b"27.0,50.0,85.0,-55.0\r\n"})
    with bench as chamber:
        chamber.set_limits(-55.0, 85.0)
    assert b"\r\nTEMP, S50.0 H85.0 L-55.0\r\n" in bench.scripted.raw


def test_the_number_on_rs485_goes_before_every_line() -> None:
    answers: dict[str, Answer] = {f"3,{query}": answer for query, answer in GOOD.items()}
    bench = Bench(answers, rs485_address=3)
    with bench as chamber:
        chamber.read()
    assert bench.scripted.raw == b"3,TYPE?\r\n3,TEMP?\r\n3,TEMP?\r\n3,%?\r\n3,ALARM?\r\n"


def test_an_scp_220_says_who_it_is() -> None:
    with Bench() as chamber:
        identity = chamber.identify()
    assert (identity.model, identity.firmware) == ("SCP220", "JMIC 4.00")


def test_a_chamber_that_answers_with_an_echo_before_the_data_is_understood() -> None:
    with Bench({query: b"OK:" + query.encode() + b"\r\n" + answer for query, answer in GOOD.items()}) as chamber:
        assert chamber.read().setpoint_c == 50.0


def test_blanks_bare_line_feeds_and_noise_do_no_harm() -> None:
    with Bench({"TEMP?": b"\x00\xff 27.0,  50.0, 185.0,-90.0 \n"}) as chamber:
        assert chamber.read().temperature_c == 27.0


def test_an_answer_that_was_garbled_on_the_wire_is_asked_for_once_more_and_that_is_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    def garbled(answer: bytes) -> Callable[[int], bytes]:
        return lambda before: b"\xfe" + answer[1:3] + b"\xff" + answer[3:] if before == 0 else answer

    bench = Bench({"%?": garbled(b"1,7.5\r\n"), "MODE,CONSTANT": garbled(b"OK\r\n"), "MODE?": _standby_then_constant})
    with bench as chamber:
        assert chamber.read().power_percent == 7.5
        chamber.start()
    assert bench.scripted.heard.count("%?") == bench.scripted.heard.count("MODE,CONSTANT") == 2
    heater, mode = (record.getMessage() for record in caplog.records)
    assert "sent '%?', expected the number of outputs" in heater
    assert "sent 'MODE,CONSTANT', expected OK" in mode


@pytest.mark.parametrize("reason", [b"NA:CHB NOT READY\r\n", b"NA: DATA NOT READY\r\n"])
def test_a_chamber_that_is_not_ready_is_asked_again_until_it_is(reason: bytes) -> None:
    bench = Bench({"%?": lambda before: reason if before < 3 else b"1,7.5\r\n"})
    with bench as chamber:
        assert chamber.read().power_percent == 7.5
    assert bench.scripted.heard.count("%?") == 4
    assert bench.clock.slept_s == pytest.approx(1.5)


def test_a_command_that_comes_too_early_is_given_again() -> None:
    bench = Bench(
        {
            "TEMP, S30.0": lambda before: b"NA:CHB NOT READY\r\n" if before == 0 else b"OK\r\n",
            "TEMP?": lambda before: shows(50.0 if before < 2 else 30.0),
        }
    )
    with bench as chamber:
        chamber.go_to(30.0)
    assert bench.scripted.heard.count("TEMP, S30.0") == 2


def test_a_chamber_that_never_gets_ready_is_given_up_after_the_stated_time() -> None:
    bench = Bench({"ALARM?": b"NA:DATA NOT READY\r\n"}, ready_s=2.0)
    with bench as chamber, pytest.raises(InstrumentError, match=r"'ALARM\?' was refused for 2.0 s with 'NA:DATA NOT"):
        chamber.read()
    assert bench.clock.slept_s == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("answers", "act", "complaint"),
    [
        ({"TEMP?": b"-----,50.0,185.0,-90.0\r\n"}, EspecP300.read, r"sent 'TEMP\?', expected air, set point, .*-----"),
        ({"TEMP?": b"27.0,OFF,185.0,-90.0\r\n"}, EspecP300.read, "its set point is switched off; switch temperature"),
        (
            {"%?": b"2,1.0\r\n"},
            EspecP300.read,
            r"expected the number of outputs .*check the cable, and that it is an ESPEC",
        ),
        ({"ALARM?": b"2,7\r\n"}, EspecP300.read, "expected the number of alarms and their codes, got '2,7'"),
        ({"ALARM?": b"NA:CMD_ERR\r\n"}, EspecP300.read, "refused with 'NA:CMD_ERR': it does not know the command"),
        ({"MODE?": b"NA\r\n"}, EspecP300.start, r"'MODE\?' was refused with 'NA': see the chamber's manual"),
        ({"MODE?": b"ASLEEP\r\n"}, EspecP300.start, "expected a mode, got 'ASLEEP'"),
        ({"MODE?": b"RMT RUN\r\n"}, EspecP300.start, "it runs a program"),
        ({}, EspecP300.start, "acknowledged CONSTANT, and still reads STANDBY after 2 s"),
        ({"MODE,CONSTANT": b"FINE\r\n"}, EspecP300.start, "sent 'MODE,CONSTANT', expected OK, got 'FINE'"),
        ({}, lambda chamber: chamber.go_to(20.0), "acknowledged set point 20 °C, and still reads set point 50 °C"),
        (
            {"TEMP, S50.0 H85.0 L-55.0": b"OK\r\n"},
            lambda chamber: chamber.set_limits(-55.0, 85.0),
            "low alarm -55 °C, and still reads set point 50 °C, high alarm 185 °C, low alarm -90 °C",
        ),
    ],
)
def test_answers_are_neither_guessed_nor_believed(
    answers: dict[str, Answer], act: Callable[[EspecP300], object], complaint: str
) -> None:
    usual = {"TEMP?": lambda before: GOOD["TEMP?"] if before == 0 else answers.get("TEMP?", GOOD["TEMP?"])}
    with Bench({**answers, **usual}) as chamber:
        with pytest.raises(InstrumentError, match=complaint) as caught:
            act(chamber)
        assert str(caught.value).startswith("ESPEC P300 at tcp://127.0.0.1:")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("answers", "complaint"),
    [
        ({"TYPE?": b"HTTP/1.1 400 Bad Request\r\n"}, "expected sensors, controller and highest set point, got 'HTTP"),
        ({"TYPE?": b"NA:CMD ERR\r\n"}, r"'TYPE\?' was refused"),
        ({"TYPE?": b"\x00" * 5000}, "expected a line: more than 4096 bytes"),
        ({"TEMP?": b"27.0,50.0,-90.0,185.0\r\n"}, "its alarms read 185 and -90 °C, low not below high"),
    ],
)
def test_another_instrument_at_the_address_is_found_when_it_is_opened_and_let_go(
    answers: dict[str, Answer], complaint: str
) -> None:
    scripted = Scripted(answers)
    with TcpServer(scripted.connect) as server:
        chamber = EspecP300(server.address, clock=InstantClock())
        with pytest.raises(InstrumentError, match=complaint):
            chamber.open()
        with pytest.raises(UsageError, match="open"):
            chamber.read()


def test_silence_is_said_with_the_wire_log_after_two_questions() -> None:
    bench = Bench({"ALARM?": b""}, timeout_s=0.2)
    with bench as chamber, pytest.raises(NoAnswerError, match=r"sent 'ALARM\?', no answer within 0.2 s; .*> b'ALARM\?"):
        chamber.read()
    assert bench.scripted.heard.count("ALARM?") == 2


def test_a_cut_in_the_middle_of_a_command_is_bridged_because_it_may_be_repeated() -> None:
    def cut_first(before: int) -> bytes:
        if before == 0:
            raise ConnectionResetError
        return b"OK\r\n"

    bench = Bench({"TEMP, S30.0": cut_first, "TEMP?": lambda before: shows(50.0 if before < 2 else 30.0)})
    with bench as chamber:
        chamber.go_to(30.0)
    assert bench.scripted.heard.count("TEMP, S30.0") == 2


def test_where_nobody_listens_the_chamber_and_its_address_are_named() -> None:
    with TcpServer(Scripted({}).connect) as server:
        address = server.address
    chamber = EspecP300(address, clock=InstantClock(), reconnect=Reconnect(attempts=1))
    with pytest.raises(LinkError, match=f"ESPEC P300 at {address}: .*could not connect"):
        chamber.open()


def test_pauses_are_kept_where_a_site_wants_them() -> None:
    bench = Bench(pause_s=0.3)
    with bench as chamber:
        chamber.read()
    assert bench.clock.slept_s == pytest.approx(4 * 0.3)
