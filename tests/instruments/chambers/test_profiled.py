"""A lab's own controllers, driven by profiles that the lab wrote; the controllers know nothing of the profiles."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Lock
from typing import Any

import pytest

from benchctl_instruments.catalog import driver
from benchctl_instruments.chambers.profile import parse_profile
from benchctl_instruments.chambers.profiled import ProfiledChamber
from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Chamber, Identity
from benchctl_instruments.links.modbus import Retry
from benchctl_instruments.protocols.modbus import RtuFraming
from benchctl_instruments.simulated.modbus_server import ModbusRtuServer, ModbusSession
from benchctl_instruments.simulated.serial_line import SerialLine
from tests.instruments.chamber_machine import FakeChamber, InstantClock
from tests.instruments.chambers.lab_controllers import ACME, ACME_WITHOUT_LIMITS, BRAND, Acme9, BrandX

HOW = "(latched; once its cause is gone, write 1 to register 571)"


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture
def acme(machine: FakeChamber) -> Acme9:
    return Acme9(machine)


@pytest.fixture
def brand(machine: FakeChamber) -> BrandX:
    return BrandX(machine)


def chamber_at(address: str, profile: str, **options: Any) -> ProfiledChamber:
    settings: dict[str, Any] = {"timeout_s": 0.3, "retry": Retry(attempts=2, wait_s=0.01)} | options
    return ProfiledChamber(address, profile=parse_profile(profile, "lab.toml"), clock=InstantClock(), **settings)


@pytest.fixture
def on_acme(acme: Acme9) -> Iterator[ProfiledChamber]:
    with ModbusRtuServer(acme, unit_id=7) as server, chamber_at(server.address, ACME) as chamber:
        yield chamber


@pytest.fixture
def on_brand(brand: BrandX) -> Iterator[ProfiledChamber]:
    with ModbusRtuServer(brand, unit_id=1) as server, chamber_at(server.address, BRAND) as chamber:
        yield chamber


def test_a_labs_profile_makes_a_chamber_from_its_path(tmp_path: Path, acme: Acme9, machine: FakeChamber) -> None:
    file = tmp_path / "acme_9.toml"
    file.write_text(ACME, encoding="utf-8")
    make = driver("chamber", str(file))
    with ModbusRtuServer(acme, unit_id=7) as server, make(server.address, clock=InstantClock()) as chamber:
        as_chamber: Chamber = chamber
        assert as_chamber.identify() == Identity(manufacturer="Acme", model="9")
        as_chamber.set_limits(-55.0, 125.0)
        as_chamber.go_to(-12.25)
        as_chamber.start()
        machine.air, machine.power = -11.5, -37.5
        reading = as_chamber.read()
        assert (reading.temperature_c, reading.setpoint_c, reading.power_percent) == (-11.5, -12.25, -37.5)
        as_chamber.stop()
    assert (acme.limits_c, machine.setpoint, machine.on) == ([-55.0, 125.0], -12.25, False)


def test_a_set_point_waits_for_its_run_command_which_comes_when_the_chamber_conditions(
    on_acme: ProfiledChamber, acme: Acme9, machine: FakeChamber
) -> None:
    on_acme.go_to(50.0)
    assert (acme.waiting_c, machine.setpoint) == (50.0, 20.0)
    on_acme.start()
    assert machine.setpoint == 50.0
    on_acme.go_to(60.0)
    assert machine.setpoint == 60.0
    assert on_acme.read().setpoint_c == 60.0


def test_every_register_that_takes_the_set_point_gets_it(on_acme: ProfiledChamber, acme: Acme9) -> None:
    on_acme.go_to(-33.5)
    assert (acme.waiting_c, acme.second_c) == (-33.5, -33.5)


def test_a_set_point_that_the_controller_does_not_take_over_is_found_out(
    on_acme: ProfiledChamber, machine: FakeChamber, monkeypatch: pytest.MonkeyPatch
) -> None:
    on_acme.start()
    monkeypatch.setattr(machine, "set_setpoint", lambda setpoint_c: None)
    with pytest.raises(InstrumentError, match=r"set point taken over \(register 514\) should be 50 °C and still reads"):
        on_acme.go_to(50.0)


def test_nothing_comes_near_a_restricted_range_and_only_the_declared_runs_are_read(
    on_acme: ProfiledChamber, acme: Acme9
) -> None:
    on_acme.set_limits(-20.0, 80.0)
    on_acme.go_to(10.0)
    on_acme.start()
    on_acme.read()
    on_acme.stop()
    assert acme.touched == 0


def test_a_key_is_pressed_only_where_the_state_must_change(on_acme: ProfiledChamber, acme: Acme9) -> None:
    presses = []
    for action in (on_acme.start, on_acme.start, on_acme.stop, on_acme.stop):
        action()
        presses.append(acme.presses)
    assert presses == [1, 1, 2, 2]


class LosesOneAnswer:
    """A session with a controller, in which the answer to each key press goes lost."""

    def __init__(self, acme: Acme9) -> None:
        self._acme = acme
        self._session = ModbusSession(RtuFraming(), acme, unit_id=7, lock=Lock())

    def feed(self, data: bytes) -> bytes:
        presses = self._acme.presses
        answer = self._session.feed(data)
        return b"" if self._acme.presses > presses else answer


def test_a_key_press_whose_answer_goes_lost_is_not_repeated_and_the_next_try_looks_first(
    acme: Acme9, machine: FakeChamber
) -> None:
    with (
        SerialLine(lambda: LosesOneAnswer(acme)) as line,
        chamber_at(line.address, ACME, timeout_s=0.25) as chamber,
    ):
        with pytest.raises(LinkError, match="writing 1 to register 560 came to nothing, tried once: no answer"):
            chamber.start()
        assert (acme.presses, machine.on) == (1, True)
        chamber.start()
        assert (acme.presses, machine.on) == (1, True)


def test_a_key_without_effect_is_found_out_after_one_press(
    on_acme: ProfiledChamber, acme: Acme9, machine: FakeChamber, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "run", lambda on: None)
    with pytest.raises(InstrumentError, match=r"conditioning \(register 561\) should be 1 and still reads 0"):
        on_acme.start()
    assert acme.presses == 1


def test_latched_faults_are_told_with_what_clears_them_refuse_the_start_and_are_never_cleared(
    on_acme: ProfiledChamber, acme: Acme9, machine: FakeChamber
) -> None:
    acme.words[570] = 0b1111
    assert on_acme.read().alarms == (f"safety: compressor pressure {HOW}", f"safety: door open {HOW}")
    with pytest.raises(InstrumentError, match=r"not switched on while it has safety: .* write 1 to register 571"):
        on_acme.start()
    on_acme.go_to(30.0)
    on_acme.stop()
    assert (acme.clearings, acme.presses, machine.on) == (0, 0, False)


@pytest.mark.parametrize(("code", "says"), [(1, "is open"), (2, "is shorted"), (3, "shows code 3")])
def test_an_input_error_is_no_temperature_whatever_the_air_reads(
    on_acme: ProfiledChamber, acme: Acme9, code: int, says: str
) -> None:
    acme.words[572] = code
    with pytest.raises(InstrumentError, match=f"Acme 9 at .*: no valid temperature, input {says}; check the chamber's"):
        on_acme.read()


@pytest.mark.parametrize(
    ("air", "says"),
    [(9999.0, r"reads 9999 \(sensor open\)"), (-9999.0, "sensor shorted"), (float("nan"), r"no number \(NaN\)")],
)
def test_a_code_in_the_airs_register_is_no_temperature(
    on_acme: ProfiledChamber, machine: FakeChamber, air: float, says: str
) -> None:
    machine.air = air
    with pytest.raises(InstrumentError, match=rf"no valid temperature, air temperature \(register 512\) .*{says}"):
        on_acme.read()


@pytest.mark.parametrize(("raw", "says"), [(0x7FFF, "32767 .over range."), (0x8000, "-32768 .under range.")])
def test_a_code_of_whole_numbers_is_meant_before_the_decimal_point(
    on_brand: ProfiledChamber, brand: BrandX, raw: int, says: str
) -> None:
    brand.raw_air = raw
    with pytest.raises(InstrumentError, match=f"no valid temperature, .* reads {says}"):
        on_brand.read()
    brand.raw_air = 3001
    with pytest.raises(InstrumentError, match=r"reads 300\.1 °C, expected -100 to 300"):
        on_brand.read()


def test_a_recipe_is_not_fought_with(on_acme: ProfiledChamber, acme: Acme9) -> None:
    acme.words[573] = 1
    with pytest.raises(InstrumentError, match="would not keep our set point, a recipe runs; end that on its panel"):
        on_acme.start()
    acme.words[573] = 9
    on_acme.start()
    assert acme.presses == 1


def test_a_busy_controller_is_not_written_to(on_acme: ProfiledChamber, acme: Acme9) -> None:
    acme.words[574] = 3
    for action in (on_acme.start, lambda: on_acme.go_to(30.0), lambda: on_acme.set_limits(0.0, 50.0), on_acme.read):
        with pytest.raises(InstrumentError, match=r"busy or offline \(register 574 reads 3\) for more than 2 s"):
            action()
    assert (acme.presses, acme.waiting_c, acme.limits_c) == (0, 20.0, [-70.0, 180.0])


def test_a_busy_controller_is_stopped_all_the_same_where_it_lets_itself_be(
    on_acme: ProfiledChamber, acme: Acme9, machine: FakeChamber
) -> None:
    on_acme.start()
    acme.words[574] = 3
    on_acme.stop()
    assert not machine.on


def test_a_controller_that_is_set_up_wrongly_is_refused_when_it_is_opened(acme: Acme9) -> None:
    acme.words[575] = 0
    with (
        ModbusRtuServer(acme, unit_id=7) as server,
        pytest.raises(
            InstrumentError, match=r"temperature unit \(register 575\) reads 0, expected 1; set it to degrees"
        ),
    ):
        chamber_at(server.address, ACME).open()


def test_limits_that_make_no_sense_are_found_when_it_is_opened(acme: Acme9) -> None:
    acme.limits_c = [180.0, -70.0]
    with (
        ModbusRtuServer(acme, unit_id=7) as server,
        pytest.raises(InstrumentError, match="limits read 180 and -70 °C, low not below high"),
    ):
        chamber_at(server.address, ACME).open()


def test_a_register_that_a_reading_needs_and_is_not_there_is_found_when_it_is_opened(acme: Acme9) -> None:
    del acme.words[572]
    with (
        ModbusRtuServer(acme, unit_id=7) as server,
        pytest.raises(InstrumentError, match="reading register 572 was refused with exception 2"),
    ):
        chamber_at(server.address, ACME).open()


@pytest.mark.parametrize(("decimals", "arrives_c"), [(0, -12.0), (1, -12.3), (2, -12.35)])
def test_the_decimal_point_is_where_the_controller_says(machine: FakeChamber, decimals: int, arrives_c: float) -> None:
    with (
        ModbusRtuServer(BrandX(machine, decimals=decimals), unit_id=1) as server,
        chamber_at(server.address, BRAND) as chamber,
    ):
        chamber.go_to(-12.345678)
        assert machine.setpoint == arrives_c
        assert chamber.read().temperature_c == 23.0


def test_a_decimal_point_that_cannot_be_is_refused(machine: FakeChamber) -> None:
    with (
        ModbusRtuServer(BrandX(machine, decimals=4), unit_id=1) as server,
        pytest.raises(InstrumentError, match="register 20 reads 4, expected 0 to 3 decimals"),
    ):
        chamber_at(server.address, BRAND).open()


def test_no_request_asks_for_more_registers_than_declared(on_brand: ProfiledChamber, brand: BrandX) -> None:
    on_brand.read()
    assert brand.most_asked == 2


def test_cooling_alone_is_negative_power(on_brand: ProfiledChamber, machine: FakeChamber) -> None:
    machine.power = -40.0
    assert on_brand.read().power_percent == -40.0


def test_an_unchanged_set_point_is_not_written_again(on_brand: ProfiledChamber, brand: BrandX) -> None:
    for setpoint_c in (35.0, 35.02, 35.0, -5.0):
        on_brand.go_to(setpoint_c)
    assert brand.setpoint_writes == 2


def test_a_mode_register_counts_by_its_mask_and_the_output_is_set_after_off(
    on_brand: ProfiledChamber, brand: BrandX, machine: FakeChamber
) -> None:
    on_brand.start()
    assert (machine.on, brand.output) == (True, 55)
    on_brand.stop()
    assert (machine.on, brand.output) == (False, 0)


def test_an_output_that_stays_as_it_was_is_told_when_stopping(on_brand: ProfiledChamber, brand: BrandX) -> None:
    on_brand.start()
    brand.output_is_locked = True
    with pytest.raises(
        InstrumentError, match=r"register 31 was refused .*; the code for off is written, yet the output"
    ):
        on_brand.stop()


def test_limits_without_registers_are_kept_by_the_driver(on_brand: ProfiledChamber, machine: FakeChamber) -> None:
    with pytest.raises(UsageError, match="set point 151 °C lies outside the controller's limits -40 to 150 °C"):
        on_brand.go_to(151.0)
    on_brand.set_limits(160.0, 170.0)
    on_brand.go_to(165.0)
    assert machine.setpoint == 165.0
    with pytest.raises(UsageError, match="limits 160 to 170 °C"):
        on_brand.go_to(150.0)


@pytest.mark.parametrize("limit_c", [125.3, 60.06, 0.1, 85.14])
@pytest.mark.parametrize("profile", [BRAND, ACME_WITHOUT_LIMITS], ids=["tenths", "singles"])
def test_a_set_point_may_lie_on_a_kept_limit_that_no_register_states_exactly(
    machine: FakeChamber, limit_c: float, profile: str
) -> None:
    controller, unit_id = (BrandX(machine), 1) if profile == BRAND else (Acme9(machine), 7)
    with ModbusRtuServer(controller, unit_id=unit_id) as server, chamber_at(server.address, profile) as chamber:
        chamber.set_limits(-limit_c, limit_c)
        for setpoint_c in (limit_c, -limit_c):
            chamber.go_to(setpoint_c)
        with pytest.raises(UsageError, match="lies outside the controller's limits"):
            chamber.go_to(limit_c + 0.1)


def test_a_chamber_with_nothing_wired_is_left_as_it_is(brand: BrandX, machine: FakeChamber) -> None:
    with (
        ModbusRtuServer(brand, unit_id=1) as server,
        chamber_at(server.address, BRAND, changes={"switch": {"by": "nothing"}}) as chamber,
    ):
        chamber.start()
        chamber.stop()
    assert machine.switched == 0


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"changes": {"switch": {"bit": 1}}}, "^chamber.options.changes, switch.*bit: there is no such field"),
        (
            {"changes": {"air": {"address": 70000}}},
            "^chamber.options.changes, air.address: expected a number of at most",
        ),
        ({"changes": 5}, "^chamber.options.changes: expected a table with fields of the profile, got 5"),
        ({"word_order": "middle"}, "^chamber.options, transport.word_order: expected 'high_first'"),
        ({"changes": {"kept_limits_c": [5.0, 5.0]}}, "^chamber.options.changes, kept_limits_c: the first .5. must be"),
    ],
)
def test_changes_that_cannot_be_are_named(options: dict[str, Any], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        chamber_at("tcp://localhost:1", BRAND, **options)


def test_changes_take_the_place_of_the_profiles_fields(machine: FakeChamber) -> None:
    acme = Acme9(machine)
    acme.words[576] = 0
    changes = {"input_errors": [{"name": "probe", "address": 576, "otherwise": "is missing"}]}
    with (
        ModbusRtuServer(acme, unit_id=8) as server,
        chamber_at(server.address, ACME, changes=changes, unit_id=8) as chamber,
    ):
        acme.words |= {572: 1, 576: 4}
        with pytest.raises(InstrumentError, match="no valid temperature, probe is missing; check"):
            chamber.read()


def test_what_no_number_can_be_is_refused_before_anything_is_written(on_brand: ProfiledChamber, brand: BrandX) -> None:
    actions: list[Callable[[], None]] = [lambda: on_brand.go_to(float("nan")), lambda: on_brand.go_to(float("inf"))]
    for action in actions:
        with pytest.raises(UsageError, match=r"lies outside|cannot be set"):
            action()
    assert brand.setpoint_writes == 0


def test_an_unsigned_set_point_has_no_temperatures_below_zero(brand: BrandX, machine: FakeChamber) -> None:
    changes = {"setpoint": {"kind": "u16"}, "kept_limits_c": [0.0, 150.0]}
    with (
        ModbusRtuServer(brand, unit_id=1) as server,
        chamber_at(server.address, BRAND, changes=changes) as chamber,
    ):
        says = r"cannot be set to -5 °C: its register \(u16\) does not reach so far"
        with pytest.raises(UsageError, match=says):
            chamber.go_to(-5.0)
        with pytest.raises(UsageError, match=says):
            chamber.set_limits(-5.0, 60.0)
        chamber.go_to(5.0)
    assert machine.setpoint == 5.0
