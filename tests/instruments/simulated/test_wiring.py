"""A simulated instrument is wired as bench.toml tells its driver, or says that it cannot be."""

from __future__ import annotations

import sys
from typing import Any

import pytest

from benchctl_instruments.catalog import Kind, driver, models, twin
from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.bench import BOTH_ENDS, twin_keywords
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.world import World

TTY, BOX, NET = "serial:///dev/ttyUSB0?baud=9600", "socket://10.0.0.7:4001", "tcp://10.0.0.7:502"


@pytest.mark.parametrize(
    ("kind", "model", "options", "expected"),
    [
        ("chamber", "watlow_f4", {"unit_id": 7, "on_event": 3, "timeout_s": 0.5}, {"unit_id": 7, "on_event": 3}),
        ("chamber", "watlow_f4t", {"loop": 2, "on_by": "event"}, {"loop": 2, "on_by": "event"}),
        ("chamber", "espec_p300", {"rs485_address": 3, "pause_s": 0.3}, {"rs485_address": 3}),
        ("chamber", "eurotherm_2400", {"unit_id": 9, "pause_s": 0.1}, {"unit_id": 9}),
        ("digitizer", "labjack_t7", {"encoder_channel": 2, "frozen_s": 1.0}, {"encoder_channel": 2}),
        ("rate_table", "acutrol3000", {"axis": 1, "timeout_s": 0.5}, {}),  # as it is wired anyway
    ],
)
def test_what_both_ends_must_agree_upon_reaches_the_twin_and_nothing_else(
    kind: Kind, model: str, options: dict[str, Any], expected: dict[str, Any]
) -> None:
    assert twin_keywords(kind, model, options=options) == expected


@pytest.mark.parametrize(
    ("kind", "model", "options"),
    [
        ("chamber", "csz_ezt430i", {"changes": {"switch": {"bit": 1}}}),
        ("chamber", "eurotherm_3500", {"word_order": "low_first"}),
        ("rate_table", "aerotech_ensemble", {"clockwise": False}),
        ("rate_table", "newport_esp301", {"clockwise": True}),
    ],
)
def test_what_a_twin_cannot_be_wired_to_is_refused_by_name(kind: Kind, model: str, options: dict[str, Any]) -> None:
    with pytest.raises(UsageError) as refused:
        twin_keywords(kind, model, options=options)
    (name,) = options
    assert str(refused.value).startswith(f"{kind}.options: {name} = ")
    assert f"the simulated {model} cannot be wired so" in str(refused.value)


@pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")
@pytest.mark.parametrize(
    ("kind", "model", "address", "serves"),
    [
        ("chamber", "espec_p300", None, "tcp"),
        ("chamber", "espec_p300", TTY, "serial"),
        ("chamber", "espec_p300", BOX, "tcp"),
        ("chamber", "watlow_f4", None, "serial"),
        ("chamber", "watlow_f4", TTY, "serial"),
        ("chamber", "watlow_f4", BOX, "socket"),
        ("chamber", "binder_mb2", NET, "socket"),
        ("chamber", "watlow_f4t", NET, "tcp"),
        ("chamber", "watlow_f4t", TTY, "serial"),
        ("chamber", "thermotron_3800", None, "serial"),
        ("chamber", "thermotron_8800", None, "tcp"),
        ("chamber", "thermotron_8800", TTY, "serial"),
        ("chamber", "weiss_ascii2", None, "serial"),
        ("chamber", "weiss_ascii2", NET, "tcp"),
        ("chamber", "weiss_simserv", None, "tcp"),
        ("rate_table", "newport_esp301", BOX, "socket"),
        ("digitizer", "labjack_t7", NET, "tcp"),
    ],
)
def test_the_kind_of_line_is_that_of_the_address(kind: Kind, model: str, address: str | None, serves: str) -> None:
    world = World(VirtualClock())
    machines = {"rate_table": world.table, "chamber": world.chamber, "digitizer": world.inputs}
    with twin(kind, model)(machines[kind], **twin_keywords(kind, model, options={}, address=address)) as served:
        assert served.address.partition("://")[0] == serves


def test_a_serial_line_that_a_twin_does_not_have_is_refused() -> None:
    with pytest.raises(UsageError, match=r"^digitizer.address 'serial:.*the simulated labjack_t7 has no serial line"):
        twin_keywords("digitizer", "labjack_t7", options={}, address=TTY)


def test_an_address_of_no_known_kind_is_refused() -> None:
    with pytest.raises(UsageError, match="unknown scheme 'gpib'; expected tcp://HOST:PORT"):
        twin_keywords("chamber", "espec_p300", options={}, address="gpib://7")


def test_a_word_for_both_ends_is_one_that_some_driver_takes() -> None:
    import inspect

    from benchctl_instruments.chambers.profiled import ProfiledChamber

    kinds: tuple[Kind, ...] = ("rate_table", "chamber", "digitizer")
    makers = [driver(kind, model) for kind in kinds for model in models(kind)]
    known = {name for make in (*makers, ProfiledChamber) for name in inspect.signature(make).parameters}
    assert known >= BOTH_ENDS
