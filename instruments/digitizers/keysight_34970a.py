"""Keysight (Agilent, HP) 34970A and 34972A with a 34901A multiplexer, by SCPI. Not tried on hardware.

Sources: the maker's command reference (34970-90003) as quoted by public clients, and these clients themselves:
PythonEquipmentDrivers `AG_34972A.py`, py-lab-hal `keysight_34970a.py`, nerspstl/pstl-tools. A 34972A has TCP port 5025;
a 34970A has only RS-232 (`serial://DEVICE?baud=9600`, or behind a TCP box) and GPIB.

The readings of a stream are deleted from the instrument's memory as they are fetched; each carries its time since the
start of the scan (`FORM:READ:TIME`), so that an answer that is lost is a gap. The temperature functions are those of a
four-wire RTD with α = 0.00385, a thermistor of 5 kΩ and a thermocouple K with the card's own reference junction.
"""

from __future__ import annotations

from benchctl_instruments.digitizers.scanning_meter import CHANNELS, VOLTS, ScanningMeter, recognition_of
from benchctl_instruments.protocols.scpi import channel_list

SCAN_RUNS = 1 << 4
"""Of the operation status register."""


class Keysight34970A(ScanningMeter):
    """A 34970A or 34972A; see `ScanningMeter`."""

    NAME, MODEL = "Keysight 34970A", "3497"
    FASTEST_HZ, SWITCH_S = 5.0, 0.02
    RANGES_V = (0.1, 1.0, 10.0, 100.0, 300.0)
    TEMPERATURES = {"rtd": "FRTD,85", "thermistor": "THER,5000", "thermocouple": "TC,K"}  # noqa: RUF012 - a constant
    recognition = recognition_of(MODEL, "STAT:OPER:COND?")

    def _configuration(self, line_cycles: int) -> tuple[str, ...]:
        sensor = channel_list([self._thermistor])
        volts = channel_list(self._channels if self._temperature == VOLTS else [self._gyro])
        commands = [f"CONF:VOLT:DC {self._range_v:g},{volts}", f"VOLT:DC:NPLC {line_cycles},{volts}"]
        if self._temperature != VOLTS:
            commands += [
                f"CONF:TEMP {self.TEMPERATURES[self._temperature]},{sensor}",
                f"UNIT:TEMP C,{sensor}",
                f"TEMP:NPLC {line_cycles},{sensor}",
            ]
        return (
            *commands,
            f"ROUT:SCAN {channel_list(self._channels)}",
            "FORM:READ:TIME ON;:FORM:READ:TIME:TYPE REL",
        )

    def _scans(self) -> bool:
        return bool(self._count("STAT:OPER:COND?") & SCAN_RUNS)

    def _single(self) -> str:
        self._tell("TRIG:SOUR IMM;:TRIG:COUN 1")
        return self._lines.ask("READ?")

    def _start(self, interval_s: str) -> None:
        self._tell(f"TRIG:SOUR TIM;:TRIG:TIM {interval_s};:TRIG:COUN INF")
        self._tell("ABOR;:INIT")

    def _ready(self, fetched: int) -> int:
        return self._count("DATA:POIN?") // CHANNELS

    def _fetch(self, fetched: int, scans: int) -> str:
        return self._lines.ask(f"DATA:REM? {CHANNELS * scans}")


Driver = Keysight34970A
