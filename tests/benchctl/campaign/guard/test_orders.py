import datetime
import json
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from benchctl.campaign.guard.orders import Orders, Reached

VALUES = st.recursive(
    st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


def orders(options: dict[str, object]) -> Orders:
    return Orders(
        runner=4711,
        journal=Path("/somewhere/Überdruck/journal.jsonl"),
        time_factor=1.0,
        rest_within_s=5.8,
        safe_c=23.0,
        rate_table=Reached(model="acutrol3000", address="tcp://x:1", options=options, locks=["/l/a.lock", "/l/b.lock"]),
        chamber=Reached(model="watlow_f4t", address="tcp://x:2", options={}, locks=["/l/c.lock"]),
    )


@given(options=st.dictionaries(st.text(), VALUES, max_size=4))
def test_orders_are_one_line_and_come_back_as_they_were(options: dict[str, object]) -> None:
    line = orders(options).as_line()
    assert "\n" not in line
    assert Orders.from_line(line) == orders(options)


def test_a_date_among_the_options_of_a_driver_goes_as_text() -> None:
    line = orders({"since": datetime.date(2026, 11, 21)}).as_line()
    assert json.loads(line)["rate_table"]["options"] == {"since": "2026-11-21"}
