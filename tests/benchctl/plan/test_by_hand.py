"""Steps that a person does: what they say of themselves, what is wrong with them, how they are written down."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchctl.plan import Mount, Plan, PowerCycle, Static, Step, procedure
from benchctl.plan.find import find_procedure
from benchctl.plan.steps import ByHand, Polled, faults, positions
from benchctl.plan.written import plan_source

ACROSS, ALONG, REST = Mount(position="across"), Mount(position="along"), Static(duration_s=1.0)


def test_they_are_told_apart_from_what_the_bench_does_and_stream_nothing() -> None:
    for step in (PowerCycle(), ACROSS):
        assert isinstance(step, ByHand)
        assert isinstance(step, Polled)
        assert (step.streamed_s, step.peak_rate_dps, step.peak_acceleration_dps2) == (0.0, 0.0, 0.0)
    assert not isinstance(REST, Polled)
    assert [(step.kind, step.label) for step in (PowerCycle(), ACROSS, ALONG)] == [
        ("power_cycle", "power cycle"),
        ("mount", "mount across"),
        ("mount", "mount along"),
    ]
    assert PowerCycle().off_s == 60.0


@pytest.mark.parametrize(
    ("make", "error", "says"),
    [
        (lambda: Mount(position="upside down"), ValueError, "position is 'upside down', expected one of .*'across'"),  # type: ignore[arg-type]
        (lambda: Mount(position=1), ValueError, "position is 1"),  # type: ignore[arg-type]
        (lambda: PowerCycle(off_s="long"), TypeError, "off_s is 'long', expected a number"),  # type: ignore[arg-type]
        (lambda: Static(duration_s=1.0, role="across"), ValueError, "role is 'across', expected one of"),  # type: ignore[arg-type]
    ],
)
def test_a_field_of_the_wrong_kind_is_named(make: Any, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        make()


def test_a_supply_that_is_off_for_no_time_is_a_fault() -> None:
    assert list(faults(PowerCycle(off_s=0.0))) == ["off_s is 0, expected more than 0"]
    assert list(faults(PowerCycle(off_s=float("inf")))) == ["off_s is inf, expected a finite number"]
    assert list(faults(ACROSS)) == list(faults(PowerCycle())) == []


def test_a_unit_stays_mounted_until_it_is_mounted_otherwise() -> None:
    steps = (REST, ACROSS, REST, PowerCycle(), ALONG, REST)
    assert list(positions(steps)) == ["along", "across", "across", "across", "along", "along"]


def test_a_plan_with_them_is_written_down_and_read_back_as_it_was(tmp_path: Path) -> None:
    @procedure()
    def remounted() -> Iterator[Step]:
        """Power cycles, and the unit across."""
        yield PowerCycle()
        yield PowerCycle(off_s=3.5)
        yield ACROSS
        yield REST

    plan: Plan = remounted.expand()
    path = tmp_path / "next.py"
    path.write_text(plan_source(plan, "again"), encoding="utf-8")
    assert "yield PowerCycle()\n" in path.read_text()
    assert "yield Mount(position='across')\n" in path.read_text()
    assert find_procedure(str(path)).expand().steps == plan.steps
