"""The F4T driver against its simulated twin, over a real TCP connection."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from benchctl_instruments.chambers.watlow_f4t import WatlowF4T
from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Chamber, Identity
from benchctl_instruments.links.modbus import Retry
from benchctl_instruments.protocols.modbus import WordOrder
from benchctl_instruments.simulated.modbus_server import ModbusTcpServer, RegisterTable, word
from benchctl_instruments.simulated.watlow_f4t import OnBy, SimulatedWatlowF4T
from tests.instruments.chamber_machine import FakeChamber, InstantClock

RUNNING: dict[str, Any] = {"running_output": [1, 1]}


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture
def twin(machine: FakeChamber) -> Iterator[SimulatedWatlowF4T]:
    with SimulatedWatlowF4T(machine) as twin:
        yield twin


def driver_at(
    address: str,
    *,
    unit_id: int = 1,
    loop: int = 1,
    word_order: WordOrder = "low_first",
    **wiring: Any,
) -> WatlowF4T:
    return WatlowF4T(
        address,
        clock=InstantClock(),
        unit_id=unit_id,
        loop=loop,
        word_order=word_order,
        **wiring,
        timeout_s=0.2,
        retry=Retry(attempts=2, wait_s=0.01),
    )


@pytest.fixture
def chamber(twin: SimulatedWatlowF4T) -> Iterator[WatlowF4T]:
    with driver_at(twin.address) as chamber:
        yield chamber


def test_it_is_a_chamber_that_says_its_part_number(chamber: WatlowF4T) -> None:
    as_chamber: Chamber = chamber
    assert as_chamber.identify() == Identity(manufacturer="Watlow", model="F4T1L1EAA1D1AAA")


def test_air_set_point_and_power_are_read(chamber: WatlowF4T, machine: FakeChamber) -> None:
    machine.air, machine.setpoint, machine.power = -40.125, -55.5, -37.5
    reading = chamber.read()
    assert (reading.temperature_c, reading.setpoint_c, reading.power_percent) == (-40.125, -55.5, -37.5)
    assert reading.alarms == ()


def test_air_near_zero_and_hardly_any_power_are_no_nonsense(chamber: WatlowF4T, machine: FakeChamber) -> None:
    machine.air, machine.power = 1e-9, 1e-9
    reading = chamber.read()
    assert (reading.temperature_c, reading.power_percent) == (0.0, 0.0)


@pytest.mark.parametrize("loop", [1, 2, 4])
@pytest.mark.parametrize("word_order", ["low_first", "high_first"])
def test_every_loop_and_word_order_sets_and_reads(machine: FakeChamber, loop: int, word_order: WordOrder) -> None:
    with (
        SimulatedWatlowF4T(machine, loop=loop, word_order=word_order) as twin,
        driver_at(twin.address, loop=loop, word_order=word_order) as chamber,
    ):
        chamber.set_limits(-60.5, 120.25)
        chamber.go_to(-12.3)
        assert machine.setpoint == pytest.approx(-12.3)
        assert chamber.read().setpoint_c == pytest.approx(-12.3)
        with pytest.raises(UsageError, match="set point 121 °C lies outside the controller's limits"):
            chamber.go_to(121.0)


@pytest.mark.parametrize("limit_c", [85.1, 70.2, 22.3])
def test_a_set_point_may_lie_on_a_limit_that_no_single_states_exactly(
    chamber: WatlowF4T, machine: FakeChamber, limit_c: float
) -> None:
    chamber.set_limits(-limit_c, limit_c)
    for setpoint_c in (limit_c, -limit_c):
        chamber.go_to(setpoint_c)
        assert machine.setpoint == pytest.approx(setpoint_c)


@pytest.mark.parametrize(("set_to", "other"), [("low_first", "high_first"), ("high_first", "low_first")])
def test_the_wrong_word_order_is_found_when_it_is_opened_and_the_other_one_named(
    machine: FakeChamber, set_to: WordOrder, other: WordOrder
) -> None:
    with (
        SimulatedWatlowF4T(machine, word_order=set_to) as twin,
        pytest.raises(InstrumentError, match=f"which makes no sense; .* try word_order = '{set_to}'"),
    ):
        driver_at(twin.address, word_order=other).open()


def test_a_loop_that_is_not_there_is_refused(twin: SimulatedWatlowF4T) -> None:
    with pytest.raises(InstrumentError, match="reading registers 2980 to 2981 was refused with exception 2"):
        driver_at(twin.address, loop=2).open()
    with pytest.raises(UsageError, match="loop = 5: expected a loop of a Watlow F4T, 1 to 4"):
        driver_at(twin.address, loop=5)


@pytest.mark.parametrize(
    ("on_by", "wiring"),
    [
        ("toggle_key", {}),
        ("toggle_key", {"on_by": "toggle_key", "on_number": 1, **RUNNING}),
        ("momentary_key", {"on_by": "momentary_key", **RUNNING}),
        ("event", {"on_by": "event"}),
        ("event", {"on_by": "event", **RUNNING}),
    ],
)
def test_conditioning_is_switched_however_it_is_wired_and_only_where_it_must_be(
    machine: FakeChamber, on_by: OnBy, wiring: dict[str, Any]
) -> None:
    with (
        SimulatedWatlowF4T(machine, on_by=on_by) as twin,
        driver_at(twin.address, **wiring) as chamber,
    ):
        for _ in range(2):
            chamber.start()
            assert machine.on
        for _ in range(2):
            chamber.stop()
            assert not machine.on


def test_a_chamber_that_does_not_start_is_found_out_by_its_running_output(machine: FakeChamber) -> None:
    with (
        SimulatedWatlowF4T(machine, on_by="event") as twin,
        driver_at(twin.address, on_by="event", on_number=2, **RUNNING) as chamber,
        pytest.raises(
            InstrumentError, match=r"output 1 of module 1 \(register 33718\) should be 63 and still reads 62"
        ),
    ):
        chamber.start()


def test_a_momentary_key_taken_for_a_toggle_key_is_found_out_with_what_to_give(machine: FakeChamber) -> None:
    with (
        SimulatedWatlowF4T(machine, on_by="momentary_key") as twin,
        driver_at(twin.address, on_by="toggle_key") as chamber,
        pytest.raises(
            InstrumentError,
            match=r"key 1 \(register 6844\) should be 63 .*; the key was pressed, look whether the chamber runs; .*"
            r" give on_by = 'momentary_key' and running_output$",
        ),
    ):
        chamber.start()
    assert machine.on


def test_an_output_that_is_not_fitted_is_named(twin: SimulatedWatlowF4T) -> None:
    with (
        driver_at(twin.address, on_by="momentary_key", running_output=[2, 3]) as chamber,
        pytest.raises(InstrumentError, match=r"reading register 34038 was refused with exception 4 \(device failure\)"),
    ):
        chamber.start()


@pytest.mark.parametrize(
    ("wiring", "said"),
    [
        ({"on_by": "event", "on_number": 9}, r"on_by = 'event' with on_number = 9: expected .*event \(1 to 8\)"),
        ({"on_by": "toggle_key", "on_number": 0}, r"with on_number = 0: .* toggle_key \(1 to 4\)"),
        ({"on_by": "magic"}, "on_by = 'magic'"),
        ({"on_by": "momentary_key"}, "a momentary key needs running_output"),
        ({"word_order": "middle_first"}, "word_order = 'middle_first': expected high_first or low_first"),
    ],
)
def test_a_wiring_that_cannot_be_is_refused(wiring: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        driver_at("tcp://127.0.0.1:502", **wiring)


def test_a_chamber_that_always_conditions_is_left_as_it_is(twin: SimulatedWatlowF4T, machine: FakeChamber) -> None:
    with driver_at(twin.address, on_by="nothing") as chamber:
        chamber.start()
        chamber.stop()
    assert machine.switched == 0


@pytest.mark.parametrize(
    ("state", "doing"), [(149, "runs"), (146, "is paused"), (1783, "waits for its start by the clock")]
)
def test_a_profile_that_runs_is_paused_or_waits_is_not_fought_with(
    chamber: WatlowF4T, twin: SimulatedWatlowF4T, machine: FakeChamber, state: int, doing: str
) -> None:
    twin.profile_state = state
    with pytest.raises(InstrumentError, match=f"a profile {doing} and would not keep our set point; end it on its"):
        chamber.start()
    assert not machine.on
    chamber.stop()


@pytest.mark.parametrize(("over_tcp", "register"), [(True, 6730), (False, 14080)])
def test_a_bus_that_speaks_fahrenheit_is_refused_with_how_to_set_it(
    machine: FakeChamber, over_tcp: bool, register: int
) -> None:
    """As delivered: 85 °F would otherwise be taken for 85 °C. The other line's unit does not matter."""
    with SimulatedWatlowF4T(machine, over_tcp=over_tcp) as twin:
        for unit, shown in ((30, "30 (°F)"), (17, "17")):
            twin.memory.update({6730: 15, 14080: 15, register: unit})
            with pytest.raises(InstrumentError) as refused:
                driver_at(twin.address).open()
            assert f"(register {register}) is code {shown}, expected code 15 (°C); set Display Units" in str(
                refused.value
            )
        twin.memory.update({6730: 30, 14080: 30, register: 15})
        with driver_at(twin.address) as chamber:
            assert chamber.identify().model == "F4T1L1EAA1D1AAA"
            assert chamber.read().temperature_c == 23.0


