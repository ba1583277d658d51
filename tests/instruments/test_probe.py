"""The probe recognises every simulated instrument over its wire, by questions that change nothing on it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from benchctl_instruments import probe
from benchctl_instruments.catalog import Kind, driver, our_models, twin
from benchctl_instruments.errors import LinkError, UsageError
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.links.modbus import ModbusLink
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.probe import KINDS, Inquiry, Known, Match, Probe
from benchctl_instruments.recognition import ByLine, ByRegisters
from benchctl_instruments.simulated.clock import ScaledClock
from benchctl_instruments.simulated.modbus_server import ModbusRtuServer, RegisterTable, word
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.watlow_f4 import SimulatedWatlowF4
from benchctl_instruments.simulated.world import World
from tests.benchctl.doctor.benches import server
from tests.third_party.packages import install, site

__all__ = ["site"]

TIMEOUT_S = 0.5
CLOCK = ScaledClock(20.0)  # for the pauses between requests
READ_REGISTERS = 3
QUICK = ("newport_esp301", "thermotron_3800", "kvh_dsp1760")

needs_terminals = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
OURS = [
    pytest.param(kind, model, marks=() if model in QUICK else pytest.mark.slow)
    for kind in KINDS
    for model in our_models(kind)
    if model not in ("manual", "ni_daqmx")  # no wire, and a library's
]


class Watched:
    """A simulated machine that keeps the names of its commands which were called."""

    COMMANDS = frozenset(
        {"close_loop", "open_loop", "set_limits", "demand_rate", "demand_angle", "demand_sine", "set_setpoint", "run"}
    )

    def __init__(self, machine: Any) -> None:
        self._machine = machine
        self.commanded: list[str] = []

    def __getattr__(self, name: str) -> Any:
        if name in self.COMMANDS:
            self.commanded.append(name)
        return getattr(self._machine, name)


def machine_of(kind: Kind) -> Watched:
    world = World(ScaledClock(1.0), WorldSettings())
    return Watched({"rate_table": world.table, "chamber": world.chamber}.get(kind, world.inputs))


def asked(address: str, unit_id: int = 1) -> tuple[list[Match], list[Inquiry]]:
    exchanges: list[Inquiry] = []
    found = Probe(address, clock=CLOCK, unit_id=unit_id, timeout_s=TIMEOUT_S, tell=exchanges.append).matches()
    return found, exchanges


def changes_nothing(exchange: Inquiry) -> bool:
    """Whether what was sent is a query in a line, or a request of Modbus to read registers."""
    if exchange.question.startswith("Modbus"):
        return exchange.sent[7 if parse_address(exchange.address).scheme == "tcp" else 1] == READ_REGISTERS
    reads = (b"", b"AXISSTATUS(@0)\n", b"$01I\r", "99997¶1¶1\r".encode("latin-1"))
    return exchange.sent in reads or b"?" in exchange.sent


@pytest.mark.parametrize(("kind", "model"), OURS)
def test_every_simulated_instrument_is_recognised_and_stays_as_it_was(kind: Kind, model: str) -> None:
    machine = machine_of(kind)
    with twin(kind, model)(machine) as running:
        machine.commanded.clear()
        found, exchanges = asked(running.address)
        assert [(match.kind, match.model) for match in found] == [(kind, model)]
        assert machine.commanded == []
    assert all(map(changes_nothing, exchanges))
    assert found[0].address == running.address
    assert found[0].device


def test_what_only_a_library_reaches_is_not_probed() -> None:
    with pytest.raises(UsageError, match=r"'daqmx://Dev1': what it names cannot be probed; state its model in bench"):
        asked("daqmx://Dev1")


@needs_terminals
@pytest.mark.parametrize(
    ("kind", "model"), [("rate_table", "newport_esp301"), ("chamber", "espec_p300"), ("chamber", "binder_mb2")]
)
@pytest.mark.slow
def test_without_a_speed_each_question_is_asked_at_the_speed_of_its_driver(kind: Kind, model: str) -> None:
    with twin(kind, model)(machine_of(kind), over_tcp=False) as running:
        device, _, _ = running.address.partition("?")
        (match,), exchanges = asked(device)
    assert match.model == model
    speeds = {exchange.address.rpartition("=")[2] for exchange in exchanges}
    assert speeds <= {"9600", "19200", "921600"}
    assert len(speeds) > 1


def test_the_errors_of_an_esp301_are_left_in_its_queue() -> None:
    def answer(line: bytes) -> bytes:
        link.send(line)
        return link.receive(100, 2.0)

    with twin("rate_table", "newport_esp301")(machine_of("rate_table"), over_tcp=True) as running:
        link = byte_link(running.address)
        link.open(2.0)
        link.send(b"9XX\r")  # no such command
        link.close()
        asked(running.address)
        link.open(2.0)
        assert answer(b"TE?\r").strip() == b"6"
        assert answer(b"TE?\r").strip() == b"0"
        link.close()


def test_a_gyro_that_accepts_settings_and_sends_nothing_is_asked_for_its_rate() -> None:
    with twin("gyro", "kvh_dsp1760")(machine_of("gyro"), over_tcp=True) as running:
        with driver("gyro", "kvh_dsp1760")(running.address, clock=CLOCK):
            pass  # its driver leaves it so
        (match,), _ = asked(running.address)
    assert (match.model, match.device) == ("kvh_dsp1760", "KVH, accepting settings; set to 1000 Hz")


@pytest.mark.slow
def test_another_unit_number_goes_into_the_options() -> None:
    with SimulatedWatlowF4(machine_of("chamber"), unit_id=7, over_tcp=True) as running:
        assert asked(running.address)[0] == []
        (match,), _ = asked(running.address, unit_id=7)
    assert (match.model, match.options) == ("watlow_f4", {"unit_id": 7})


@pytest.mark.slow
def test_modbus_rtu_behind_a_tcp_port_is_found_and_its_address_says_so() -> None:
    with SimulatedWatlowF4(machine_of("chamber"), over_tcp=True) as running:
        (match,), _ = asked(running.address.replace("socket://", "tcp://"))
        assert match.address == running.address


@pytest.mark.slow
def test_two_questions_without_an_answer_end_the_questions_by_modbus() -> None:
    with server(b"") as address:
        found, exchanges = asked(address)
    assert found == []
    assert {exchange.answer for exchange in exchanges} == {"nothing"}
    places = [exchange.address for exchange in exchanges if exchange.question.startswith("Modbus")]
    assert places == [address] * 2 + [address.replace("tcp://", "socket://")] * 2


@pytest.mark.parametrize("nonsense", [pytest.param(b"\xde\xad\xbe\xef", marks=pytest.mark.slow), b"moo\r\n"])
def test_nonsense_is_shown_and_not_recognised(nonsense: bytes) -> None:
    with server(nonsense) as address:
        found, exchanges = asked(address)
    assert found == []
    assert all(exchange.received.startswith(nonsense) for exchange in exchanges[1:])
    answers = [exchange.answer for exchange in exchanges[2:7]]
    assert answers == ["no complete line" if nonsense[0] > 0x7F else "'moo', not understood"] * 5


def test_an_echo_is_called_one() -> None:
    with server(b"*IDN?\r\n") as address:
        _, exchanges = asked(address)
    assert exchanges[1].answer == "an echo: the device, or a wire between TX and RX, returns what is sent"


def test_where_no_connection_is_made_nothing_is_asked() -> None:
    with pytest.raises(LinkError, match="connection refused"):
        asked("tcp://127.0.0.1:4")


@contextmanager
def only(monkeypatch: pytest.MonkeyPatch, *declarations: ByLine | ByRegisters) -> Iterator[None]:
    with monkeypatch.context() as patched:
        patched.setattr(probe, "known", lambda: [Known("chamber", "theirs", by) for by in declarations])
        yield


def test_a_declaration_that_writes_is_refused_before_anything_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    def writes(link: ModbusLink, _: object) -> str:
        link.write(300, [400])
        return "never"

    machine = machine_of("chamber")
    only_this = only(monkeypatch, ByRegisters(read=writes, certainty="certain"))
    with SimulatedWatlowF4(machine, over_tcp=True) as running, only_this:
        machine.commanded.clear()
        with pytest.raises(UsageError, match="a probe only reads"):
            asked(running.address)
    assert machine.commanded == []


def test_a_register_that_two_drivers_ask_for_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def reads(link: ModbusLink, _: object) -> str:
        return f"{link.read(300)[0]}"

    twice = [ByRegisters(read=reads, certainty="possible"), ByRegisters(read=reads, certainty="likely")]
    with SimulatedWatlowF4(machine_of("chamber"), over_tcp=True) as running, only(monkeypatch, *twice):
        found, exchanges = asked(running.address)
    assert [match.certainty for match in found] == ["likely", "possible"]
    assert [exchange.question for exchange in exchanges] == ["Modbus unit 1: register 300"]


@pytest.mark.slow
def test_an_f4_that_is_set_to_fahrenheit_is_recognised_and_that_is_said() -> None:
    words = {606: 1, 901: 0, 602: 0, 603: 900, 100: 734}
    registers = RegisterTable([word(address, lambda held=held: held) for address, held in words.items()])
    with ModbusRtuServer(registers, unit_id=1, over_tcp=True) as running:
        (match,), _ = asked(running.address)
    assert (match.model, match.device) == ("watlow_f4", "Watlow F4; air 73.4 °F; it must be set to °C")


@pytest.mark.slow
def test_registers_that_hold_only_zeros_are_no_chamber() -> None:
    registers = RegisterTable([], memory=dict.fromkeys(range(0x10000), 0))
    with ModbusRtuServer(registers, unit_id=1, over_tcp=True) as running:
        found, exchanges = asked(running.address)
    assert found == []
    assert "0, 0" in [exchange.answer for exchange in exchanges]


def test_a_driver_of_another_package_that_cannot_be_loaded_is_reported_and_left_out(
    site: Path, caplog: pytest.LogCaptureFixture
) -> None:
    theirs = {"chamber.sound": "sound_chamber:Driver", "chamber.broken": "broken_chamber:Driver"}
    sound = """
from benchctl_instruments.recognition import ByLine
class Driver:
    recognition = (ByLine(query="WHO", read=lambda line: f"the {line}"),)
"""
    modules = {"sound_chamber": sound, "broken_chamber": "import nothing_of_that_name\n"}
    install(site, "theirs", {"benchctl.instruments": theirs}, modules)
    declared = [(each.model, each.by) for each in probe.known() if each.model in ("sound", "broken")]
    (record,) = caplog.records
    assert "chamber.broken = broken_chamber:Driver: cannot be loaded" in record.getMessage()
    ((model, by),) = declared
    assert (model, isinstance(by, ByLine)) == ("sound", True)
    with server(b"FROSTBOX\r\n") as address:
        (match,), _ = asked(address)
    assert (match.model, match.certainty, match.device) == ("sound", "likely", "the FROSTBOX")
