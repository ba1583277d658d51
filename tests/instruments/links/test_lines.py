"""Line dialogues over real sockets and pseudo-terminals, with instruments that misbehave."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable

import pytest

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.links.lines import MAX_TEXT, LineDialogue, Manners, NoAnswerError
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.links.tcp import LinkCutError, Reconnect
from benchctl_instruments.protocols.lines import LineCutter
from benchctl_instruments.simulated.tcp_server import TcpServer
from tests.instruments.chamber_machine import InstantClock

QUICK = Reconnect(attempts=2, wait_s=0.01)


class Instrument:
    """One instrument behind all connections: `answer` gets a line and how many came before, and says what to send."""

    def __init__(self, answer: Callable[[str, int], bytes]) -> None:
        self.answer = answer
        self.heard: list[str] = []
        self.raw = b""

    def connect(self) -> _Connection:
        return _Connection(self)


class _Connection:
    def __init__(self, instrument: Instrument) -> None:
        self._instrument = instrument
        self._lines = LineCutter(b"\r")

    def feed(self, data: bytes) -> bytes:
        self._instrument.raw += data
        answers = b""
        for line in self._lines.feed(data):
            self._instrument.heard.append(line)
            answers += self._instrument.answer(line, len(self._instrument.heard) - 1)
        return answers


def echo(line: str, before: int) -> bytes:
    return f"{line} to you\r\n".encode()


def dialogue(address: str, clock: InstantClock | None = None, **manners: object) -> LineDialogue:
    return LineDialogue(
        "stage",
        byte_link(address, reconnect=QUICK),
        manners=Manners(**({"timeout_s": 5.0} | manners)),  # type: ignore[arg-type]
        clock=clock if clock is not None else InstantClock(),
    )


class Opened:
    """A server and an open dialogue with it."""

    def __init__(self, answer: Callable[[str, int], bytes], *, pace_baud: int | None = None, **manners: object) -> None:
        self.instrument = Instrument(answer)
        self.server = TcpServer(self.instrument.connect, pace_baud=pace_baud)
        self.clock = InstantClock()
        self.manners = manners

    def __enter__(self) -> LineDialogue:
        self.server.start()
        self.dialogue = dialogue(self.server.address, self.clock, **self.manners)
        self.dialogue.open()
        return self.dialogue

    def __exit__(self, *exc: object) -> None:
        self.dialogue.close()
        self.server.stop()


def test_a_question_is_sent_with_its_end_and_the_answer_comes_without() -> None:
    bench = Opened(echo)
    with bench as stage:
        assert stage.ask("1TP?") == "1TP? to you"
        assert stage.tell("1VA2") == "1VA2 to you"
    assert bench.instrument.raw == b"1TP?\r\n1VA2\r\n"


def test_an_answer_in_pieces_is_put_together() -> None:
    with Opened(lambda line, before: b"12.5000 and more\r\n", pace_baud=9600) as stage:
        assert stage.ask("1TP?") == "12.5000 and more"


def test_lines_that_come_before_the_answer_can_be_skipped() -> None:
    with Opened(lambda line, before: b"%\n%12.5\n") as stage:
        assert stage.ask("PFBK(X)", skip=lambda answer: answer == "%") == "%12.5"


def test_an_instrument_that_says_only_what_is_skipped_is_not_listened_to_for_ever() -> None:
    bench = Opened(lambda line, before: b"%\n" * 500, pace_baud=9600, timeout_s=0.2)
    with bench as stage:
        started_s = time.monotonic()
        with pytest.raises(NoAnswerError, match=r"sent 'PFBK\(X\)', no answer within 0.2 s; check power"):
            stage.ask("PFBK(X)", skip=lambda answer: answer == "%")
        assert time.monotonic() - started_s < 0.95  # the chatter alone takes a second, each time that it is asked


def test_an_answer_of_several_lines_ends_where_the_line_falls_quiet() -> None:
    with Opened(lambda line, before: b"one\r\ntwo\r\n\r\nthree\r\n", pace_baud=9600, answer_end=None) as stage:
        assert stage.ask_text("$01?", quiet_s=0.3) == "one\ntwo\nthree"


def test_an_answer_of_several_lines_that_does_not_come_is_no_answer() -> None:
    bench = Opened(lambda line, before: b"", timeout_s=0.1)
    with bench as stage, pytest.raises(NoAnswerError, match=r"sent '\$01\?', no answer within 0\.1 s"):
        stage.ask_text("$01?", quiet_s=0.1)
    assert bench.instrument.heard == ["$01?", "$01?"]


def test_an_instrument_that_never_falls_quiet_is_not_listened_to_for_ever() -> None:
    with Opened(lambda line, before: b"line\n" * 50_000) as stage:
        assert len(stage.ask_text("$01?", quiet_s=5.0)) < 2 * MAX_TEXT


def test_lines_of_another_encoding_are_sent_and_received() -> None:
    bench = Opened(lambda line, before: b"1\xb6\xb0C\r\n", encoding="latin-1")
    with bench as stage:
        assert stage.ask("11023¶1¶1") == "1¶°C"
    assert bench.instrument.raw == b"11023\xb61\xb61\r\n"


def test_what_comes_behind_an_answer_is_no_answer_to_the_next_question() -> None:
    with Opened(lambda line, before: f"{line}!\r\nlate\r\n".encode()) as stage:
        assert [stage.ask("a"), stage.ask("b")] == ["a!", "b!"]


def test_a_query_without_an_answer_is_asked_once_more_on_a_new_connection_and_that_is_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench = Opened(lambda line, before: b"" if before == 0 else echo(line, before), timeout_s=0.4)
    with bench as stage:
        assert stage.ask("1TP?") == "1TP? to you"
    assert bench.instrument.heard == ["1TP?", "1TP?"]
    (record,) = caplog.records
    assert "sent '1TP?', no answer within 0.4 s" in record.getMessage()


def test_a_query_that_was_cut_off_is_asked_once_more() -> None:
    def cut_first(line: str, before: int) -> bytes:
        if before == 0:
            raise ConnectionResetError
        return echo(line, before)

    bench = Opened(cut_first)
    with bench as stage:
        assert stage.ask("1TP?") == "1TP? to you"
    assert bench.instrument.heard == ["1TP?", "1TP?"]


@pytest.mark.parametrize(("repeatable", "sent"), [(False, ["1PR5"]), (True, ["1PR5", "1PR5"])])
def test_a_command_is_sent_twice_only_where_that_is_allowed(repeatable: bool, sent: list[str]) -> None:
    bench = Opened(lambda line, before: b"" if before == 0 else echo(line, before), timeout_s=0.4)
    with bench as stage:
        if repeatable:
            assert stage.tell("1PR5", repeatable=True) == "1PR5 to you"
        else:
            with pytest.raises(NoAnswerError, match=r"sent '1PR5', no answer within 0.4 s"):
                stage.tell("1PR5")
    assert bench.instrument.heard == sent


def test_a_cut_command_says_so_and_is_not_repeated() -> None:
    def cut(line: str, before: int) -> bytes:
        raise ConnectionResetError

    bench = Opened(cut)
    with bench as stage, pytest.raises(LinkCutError, match=r"sent '1PR5', and the link broke: .*last on the wire"):
        stage.tell("1PR5")
    assert bench.instrument.heard == ["1PR5"]


def test_commands_that_are_not_answered_are_not_waited_for() -> None:
    bench = Opened(lambda line, before: echo(line, before) if line.endswith("?") else b"", commands_answered=False)
    with bench as stage:
        assert stage.tell("1MO") == ""
        assert stage.ask("1MO?") == "1MO? to you"
    assert bench.instrument.heard == ["1MO", "1MO?"]


def test_silence_is_said_in_one_line_with_the_wire_log() -> None:
    with Opened(lambda line, before: b"12.", timeout_s=0.1) as stage, pytest.raises(NoAnswerError) as caught:
        stage.ask("1TP?")
    message = str(caught.value)
    assert message.startswith("stage at tcp://127.0.0.1:")
    assert r"> b'1TP?\r\n'" in message
    assert "< b'12.'" in message
    assert "\n" not in message


def test_a_late_answer_is_not_taken_for_that_to_the_next_question() -> None:
    def late(line: str, before: int) -> bytes:
        if line == "slow":
            time.sleep(0.5)
        return echo(line, before)

    with Opened(late, timeout_s=0.4) as stage:
        with pytest.raises(NoAnswerError):
            stage.tell("slow")
        assert stage.ask("quick") == "quick to you"


def test_what_is_no_line_is_the_instruments_fault_and_not_asked_again() -> None:
    bench = Opened(lambda line, before: b"x" * 5000)
    with bench as stage, pytest.raises(InstrumentError, match=r"sent '1TP\?', expected a line: more than 4096 bytes"):
        stage.ask("1TP?")
    assert bench.instrument.heard == ["1TP?"]


def test_pauses_pass_in_bench_time_between_exchanges_and_not_before_the_first() -> None:
    bench = Opened(echo, pause_s=0.3)
    with bench as stage:
        stage.ask("a")
        assert bench.clock.slept_s == 0.0
        stage.ask("b")
        assert bench.clock.slept_s == pytest.approx(0.3)
        bench.clock.sleep(1.0)
        stage.ask("c")
        assert bench.clock.slept_s == pytest.approx(1.3)


def test_where_nobody_listens_the_instrument_is_named_and_nothing_is_asked_again() -> None:
    bench = Opened(echo)
    with bench as stage:
        bench.server.stop()
        with pytest.raises(LinkError, match=r"stage at .*could not send '1TP\?': .*could not connect in 2 attempts"):
            stage.ask("1TP?")
    with pytest.raises(LinkError, match=r"stage at tcp://.*could not connect in 2 attempts"):
        dialogue(bench.server.address).open()


def test_a_dialogue_that_is_not_open_is_the_callers_fault() -> None:
    stage = dialogue("tcp://127.0.0.1:1")
    with pytest.raises(UsageError, match=r"call open\(\) first"):
        stage.ask("1TP?")
    stage.close()


def test_what_is_not_one_line_is_refused_before_anything_is_sent() -> None:
    bench = Opened(echo)
    with bench as stage, pytest.raises(UsageError, match="not one line"):
        stage.tell("1MO\r1MF")
    assert bench.instrument.heard == []


def test_several_threads_get_their_own_answers() -> None:
    with Opened(echo) as stage:
        answers: dict[int, str] = {}
        threads = [
            threading.Thread(target=lambda n=number: answers.update({n: stage.ask(f"{n}TP?")})) for number in range(8)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert answers == {number: f"{number}TP? to you" for number in range(8)}


@pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")
def test_a_serial_line_is_spoken_to_alike_and_recovers_from_silence() -> None:
    from benchctl_instruments.simulated.serial_line import PtyLine

    instrument = Instrument(lambda line, before: b"" if before == 0 else b"\x00" + echo(line, before))
    line = PtyLine(instrument.connect(), pace_baud=None)
    line.start()
    try:
        stage = dialogue(f"serial://{line.port}?baud=9600", sent_end=b"\r", timeout_s=0.4)
        stage.open()
        assert stage.ask("1TP?") == "1TP? to you"
        stage.close()
    finally:
        line.stop()
    assert instrument.heard == ["1TP?", "1TP?"]