@pytest.mark.parametrize("alarms", [6, 8, 14])
def test_every_alarm_that_the_part_number_promises_is_told(machine: FakeChamber, alarms: int) -> None:
    with SimulatedWatlowF4T(machine, alarms=alarms) as twin, driver_at(twin.address) as chamber:
        assert chamber.read().alarms == ()
        twin.hold_alarm(alarms, 28)
        assert chamber.read().alarms == (f"alarm {alarms} active, code 28 (error)",)


def test_of_a_part_number_that_is_not_known_the_six_alarms_are_read_that_every_f4t_has() -> None:
    words = {16 + place: ord(letter) for place, letter in enumerate("F4T1L1XAA1D1AAA")}
    words |= {6730: 15, 2774: 0, 2775: 0, 2776: 0, 2777: 0x42C8}  # limits 0 and 100 °C
    words |= dict.fromkeys((2782, 2783, 2808, 2809, 2820, 2821), 0)
    words |= {1356 + 100 * place: 28 for place in range(6)}
    with (
        ModbusTcpServer(RegisterTable([], memory=words), unit_id=1) as server,
        driver_at(server.address) as chamber,
    ):
        assert len(chamber.read().alarms) == 6


def test_a_loop_that_does_not_control_is_found_out(chamber: WatlowF4T, twin: SimulatedWatlowF4T) -> None:
    twin.control_mode = 62
    with pytest.raises(InstrumentError, match=r"the control mode is code 62 \(off\), expected code 10 \(auto\)"):
        chamber.start()


