"""Which requests read which registers, whatever a profile declares."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.chambers.modbus_chamber import WORDS
from benchctl_instruments.chambers.profile import Run, changed, parse_profile
from benchctl_instruments.chambers.profiled_table import ProfiledQuantity, ProfiledTable
from benchctl_instruments.links.modbus import ModbusLink
from tests.instruments.chamber_machine import InstantClock
from tests.instruments.chambers.lab_controllers import BRAND

QUANTITIES = st.lists(
    st.builds(
        ProfiledQuantity,
        name=st.just("q"),
        address=st.integers(0, 40),
        kind=st.sampled_from(["code", "signed", "f32"]),
        decimals=st.just(0),
    ),
    max_size=12,
)
RUNS = st.lists(st.builds(Run, first=st.integers(0, 40), count=st.integers(1, 4)), max_size=3)


@given(quantities=QUANTITIES, runs=RUNS, most_registers=st.integers(4, 9))
def test_requests_bring_every_quantity_whole_and_nothing_that_was_not_declared(
    quantities: list[ProfiledQuantity], runs: list[Run], most_registers: int
) -> None:
    declared = [run.model_dump() for run in runs]
    changes = {"transport": {"most_registers": most_registers, "runs": declared}}
    profile = changed(parse_profile(BRAND, "lab.toml"), changes, "changes")
    table = ProfiledTable(ModbusLink("tcp://localhost:1"), clock=InstantClock(), profile=profile, kept={})
    requests = table._requests(quantities)
    wanted = {place for one in quantities for place in range(one.address, one.address + WORDS[one.kind])}
    for first, count in requests:
        assert count <= most_registers
        whole_run = {"first": first, "count": count} in declared
        assert whole_run or set(range(first, first + count)) <= wanted
    for quantity in quantities:
        end = quantity.address + WORDS[quantity.kind]
        assert any(first <= quantity.address and end <= first + count for first, count in requests)
    assert len(requests) == len(set(requests))
