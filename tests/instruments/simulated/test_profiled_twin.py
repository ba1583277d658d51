"""The simulated controller that a profile makes, with the driver that the same profile makes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from benchctl_instruments.catalog import driver
from benchctl_instruments.chambers.profile import changed, parse_profile, shipped_profile
from benchctl_instruments.chambers.profiled import ProfiledChamber
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.simulated.bench import SimulatedBench
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.profiled import SimulatedProfiled
from benchctl_instruments.simulated.settings import WorldSettings
from tests.instruments.chamber_machine import FakeChamber, InstantClock
from tests.instruments.chambers.lab_controllers import ACME, BRAND

SHIPPED = ("binder_mb1", "binder_mb2", "csz_ezt430i", "eurotherm_2400", "eurotherm_3500")
LABS = {"acme": ACME, "brand": BRAND}
BIT = {"switch": {"by": "bit", "address": 90, "bit": 4, "on": 0}}
SHOWN_BIT = {"switch": {"by": "bit", "address": 90, "shown": 91, "bit": 4}}


@contextmanager
def both(machine: FakeChamber, text: str, **changes: Any) -> Iterator[tuple[ProfiledChamber, SimulatedProfiled]]:
    profile = changed(parse_profile(text, "lab.toml"), changes, "changes")
    with (
        SimulatedProfiled(machine, profile=profile) as twin,
        ProfiledChamber(twin.address, profile=profile, clock=InstantClock(), timeout_s=0.3) as chamber,
    ):
        yield chamber, twin


@pytest.mark.parametrize("name", [*SHIPPED, *LABS])
def test_every_profile_is_consistent_in_itself(name: str) -> None:
    machine = FakeChamber()
    profile = shipped_profile(name) if name in SHIPPED else parse_profile(LABS[name], name)
    with (
        SimulatedProfiled(machine, profile=profile) as twin,
        ProfiledChamber(twin.address, profile=profile, clock=InstantClock()) as chamber,
    ):
        chamber.set_limits(-35.0, 120.0)
        chamber.go_to(-12.0)
        chamber.start()
        assert (machine.on, machine.setpoint) == (True, -12.0)
        chamber.go_to(60.0)
        machine.air = 59.0
        reading = chamber.read()
        assert (reading.temperature_c, reading.setpoint_c, reading.alarms) == (59.0, 60.0, ())
        chamber.stop()
        assert not machine.on


@pytest.mark.parametrize("changes", [BIT, SHOWN_BIT])
def test_a_bit_is_switched_and_the_others_stay(changes: dict[str, Any]) -> None:
    machine = FakeChamber()
    with both(machine, BRAND, **changes) as (chamber, twin):
        shown = changes["switch"].get("shown", 90)
        twin.words[shown] |= 0x0105
        seen = []
        for switch in (chamber.start, chamber.stop):
            switch()
            seen.append(machine.on)
        assert seen == [True, False]
        assert twin.words[shown] & ~0x10 == 0x0105


def test_a_chamber_with_nothing_wired_conditions_from_the_start() -> None:
    machine = FakeChamber()
    with both(machine, BRAND, switch={"by": "nothing"}) as (chamber, _):
        chamber.stop()
    assert machine.on


def test_a_set_point_waits_for_its_run_command() -> None:
    machine = FakeChamber()
    with both(machine, ACME) as (chamber, _):
        chamber.go_to(50.0)
        assert machine.setpoint == 20.0
        chamber.start()
        assert machine.setpoint == 50.0


def test_conditions_are_set_by_hand_and_a_latched_one_is_cleared_by_its_command() -> None:
    machine = FakeChamber()
    with both(machine, ACME) as (chamber, twin):
        twin.words[570] = 1
        assert chamber.read().alarms[0].startswith("safety: compressor pressure (latched")
        chamber._link.write(571, [1])
        assert chamber.read().alarms == ()
        twin.words[572] = 1
        with pytest.raises(InstrumentError, match="no valid temperature, input is open"):
            chamber.read()


def test_a_set_point_beyond_its_limits_is_refused() -> None:
    machine = FakeChamber()
    with both(machine, BRAND) as (chamber, _):
        chamber.set_limits(-40.0, 170.0)
        with pytest.raises(InstrumentError, match="refused with exception 3"):
            chamber.go_to(165.0)
    assert machine.setpoint == 20.0


def test_a_simulated_bench_takes_the_path_of_a_profile(tmp_path: Path) -> None:
    file = tmp_path / "acme_9.toml"
    file.write_text(ACME, encoding="utf-8")
    clock = VirtualClock()
    models: dict[str, Any] = {"rate_table": "acutrol3000", "chamber": str(file), "digitizer": "labjack_t7"}
    with (
        SimulatedBench(WorldSettings(), clock, **models) as bench,
        driver("chamber", str(file))(bench.addresses["chamber"], clock=clock) as chamber,
    ):
        chamber.go_to(43.0)
        chamber.start()
        clock.sleep(1800.0)
        reading = chamber.read()
    assert reading.temperature_c == pytest.approx(43.0, abs=0.1)
    assert reading.power_percent > 5.0