@pytest.mark.parametrize("silent", [12, 61, 88])
def test_alarms_that_are_active_are_told_and_those_that_are_not_are_not(
    chamber: WatlowF4T, twin: SimulatedWatlowF4T, silent: int
) -> None:
    twin.hold_alarm(1, silent)
    twin.hold_alarm(3, 28)
    twin.hold_alarm(4, 17)
    assert chamber.read().alarms == ("alarm 3 active, code 28 (error)", "alarm 4 active, code 17")


def test_a_controller_that_does_not_do_what_it_acknowledged_is_found_out(
    chamber: WatlowF4T, machine: FakeChamber, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "set_setpoint", lambda setpoint_c: None)
    with pytest.raises(InstrumentError, match=r"set point \(register 2782\) should be -5 °C and still reads 20 °C"):
        chamber.go_to(-5.0)


def test_something_else_that_speaks_modbus_is_no_f4t() -> None:
    registers = RegisterTable([word(16 + place, lambda: 0xFFFF) for place in range(15)])
    with (
        ModbusTcpServer(registers, unit_id=1) as server,
        pytest.raises(InstrumentError, match="instead of a part number; check that it is a Watlow F4T"),
    ):
        driver_at(server.address).open()


def test_the_wrong_unit_number_is_silence_that_names_it(twin: SimulatedWatlowF4T) -> None:
    with pytest.raises(
        LinkError, match=r"Watlow F4T at .*, unit 2: reading registers 16 to 30 came to nothing, tried 2 times"
    ):
        driver_at(twin.address, unit_id=2).open()


def test_a_cut_in_the_middle_of_a_campaign_is_bridged(
    chamber: WatlowF4T, twin: SimulatedWatlowF4T, machine: FakeChamber
) -> None:
    chamber.go_to(30.0)
    twin.cut_connections()
    machine.air = 29.5
    assert chamber.read().temperature_c == 29.5
