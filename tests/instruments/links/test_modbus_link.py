"""The master on real wires: what it reads and writes, and what it says where the other side does not answer."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator

import pytest
import serial

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.links.modbus import ModbusLink, Retry
from benchctl_instruments.simulated.faults.bench import BenchFaults
from benchctl_instruments.simulated.faults.link_faults import Late
from benchctl_instruments.simulated.modbus_server import ModbusRtuServer, ModbusTcpServer
from benchctl_instruments.simulated.serial_line import SerialLine
from benchctl_instruments.simulated.tcp_server import TcpServer
from tests.instruments.chamber_machine import InstantClock
from tests.instruments.links.pairs import read_u32, write_u32
from tests.instruments.modbus_device import Memory, Misbehaving

QUICK = Retry(attempts=2, wait_s=0.01)
ANSWERED_S = 60.0  # the time-out where an answer comes: it only ends a hang, however slow the machine is
SILENT_S = 1.0  # the time-out where none comes, or none that is whole: each of these tests waits for it
Server = ModbusTcpServer | ModbusRtuServer


@pytest.fixture
def memory() -> Memory:
    return Memory()


@pytest.fixture(params=["tcp", "pty", "serial over tcp"])
def server(request: pytest.FixtureRequest, memory: Memory) -> Iterator[Server]:
    kind: str = request.param
    made: Server = (
        ModbusTcpServer(memory, unit_id=1)
        if kind == "tcp"
        else ModbusRtuServer(memory, unit_id=1, over_tcp=kind == "serial over tcp")
    )
    with made:
        yield made


@pytest.fixture
def link(server: Server) -> Iterator[ModbusLink]:
    link = ModbusLink(server.address, name="chamber", timeout_s=ANSWERED_S, retry=QUICK)
    link.open()
    yield link
    link.close()


def link_to(address: str, timeout_s: float = ANSWERED_S, retry: Retry = QUICK) -> ModbusLink:
    return ModbusLink(address, name="chamber", timeout_s=timeout_s, retry=retry)


def test_what_was_written_is_read_back_over_every_kind_of_wire(link: ModbusLink, memory: Memory) -> None:
    link.write(3, [0xFFFF])
    link.write(10, [1, 2, 3])
    write_u32(link, 22, 0x00112233)
    assert link.read(2, 2) == [2, 0xFFFF]
    assert link.read(10, 3) == [1, 2, 3]
    assert memory.words[22:24] == [0x0011, 0x2233]
    assert read_u32(link, 22) == 0x00112233


def test_a_refusal_is_the_instruments_fault_and_is_not_repeated(link: ModbusLink, server: Server) -> None:
    with pytest.raises(InstrumentError) as refused:
        link.read(99, 2)
    assert str(refused.value) == (
        f"chamber at {server.address}, unit 1: reading registers 99 to 100 was refused with exception 2"
        " (illegal data address); check that it is the right model and the value within its limits"
    )
    with pytest.raises(InstrumentError, match="writing 7 to register 100 was refused"):
        link.write(100, [7])


def test_another_unit_on_the_line_is_silent_and_the_error_says_who_was_asked_what(server: Server) -> None:
    link = ModbusLink(server.address, unit_id=3, name="chamber", timeout_s=0.05, retry=QUICK)
    link.open()
    with pytest.raises(LinkError) as silence:
        link.read(100)
    link.close()
    assert str(silence.value) == (
        f"chamber at {server.address}, unit 3: reading register 100 came to nothing, tried 2 times:"
        " no answer within 0.05 s; check power, cable, speed and unit number"
    )


def test_two_threads_share_a_link_without_mixing_their_answers(link: ModbusLink) -> None:
    wrong: list[tuple[int, list[int]]] = []

    def ask(first: int) -> None:
        for _ in range(50):
            words = link.read(first, 5)
            if words != list(range(first, first + 5)):
                wrong.append((first, words))

    threads = [threading.Thread(target=ask, args=(first,)) for first in (0, 30, 60)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_one_word_goes_with_function_6_unless_16_is_asked_for() -> None:
    device = Misbehaving(lambda _, answer: answer)
    with SerialLine(device.connect, over_tcp=True) as line:
        link = link_to(line.address)
        link.open()
        link.write(5, [1])
        link.write(5, [1], several=True)
        link.write(5, [1, 2])
        link.close()
    assert [request.function for request in device.asked] == [6, 16, 16]


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda answer: b"", "no answer within 1 s"),
        (
            lambda answer: answer[:-1] + bytes([answer[-1] ^ 1]),
            "the answer is broken or belongs to another request: 01 03",
        ),
        (lambda answer: answer[:4], "the answer is broken or belongs to another request: 01 03 02 00"),
        (
            lambda answer: bytes.fromhex("01 03 04 00 05 00 06 6A 30"),
            "belongs to another request: 01 03 04 00 05 00 06",
        ),
    ],
    ids=["silence", "damaged", "cut short", "of another length"],
)
def test_an_answer_that_is_none_is_asked_for_again_and_then_given_up(
    spoil: Callable[[bytes], bytes], said: str
) -> None:
    device = Misbehaving(lambda count, answer: spoil(answer))
    with SerialLine(device.connect) as line:
        link = link_to(line.address, SILENT_S)
        link.open()
        with pytest.raises(LinkError) as given_up:
            link.read(5)
        link.close()
    assert said in str(given_up.value)
    assert len(device.asked) == 2


@pytest.mark.parametrize("noise", [b"\x00", b"\x01\x03", b"\xff\x10\x20"])
def test_noise_before_an_answer_costs_at_most_a_second_question(noise: bytes) -> None:
    device = Misbehaving(lambda count, answer: noise + answer if count == 0 else answer)
    with SerialLine(device.connect) as line:
        link = link_to(line.address, SILENT_S)
        link.open()
        assert link.read(5) == [5]
        link.close()


def test_an_answer_in_pieces_is_one_answer() -> None:
    memory = Memory()
    with ModbusRtuServer(memory, unit_id=1, pace_baud=9600) as server:
        link = link_to(server.address)
        link.open()
        started_s = time.monotonic()
        assert link.read(0, 20) == list(range(20))
        took_s = time.monotonic() - started_s
        link.close()
    assert took_s >= (8 + 45) * 10 / 9600


def test_a_late_answer_is_not_taken_for_the_next_one() -> None:
    given_up = threading.Event()

    def dawdle_once(count: int, answer: bytes) -> bytes:
        if count == 0:
            assert given_up.wait(ANSWERED_S)
        return answer

    device = Misbehaving(dawdle_once)
    with SerialLine(device.connect) as line:
        link = link_to(line.address, SILENT_S, Retry(attempts=1, wait_s=1.0))
        link.open()
        with pytest.raises(LinkError, match="tried once"):
            link.read(5)
        given_up.set()  # the answer now comes while the link waits for quiet
        assert link.read(7) == [7]
        link.close()


def test_a_cut_connection_is_made_again_in_the_middle_of_a_dialogue(memory: Memory) -> None:
    with ModbusTcpServer(memory, unit_id=1) as server:
        link = link_to(server.address)
        link.open()
        assert link.read(1) == [1]
        server.cut_connections()
        assert link.read(2) == [2]
        link.close()


def test_a_server_that_has_gone_is_named_with_the_systems_reason(memory: Memory) -> None:
    with ModbusTcpServer(memory, unit_id=1) as server:
        link = link_to(server.address)
        link.open()
        address = server.address
    with pytest.raises(
        LinkError, match=r"reading register 1 came to nothing, tried 2 times: cannot connect: .*refused"
    ):
        link.read(1)
    link.close()
    with pytest.raises(LinkError, match=f"chamber at {address}, unit 1: cannot connect: .*refused; check power"):
        link_to(address).open()


def test_a_port_that_does_not_exist_or_is_taken_is_named(memory: Memory) -> None:
    with pytest.raises(LinkError, match="/dev/no-such-port"):
        link_to("serial:///dev/no-such-port?baud=9600").open()
    with ModbusRtuServer(memory, unit_id=1) as server:
        if server.address.startswith("serial:"):  # a port has one user; a simulated line over TCP takes several
            device = parse_address(server.address).pyserial_url
            with serial.Serial(device, exclusive=True), pytest.raises(LinkError, match="another program has it open"):
                link_to(server.address).open()


def test_a_write_that_must_not_happen_twice_is_not_repeated() -> None:
    device = Misbehaving(lambda count, answer: b"")
    with SerialLine(device.connect, over_tcp=True) as line:
        link = link_to(line.address, SILENT_S)
        link.open()
        with pytest.raises(LinkError, match="tried once"):
            link.write(5, [1], once=True)
        link.close()
    assert len(device.asked) == 1


def test_a_link_that_is_not_open_says_so_and_closing_twice_is_harmless() -> None:
    link = link_to("tcp://127.0.0.1:9")
    link.close()
    link.close()
    with pytest.raises(UsageError, match=r"reading register 5 needs an open link; call open\(\) first"):
        link.read(5)


def test_the_line_stays_quiet_between_two_exchanges_as_long_as_is_asked(memory: Memory) -> None:
    with ModbusRtuServer(memory, unit_id=1) as server:
        link = ModbusLink(server.address, timeout_s=ANSWERED_S, pause_s=0.03)
        link.open()
        started_s = time.monotonic()
        for _ in range(4):
            link.read(0)
        took_s = time.monotonic() - started_s
        link.close()
    assert took_s >= 3 * 0.03


def test_the_pause_passes_on_the_clock_that_is_given(memory: Memory) -> None:
    clock = InstantClock()
    with ModbusRtuServer(memory, unit_id=1) as server:
        link = ModbusLink(server.address, timeout_s=ANSWERED_S, pause_s=10.0, clock=clock)
        link.open()
        for _ in range(3):
            link.read(0)
        clock.sleep(4.0)
        link.read(0)
        link.close()
    assert clock.now() == 30.0


def test_the_wire_log_holds_the_bytes_of_an_exchange(memory: Memory) -> None:
    with ModbusRtuServer(memory, unit_id=1) as server:
        link = link_to(server.address)
        link.open()
        link.read(0x64 - 1)
        link.close()
    sent = b"".join(entry.data for entry in link.wire_log.last(10) if entry.direction == "sent")
    received = b"".join(entry.data for entry in link.wire_log.last(10) if entry.direction == "received")
    assert sent == bytes.fromhex("01 03 00 63 00 01 74 14")
    assert received == bytes.fromhex("01 03 02 00 63 F8 6D")


def test_the_library_below_logs_nothing_of_its_own(caplog: pytest.LogCaptureFixture) -> None:
    device = Misbehaving(lambda count, answer: b"")
    with caplog.at_level(logging.WARNING), TcpServer(device.connect) as server:
        link = link_to(server.address, 0.1)
        link.open()
        with pytest.raises(LinkError):
            link.read(5)
        link.close()
    assert caplog.records == []


@pytest.mark.parametrize("over_tcp", [False, True])
def test_a_late_answer_shifts_no_answer_to_the_next_question(memory: Memory, over_tcp: bool) -> None:
    late = Late(on="chamber", nth=1, behind_s=0.05)
    server = ModbusRtuServer(memory, unit_id=1, over_tcp=over_tcp)
    BenchFaults([late], lambda: 0.0).befall("chamber", server)
    with server:
        link = ModbusLink(server.address, timeout_s=SILENT_S, retry=QUICK)
        link.open()
        found = [link.read(register) for register in (5, 7, 9)]
        link.close()
    assert found == [[5], [7], [9]]


@pytest.mark.parametrize("address", ["visa://GPIB0::7::INSTR", "daqmx://Dev1"])
def test_an_address_that_carries_no_modbus_is_refused(address: str) -> None:
    with pytest.raises(UsageError, match=r"Modbus has no (visa|daqmx); expected tcp, serial or socket"):
        ModbusLink(address)
