"""The ACUTROL3000's driver on GPIB: replies without a header, only to queries, and the status byte after commands."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchctl_instruments.errors import InstrumentError, LinkError
from benchctl_instruments.interfaces import RateTable, TableLimits, TableState
from benchctl_instruments.physics.table import TableParameters
from benchctl_instruments.rate_tables.acutrol3000 import Acutrol3000
from benchctl_instruments.simulated.acutrol3000 import AcutrolController
from benchctl_instruments.simulated.clock import ScaledClock, VirtualClock
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World
from tests.instruments.wire_transcript import Transcript

pytest.importorskip("pyvisa", reason="PyVISA is not installed: pip install pyvisa")

from pyvisa.constants import StatusCode

from tests.instruments.links.gpib import GpibController, on_gpib

ADDRESS = "visa://GPIB1::1::INSTR"


class OnGpib:
    """A controller that answers queries without a header; `refuses` is its status byte after a command."""

    def __init__(self, controller: AcutrolController) -> None:
        self.controller, self.refuses = controller, 0

    def __call__(self, line: str) -> str | None:
        answer = self.controller.execute(line)
        if line == "*stb?":
            return str(int(answer) | self.refuses)
        return answer if "?" in line else None


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def acl(clock: VirtualClock) -> OnGpib:
    parameters = TableParameters(rate_limit_dps=1000.0, acceleration_limit_dps2=8300.0)
    return OnGpib(AcutrolController(World(clock, WorldSettings(table=parameters)).table))


@pytest.fixture
def gpib(monkeypatch: pytest.MonkeyPatch, acl: OnGpib) -> GpibController:
    return on_gpib(monkeypatch, acl)


def test_a_table_on_gpib_turns_swings_and_stops(gpib: GpibController, clock: VirtualClock) -> None:
    with Acutrol3000(ADDRESS, clock=clock) as acutrol:
        table: RateTable = acutrol
        assert gpib.opened == ["GPIB1::1::INSTR"]
        table.set_limits(TableLimits(rate_dps=300.0, acceleration_dps2=1500.0))
        table.enable()
        table.go_to_rate(20.0)
        clock.sleep(2.0)
        assert (table.state(), table.read().rate_dps) == (TableState.MOVING, pytest.approx(20.0, abs=0.01))
        table.oscillate(10.0, 1.0)
        clock.sleep(5.0)
        table.stop()
        clock.sleep(2.0)
        assert table.state() is TableState.AT_REST
        table.disable()
        assert table.state() is TableState.DISABLED


def test_each_command_is_followed_by_the_status_byte_and_read_back(gpib: GpibController, clock: VirtualClock) -> None:
    with Acutrol3000(ADDRESS, clock=clock) as table:
        table.enable()
        gpib.wire.clear()
        table.go_to_rate(-20.0)
        table.read()
    assert gpib.wire == [
        "> :dem:rate 1,-20.000000",
        "> *stb?",
        "< 0",
        "> :dem:rate? 1",
        "< -20.000000",
        "> :mode? 1",
        "< Rate",
        "> :mode? 1",
        "< Rate",
        "> :interlock? 1",
        "< Closed",
        "> :mode? 1",
        "< Rate",
        "> :read:pos? 1;rate? 1;acc? 1",
        gpib.wire[-1],
    ]
    assert len(gpib.wire[-1].removeprefix("< ").split(";")) == 3


def test_a_command_that_the_status_byte_refuses_is_an_error(
    gpib: GpibController, acl: OnGpib, clock: VirtualClock
) -> None:
    with Acutrol3000(ADDRESS, clock=clock) as table:
        table.enable()
        acl.refuses = 32
        with pytest.raises(
            InstrumentError, match=r"sent ':dem:rate 1,20\.000000', expected OK, got 'status byte 32'; no fault is rep"
        ):
            table.go_to_rate(20.0)


def test_a_fault_of_the_interlock_is_a_fault_and_no_refusal(
    gpib: GpibController, acl: OnGpib, clock: VirtualClock
) -> None:
    with Acutrol3000(ADDRESS, clock=clock) as table:
        table.enable()
        acl.controller.open_interlock()
        assert table.state() is TableState.FAULT
        with pytest.raises(InstrumentError, match="interlock Fault, mode ABORT, status byte 65; remove the cause"):
            table.go_to_rate(20.0)
        acl.controller.close_interlock()
        table.enable()
        assert table.state() is TableState.AT_REST


def test_after_silence_a_device_clear_drops_the_late_reply(gpib: GpibController, clock: VirtualClock) -> None:
    with Acutrol3000(ADDRESS, clock=clock) as table:
        gpib.wire.clear()
        gpib.fails = [StatusCode.error_timeout]  # the reply stays in the controller
        assert table.state() is TableState.DISABLED
        assert gpib.wire[:4] == ["> :interlock? 1", "clear", "> :interlock? 1", "< Open"]
        gpib.fails = [StatusCode.error_connection_lost, StatusCode.error_connection_lost]
        with pytest.raises(LinkError, match=r"rate table at visa://GPIB1::1::INSTR: sent ':interlock\? 1', and the"):
            table.state()


ACUTROL = r"""
spec: "1.1"
devices:
  acutrol:
    delimiter: "|"
    eom:
      GPIB INSTR: {q: "\r\n", r: "\n"}
    dialogues:
      - {q: "*idn?", r: "Acutronic,ACUTROL3000,17,2.1"}
      - {q: "*stb?", r: "0"}
      - {q: ":interlock? 1", r: "Closed"}
      - {q: ":mode? 1", r: "Rate"}
      - {q: ":read:pos? 1;rate? 1;acc? 1", r: "-12.5;20.0;0.25"}
    properties:
      rate:
        default: 0.0
        getter: {q: ":dem:rate? 1", r: "{:.4f}"}
        setter: {q: ":dem:rate 1,{:.6f}"}
        specs: {min: -1000, max: 1000, type: float}
resources:
  GPIB1::1::INSTR: {device: acutrol}
"""


def test_a_table_on_gpib_is_commanded_byte_for_byte_through_pyvisa_sim(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyvisa_sim", reason="PyVISA-sim is not installed: pip install pyvisa-sim")
    file = tmp_path / "acutrol.yaml"
    file.write_text(ACUTROL, encoding="ascii")
    monkeypatch.setenv("PYVISA_LIBRARY", f"{file}@sim")
    transcript = Transcript()
    with Acutrol3000(ADDRESS, clock=ScaledClock(), wire_log=transcript.log) as table:
        transcript.lines.clear()
        assert table.identify().serial == "17"
        table.go_to_rate(20.0)
        reading = table.read()
    assert (reading.angle_deg, reading.rate_dps, reading.acceleration_dps2) == (347.5, 20.0, 0.25)
    said = [f"{line[0]} {bytes.fromhex(line[2:]).decode()!r}" for line in transcript.lines]
    assert said == [
        r"> '*idn?\r\n'",
        r"< 'Acutronic,ACUTROL3000,17,2.1\n'",
        r"> ':dem:rate 1,20.000000\r\n'",
        r"> '*stb?\r\n'",
        r"< '0\n'",
        r"> ':dem:rate? 1\r\n'",
        r"< '20.0000\n'",
        *[r"> ':mode? 1\r\n'", r"< 'Rate\n'"] * 2,
        r"> ':interlock? 1\r\n'",
        r"< 'Closed\n'",
        r"> ':mode? 1\r\n'",
        r"< 'Rate\n'",
        r"> ':read:pos? 1;rate? 1;acc? 1\r\n'",
        r"< '-12.5;20.0;0.25\n'",
    ]
