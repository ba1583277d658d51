"""Links through PyVISA, on the resources of PyVISA-sim."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest

from benchctl_instruments.errors import LinkError, UsageError
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.links.lines import LineDialogue, Manners, NoAnswerError
from benchctl_instruments.links.modbus import ModbusLink
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.links.tcp import LinkCutError, TcpLink
from benchctl_instruments.links.visa import VisaLink
from benchctl_instruments.simulated.clock import ScaledClock
from tests.instruments.wire_transcript import Transcript

pytest.importorskip("pyvisa_sim", reason="PyVISA-sim is not installed: pip install pyvisa-sim")

METERS = r"""
spec: "1.1"
devices:
  meter:
    eom:
      GPIB INSTR: {q: "\r\n", r: "\n"}
      TCPIP SOCKET: {q: "\r\n", r: "\n"}
    dialogues:
      - {q: "*IDN?", r: "SIMULATED,METER,1,0"}
      - {q: "*RST"}
    properties:
      rate:
        default: 1.0
        getter: {q: "RATE?", r: "{:.3f}"}
        setter: {q: "RATE {:.3f}"}
        specs: {min: 0, max: 100, type: float}
resources:
  GPIB0::7::INSTR: {device: meter}
  TCPIP0::127.0.0.1::5025::SOCKET: {device: meter}
"""


@pytest.fixture(autouse=True)
def simulated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "meters.yaml"
    file.write_text(METERS, encoding="ascii")
    monkeypatch.setenv("PYVISA_LIBRARY", f"{file}@sim")


def dialogue(address: str, transcript: Transcript) -> LineDialogue:
    link = byte_link(address, wire_log=transcript.log)
    return LineDialogue("meter", link, manners=Manners(commands_answered=False, timeout_s=0.2), clock=ScaledClock())


@pytest.mark.parametrize("address", ["visa://GPIB0::7::INSTR", "visa://TCPIP0::127.0.0.1::5025::SOCKET"])
def test_a_driver_that_speaks_in_lines_reaches_a_visa_resource(address: str) -> None:
    transcript = Transcript()
    meter = dialogue(address, transcript)
    meter.open()
    assert meter.ask("*IDN?") == "SIMULATED,METER,1,0"
    assert meter.tell("RATE 12.500") == ""
    assert meter.ask("RATE?") == "12.500"
    meter.close()
    meter.close()
    sent = [bytes.fromhex(line[2:]) for line in transcript.lines]
    assert sent == [b"*IDN?\r\n", b"SIMULATED,METER,1,0\n", b"RATE 12.500\r\n", b"RATE?\r\n", b"12.500\n"]


def test_silence_is_an_error_after_the_time_out_and_the_next_question_is_answered() -> None:
    meter = dialogue("visa://GPIB0::7::INSTR", Transcript())
    meter.open()
    began_s = time.monotonic()
    with pytest.raises(NoAnswerError, match=r"meter at visa://GPIB0::7::INSTR: sent '\*RST', no answer within 0\.2 s"):
        meter.ask("*RST")
    assert time.monotonic() - began_s >= 0.4  # a query is asked twice
    assert meter.ask("*IDN?") == "SIMULATED,METER,1,0"
    meter.close()


def test_a_resource_that_is_not_there_cannot_be_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    """With PyVISA-py, on a computer without GPIB, or with nothing on it, and without such a device on USB."""
    pytest.importorskip("pyvisa_py", reason="PyVISA-py is not installed: pip install pyvisa-py")
    monkeypatch.setenv("PYVISA_LIBRARY", "@py")
    for address in ("visa://GPIB0::8::INSTR", "visa://USB0::0x1::0x2::3::INSTR"):
        link = VisaLink(address)
        with pytest.raises(LinkError, match=rf"^{address}: cannot be opened: .*; check that the instrument"):
            link.open(0.2)
        with pytest.raises(UsageError, match=r"the link is not open; call open\(\) first"):
            link.send(b"*IDN?\r\n")


def test_nothing_is_received_from_a_resource_that_was_given_up() -> None:
    link = VisaLink("visa://GPIB0::7::INSTR")
    link.open(0.2)
    link.cut("given up")
    with pytest.raises(LinkCutError, match="the resource was given up, nothing can be received; send first"):
        link.receive(64, 0.2)
    link.send(b"*IDN?\r\n")
    assert link.receive(64, 0.2) == b"SIMULATED,METER,1,0\n"
    link.close()


def test_without_pyvisa_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvisa", None)
    with pytest.raises(UsageError, match=r"needs PyVISA, which is not installed: pip install 'benchctl\[visa\]'"):
        VisaLink("visa://GPIB0::7::INSTR").open(1.0)


@pytest.mark.parametrize(("text", "gpib"), [("visa://GPIB0::7::INSTR", True), ("visa://USB0::1::2::3::INSTR", False)])
def test_an_address_of_visa_names_its_resource(text: str, gpib: bool) -> None:
    address = parse_address(text)
    assert (address.scheme, address.device, address.is_gpib) == ("visa", text.removeprefix("visa://"), gpib)
    for wrong in ("visa://", "visa://GPIB0", "visa://GPIB0:: 7"):
        with pytest.raises(UsageError, match="the VISA resource is missing, or is none; expected tcp://HOST:PORT"):
            parse_address(wrong)


def test_links_without_lines_refuse_visa() -> None:
    for make in (TcpLink, ModbusLink):
        with pytest.raises(UsageError, match="address 'visa://GPIB0::7::INSTR': "):
            make("visa://GPIB0::7::INSTR")
