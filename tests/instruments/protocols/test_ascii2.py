"""ASCII-2 against the descriptions that real chambers gave of themselves, shortened to what matters."""

from __future__ import annotations

import contextlib
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.protocols.ascii2 import (
    UnreadableError,
    changed,
    read_accepted,
    read_description,
    read_state,
    set_request,
    value_text,
)

CLIMATE = """ASCII-2 PROTOCOL CONFIGURATION
Configuration type: DYNAMIC
Example of an ASCII E-String:
$01E CV01 CV02 SV01 SV02 SV03 DO00DO01DO02DO03DO04DO05DO06DO07DO08DO09DO10DO11DO
12DO13DO14DO15DO16DO17DO18DO19DO20DO21DO22DO23DO24DO25<CR>
Description:
CV01  value min:  -72.0   value max:  182.0   Temperature
CV02  value min:    0.0   value max:   98.0   Humidity
Example of  an ASCII I-String:
$01I<CR>
CV01 CV01 CV02 CV02 SV01 SV02 SV03 MV01 MV02 MV03 MV04 DO00DO01DO02DO03DO04DO05D
O06DO07DO08DO09DO10DO11DO12DO13DO14DO15DO16DO17DO18DO19DO20DO21DO22DO23DO24DO25D
O26DO27DO28DO29DO30DO31<CR>
Configured Messages:
none
"""
VC3 = """STANDARD ASCII 2 PROTOCOL FOR E-STRING AND CHAMBERS WITH 2 CONTROLLED VALUES
EXAMPLE OF AN ASCII E-STRING
$01E CV01 CV02 SV01 MV01 MV02 MV03 MV04 DO00 DO01 DO02 DO17 DO18 DO30 DO31 <CR>
 DESCRIPTION:
CV01  value min:  -77.0   Value max:  182.0   Temperature
EXAMPLE OF A ASCII E-STRING
$01E 0050.0 0080.0 0090.0 0000.0 0000.0 0000.0 0000.0 01010101010101010101010101010101<CR>
EXAMPLE OF AN ASCII I-STRING
$01I<CR>
CV01 CV01 CV02 CV02 SV01 SV01 MV01 MV01 MV02 MV02 MV03 MV03 MV04 MV04 DO00 DO01 DO30 DO31 DESCRIPTION:
CV01  nominal value Temperature
"""
VC3_STATE = (
    "0050.0 0024.6 0080.0 0066.7 0090.0 0090.0 0000.0 0023.8 0000.0 0022.2 0000.0 0025.5 0000.0 0024.4 "
    "01100000000000000000000000000000"
)


def test_a_description_whose_lines_break_inside_a_name_is_read() -> None:
    found = read_description(CLIMATE)
    assert found.written == ("CV01", "CV02", "SV01", "SV02", "SV03")
    assert (found.state[:4], len(found.state), found.channels) == (("CV01", "CV01", "CV02", "CV02"), 11, 26)
    assert (found.low_c, found.high_c) == (-72.0, 182.0)


def test_a_vc3s_own_example_is_read_and_only_the_set_point_and_the_start_are_changed() -> None:
    found = read_description(VC3)
    state = read_state(VC3_STATE, found)
    assert (state.setpoint_c, state.air_c, state.started) == (50.0, 24.6, True)
    assert set_request(1, *changed(found, state, setpoint_c=-40.0, start=True)) == (
        "$01E -040.0 0080.0 0090.0 0000.0 0000.0 0000.0 0000.0 01100000000000000000000000000000"
    )
    assert set_request(7, *changed(found, state, setpoint_c=None, start=False)) == (
        "$07E 0050.0 0080.0 0090.0 0000.0 0000.0 0000.0 0000.0 00100000000000000000000000000000"
    )


def test_as_many_channels_are_written_as_the_description_has() -> None:
    found = read_description(CLIMATE)
    state = read_state("0026.0 0025.7 0050.0 0001.0 " + "0000.0 " * 7 + "01100000000000000000000000000001", found)
    _, channels = changed(found, state, setpoint_c=20.0, start=True)
    assert channels == "01100000000000000000000000"


@pytest.mark.parametrize(("value", "text"), [(50.0, "0050.0"), (-40.0, "-040.0"), (-5.54, "-005.5"), (-0.04, "0000.0")])
def test_a_value_has_six_characters(value: float, text: str) -> None:
    assert value_text(value) == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "0",
        CLIMATE.replace("$01E", "$01X"),
        CLIMATE.replace("value min", "min"),
        re.sub("CV01 CV01", "CV01", CLIMATE),
    ],
)
def test_a_text_that_describes_no_strings_is_unreadable(text: str) -> None:
    with pytest.raises(UnreadableError):
        read_description(text)


@pytest.mark.parametrize(
    "line", ["", "0", "0050.0 0024.6 0110", VC3_STATE.replace("0024.6", "Z024.6"), VC3_STATE[:-33]]
)
def test_a_line_that_is_no_state_of_that_chamber_is_unreadable(line: str) -> None:
    with pytest.raises(UnreadableError):
        read_state(line, read_description(VC3))


@given(st.text(max_size=300))
def test_any_text_is_read_or_unreadable(text: str) -> None:
    for read in (read_description, read_accepted, lambda line: read_state(line, read_description(VC3))):
        with contextlib.suppress(UnreadableError):
            read(text)
