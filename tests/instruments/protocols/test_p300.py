from __future__ import annotations

import contextlib
import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.errors import UsageError
from benchctl_instruments.protocols import p300
from benchctl_instruments.protocols.p300 import (
    Request,
    Temperatures,
    UnreadableError,
    addressed,
    data_line,
    is_accepted,
    parse_request,
    parse_settings,
    read_accepted,
    read_alarms,
    read_heater,
    read_mode,
    read_temperatures,
    read_type,
    refusal,
    refusal_words,
    set_mode,
    set_temperatures,
)

READERS: tuple[Callable[[str], object], ...] = (
    read_temperatures,
    read_mode,
    read_alarms,
    read_type,
    read_heater,
)
CELSIUS = st.floats(-200.0, 400.0)


def test_commands_are_worded_as_the_makers_library_words_them() -> None:
    assert set_temperatures(setpoint_c=25.0) == "TEMP, S25.0"
    assert set_temperatures(setpoint_c=25, high_c=130, low_c=-45) == "TEMP, S25.0 H130.0 L-45.0"
    assert set_temperatures(setpoint_c=-0.04) == "TEMP, S0.0"
    assert set_mode(p300.CONSTANT) == "MODE,CONSTANT"
    assert addressed("TEMP?", 3) == "3,TEMP?"
    assert addressed("TEMP?", None) == "TEMP?"


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_a_temperature_that_is_no_number_is_never_sent(wrong: float) -> None:
    with pytest.raises(UsageError, match="give finite numbers"):
        set_temperatures(setpoint_c=20.0, high_c=wrong)


@pytest.mark.parametrize(
    ("line", "setpoint_c"),
    [("27.0,50.0,185.0,-90.0", 50.0), ("27.0, 50.0, 185.0, -90.0", 50.0), ("27, OFF ,185,-90", None)],
)
def test_temperatures_are_read(line: str, setpoint_c: float | None) -> None:
    assert read_temperatures(line) == Temperatures(air_c=27.0, setpoint_c=setpoint_c, high_c=185.0, low_c=-90.0)


def test_modes_and_alarms_are_read() -> None:
    assert [read_mode(word) for word in ("OFF", "standby", "CONSTANT", "RUN", "RUN  END HOLD")] == [
        "OFF",
        "STANDBY",
        "CONSTANT",
        "RUN",
        "RUN END HOLD",
    ]
    assert (read_alarms("0"), read_alarms("2,1, 12")) == ((), (1, 12))


def test_the_controllers_name_and_its_heater_are_read() -> None:
    assert (read_type("T,SCP220,190.0"), read_type("T,T,S2,160.0")) == ("SCP220", "S2")
    assert (read_heater("1,0.0"), read_heater("2, 45.5, 12.0")) == (0.0, 45.5)


@pytest.mark.parametrize(
    ("read", "line", "expected"),
    [
        (read_temperatures, "hello", "expected air, set point, high and low alarm, got 'hello'"),
        (read_temperatures, "27.0,50.0,185.0", "got '27.0,50.0,185.0'"),
        (read_temperatures, "-----,50.0,185.0,-90.0", "got '-----,50.0"),
        (read_temperatures, "nan,50.0,185.0,-90.0", "got 'nan"),
        (read_temperatures, "27.0,,185.0,-90.0", "got '27.0,,185"),
        (read_temperatures, "1e99,50.0,185.0,-90.0", "got '1e99"),
        (read_mode, "ASLEEP", "expected a mode, got 'ASLEEP'"),
        (read_alarms, "-1", "number of alarms"),
        (read_alarms, "2,1", "expected the number of alarms and their codes, got '2,1'"),
        (read_alarms, "", "got ''"),
        (read_type, "T,SCP220", "sensors, controller and highest set point"),
        (read_type, "T,SCP220,high", "sensors, controller and highest set point"),
        (read_heater, "2,10.0", "the number of outputs"),
        (read_heater, "2,10.0,x", "the number of outputs"),
        (read_alarms, "x" * 500, "got 'x{64}'$"),
    ],
)
def test_an_answer_that_is_none_is_named_with_what_was_expected(
    read: Callable[[str], object], line: str, expected: str
) -> None:
    with pytest.raises(UnreadableError, match=expected):
        read(line)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("NA:DATA OUT OF RANGE", "DATA OUT OF RANGE"),
        ("NA: CHB NOT READY", "CHB NOT READY"),
        ("na:CMD_ERR", "CMD ERR"),
        ("NA", ""),
        ("OK:TEMP, S25.0", None),
        ("27.0,50.0,185.0,-90.0", None),
        ("NAPLES", None),
    ],
)
def test_refusals_are_told_from_answers(line: str, reason: str | None) -> None:
    assert refusal(line) == reason


