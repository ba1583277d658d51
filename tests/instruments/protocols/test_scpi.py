from __future__ import annotations

import pytest

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.scpi import (
    ScpiCommand,
    channel_list,
    header_pattern,
    parse_channels,
    parse_commands,
    parse_error,
    parse_numbers,
)


def commands(line: str) -> list[tuple[str, tuple[str, ...]]]:
    return [(command.header, command.arguments) for command in parse_commands(line)]


def test_a_command_after_a_semicolon_continues_at_the_level_of_the_previous_one() -> None:
    """The examples of SCPI-1999, volume 1, 6.2.4: the header path, and common commands, which leave it alone."""
    assert commands("FREQ:STAR 3 MHZ;STOP 5 MHZ") == [("FREQ:STAR", ("3 MHZ",)), ("FREQ:STOP", ("5 MHZ",))]
    assert commands("FREQ:STAR 3 MHZ;:BAND 1 MHZ") == [("FREQ:STAR", ("3 MHZ",)), ("BAND", ("1 MHZ",))]
    assert commands("freq:star 1;*cls;STOP 2") == [("FREQ:STAR", ("1",)), ("*CLS", ()), ("FREQ:STOP", ("2",))]
    assert commands(" ;\t; ") == []


def test_texts_and_lists_of_channels_keep_their_commas_and_semicolons() -> None:
    line = ":SENS:FUNC \"VOLT;DC\", (@101,103:104);:TRAC:DATA? 1, 4, 'defbuffer1', READ"
    assert list(parse_commands(line)) == [
        ScpiCommand(header="SENS:FUNC", arguments=("VOLT;DC", "(@101,103:104)")),
        ScpiCommand(header="TRAC:DATA?", arguments=("1", "4", "defbuffer1", "READ")),
    ]


@pytest.mark.parametrize(
    ("written", "meant", "others"),
    [
        (
            "[SENSe:]VOLTage[:DC]:NPLCycles",
            ("VOLT:NPLC", "VOLTAGE:DC:NPLC", "SENS:VOLT:NPLCYCLES"),
            ("VOLTA:NPLC", "SENSE:NPLC", "VOLT:NPLC?"),
        ),
        ("INITiate[:IMMediate]", ("INIT", "INIT:IMM", "INITIATE:IMMEDIATE"), ("INI", "INIT:")),
        ("*IDN?", ("*IDN?",), ("*IDN", "IDN?", "*IDNN")),
        ("TRACe:DATA?", ("TRAC:DATA?", "TRACE:DATA?"), ("TRAC:DATA",)),
    ],
)
def test_a_mnemonic_has_a_short_and_a_long_form_and_nothing_between(
    written: str, meant: tuple[str, ...], others: tuple[str, ...]
) -> None:
    pattern = header_pattern(written)
    assert [header for header in meant + others if pattern.fullmatch(header)] == list(meant)


def test_lists_of_channels_are_written_and_read() -> None:
    assert channel_list((101, 102)) == "(@101,102)"
    assert parse_channels("(@101, 103:105)") == (101, 103, 104, 105)
    for wrong in ("(@)", "101", "(@101", "(@101,,102)"):
        with pytest.raises(InstrumentError, match=r"expected a list of channels such as \(@101,102\), got"):
            parse_channels(wrong)


def test_answers_that_are_no_numbers_or_errors_are_unreadable() -> None:
    assert parse_numbers("+1.5E+00,2", 2) == (1.5, 2.0)
    assert parse_error('+0,"No error"') == (0, "No error")
    assert parse_error('-113,"Undefined header;1;2026/01/01 00:00:00.000"')[0] == -113
    with pytest.raises(InstrumentError, match="expected 2 numbers, got 1"):
        parse_numbers("1.5", 2)
    for wrong in ("no", "0", "0.5,x"):
        with pytest.raises(InstrumentError, match="expected"):
            parse_error(wrong)
