"""Keithley DAQ6510 with a 7700 multiplexer, by SCPI over TCP. Not tried on hardware.

Sources: the maker's reference manual (DAQ6510-901-01) as quoted by public clients, and these clients themselves: DESY
CMS `KeithleyDAQ6510.cpp`, IvS-KULeuven CGSE `daq6510.py`, nemocrys/exp-B-control, PyMeasure. What they do not show was
taken from the manual's command list: `ROUT:SCAN:INT`, `TRAC:ACT?`, `TRAC:FILL:MODE` and `TRIG:STAT?`.

The readings of a stream stay in `defbuffer1` until the next stream; when it is full, after a million readings, no more
arrive, and the stream is started anew. The thermistor functions are those of a four-wire Pt100, a thermistor of 5 kΩ
and a thermocouple K with the 7700's own reference junction. The command set must be SCPI, not TSP (`*LANG SCPI`).
"""

from __future__ import annotations

from benchctl_instruments.digitizers.scanning_meter import CHANNELS, VOLTS, ScanningMeter, recognition_of
from benchctl_instruments.protocols.lines import MOST_SHOWN, UnreadableError
from benchctl_instruments.protocols.scpi import channel_list

BUFFER = '"defbuffer1"'
MOST_READINGS = 1_000_000


class KeithleyDAQ6510(ScanningMeter):
    """A DAQ6510; see `ScanningMeter`."""

    NAME, MODEL = "Keithley DAQ6510", "DAQ6510"
    FASTEST_HZ, SWITCH_S = 10.0, 0.005
    RANGES_V = (0.1, 1.0, 10.0, 100.0, 1000.0)
    TEMPERATURES = {  # noqa: RUF012 - a constant of the class
        "rtd": "SENS:TEMP:TRAN FRTD,{0};:SENS:TEMP:RTD:FOUR PT100,{0}",
        "thermistor": "SENS:TEMP:TRAN THER,{0};:SENS:TEMP:THER 5000,{0}",
        "thermocouple": "SENS:TEMP:TRAN TC,{0};:SENS:TEMP:TC:TYPE K,{0};:SENS:TEMP:TC:RJUN:RSEL INT,{0}",
    }
    recognition = recognition_of(MODEL, "TRIG:STAT?")

    def _configuration(self, line_cycles: int) -> tuple[str, ...]:
        sensor = channel_list([self._thermistor])
        volts = channel_list(self._channels if self._temperature == VOLTS else [self._gyro])
        commands = [
            f'SENS:FUNC "VOLT",{volts}',
            f"SENS:VOLT:RANG {self._range_v:g},{volts}",
            f"SENS:VOLT:NPLC {line_cycles},{volts}",
        ]
        if self._temperature != VOLTS:
            commands += [
                f'SENS:FUNC "TEMP",{sensor}',
                self.TEMPERATURES[self._temperature].format(sensor),
                f"SENS:TEMP:UNIT CELS,{sensor}",
                f"SENS:TEMP:NPLC {line_cycles},{sensor}",
            ]
        return (
            *commands,
            f"TRAC:POIN {MOST_READINGS},{BUFFER}",
            f"TRAC:FILL:MODE ONCE,{BUFFER}",
            f"ROUT:SCAN:CRE {channel_list(self._channels)}",
            f"ROUT:SCAN:BUFF {BUFFER}",
        )

    def _scans(self) -> bool:
        return self._ask("TRIG:STAT?", _read_state) in ("RUNNING", "WAITING")

    def _single(self) -> str:
        self._tell(f"ROUT:SCAN:COUN:SCAN 1;:TRAC:CLE {BUFFER};:INIT;*WAI")
        return self._fetch(0, 1)

    def _start(self, interval_s: str) -> None:
        self._tell(f"ROUT:SCAN:COUN:SCAN 0;:ROUT:SCAN:INT {interval_s}")
        self._tell(f"ABOR;:TRAC:CLE {BUFFER};:INIT")

    def _ready(self, fetched: int) -> int:
        return self._count(f"TRAC:ACT? {BUFFER}") // CHANNELS - fetched

    def _fetch(self, fetched: int, scans: int) -> str:
        first = CHANNELS * fetched + 1
        return self._lines.ask(f"TRAC:DATA? {first},{first + CHANNELS * scans - 1},{BUFFER},READ,REL")


def _read_state(answer: str) -> str:
    """Return the state of the trigger model: one word of three parts; raises `UnreadableError` for another answer."""
    state, *more = answer.split(";")
    if len(more) != 2 or not state.isalpha():
        raise UnreadableError(f"expected a state such as IDLE;IDLE;0, got {answer[:MOST_SHOWN]!r}")
    return state.upper()


Driver = KeithleyDAQ6510