def test_every_reason_of_a_refusal_has_words() -> None:
    assert refusal_words("PROTECT ON") == "settings are protected at its panel; lift the protection there"
    assert refusal_words("PRGM WRITE ERR-14") == "a program cannot be written in that way"
    assert refusal_words("TEA TIME") == "see the chamber's manual"
    assert set(p300.PASSING_REFUSALS) < set(p300.REFUSALS)


def test_what_answers_a_command_and_is_no_ok_is_named() -> None:
    read_accepted("OK:TEMP,S25")
    with pytest.raises(UnreadableError, match="expected OK, got 'FINE'"):
        read_accepted("FINE")


def test_ok_is_accepted_with_and_without_an_echo() -> None:
    assert [is_accepted(line) for line in ("OK", "OK:TEMP,S25", "ok:MODE", "NA:CMD ERR", "27.0")] == [
        True,
        True,
        True,
        False,
        False,
    ]


@pytest.mark.parametrize(
    ("line", "request_"),
    [
        ("TEMP?", (None, "TEMP", True, ())),
        ("3, temp?", (3, "TEMP", True, ())),
        ("MODE?,DETAIL", (None, "MODE", True, ("DETAIL",))),
        ("TEMP, S25.0 H130.0 L-45.0", (None, "TEMP", False, ("S25.0 H130.0 L-45.0",))),
        ("POWER,off", (None, "POWER", False, ("OFF",))),
        ("RELAY,ON,1,2", (None, "RELAY", False, ("ON", "1", "2"))),
        ("PRGM  MON?", (None, "PRGM MON", True, ())),
        ("%?", (None, "%", True, ())),
        ("17", (None, "17", False, ())),
        ("", (None, "", False, ())),
    ],
)
def test_requests_seen_in_the_field_are_understood(
    line: str, request_: tuple[int | None, str, bool, tuple[str, ...]]
) -> None:
    address, name, query, parameters = request_
    assert parse_request(line) == Request(address=address, name=name, query=query, parameters=parameters)


@pytest.mark.parametrize(
    ("parameters", "found"),
    [
        (("S25",), {"S": 25.0}),
        (("S25.0 H130.0 L-45.0",), {"S": 25.0, "H": 130.0, "L": -45.0}),
        (("S25.0", "H130.0"), {"S": 25.0, "H": 130.0}),
        (("SOFF",), None),
        (("S25.0 S26.0",), None),
        (("S25.0 and more",), None),
        (("25.0",), None),
        (("SNAN",), None),
        ((), None),
    ],
)
def test_the_settings_of_a_temperature_command_are_read(
    parameters: tuple[str, ...], found: dict[str, float] | None
) -> None:
    assert parse_settings(parameters) == found


@settings(deadline=None)
@given(CELSIUS, CELSIUS, CELSIUS)
def test_temperatures_arrive_to_the_nearest_tenth(setpoint_c: float, high_c: float, low_c: float) -> None:
    request = parse_request(addressed(set_temperatures(setpoint_c=setpoint_c, high_c=high_c, low_c=low_c), 12))
    found = parse_settings(request.parameters)
    assert found == {letter: p300.tenths(c) for letter, c in (("S", setpoint_c), ("H", high_c), ("L", low_c))}
    assert request.address == 12
    assert abs(found["S"] - setpoint_c) <= 0.0500001


@settings(deadline=None)
@given(CELSIUS, CELSIUS, st.lists(st.integers(0, 99), max_size=6))
def test_what_a_controller_writes_is_what_a_driver_reads(air_c: float, setpoint_c: float, codes: list[int]) -> None:
    read = read_temperatures(data_line(air_c, setpoint_c, 180.0, -75.0))
    assert (read.air_c, read.setpoint_c) == (p300.tenths(air_c), p300.tenths(setpoint_c))
    assert read_alarms(data_line(len(codes), *codes)) == tuple(codes)


@settings(deadline=None, max_examples=300)
@given(st.text() | st.text("0123456789.,- STANDBYRUOFCKE:SHL%?", max_size=60))
def test_no_text_breaks_a_reader(text: str) -> None:
    for read in READERS:
        with contextlib.suppress(UnreadableError):
            assert read(text) is not None
    assert "," not in parse_request(text).name
    assert parse_settings((text,)) != {}
    assert not (is_accepted(text) and refusal(text) is not None)
