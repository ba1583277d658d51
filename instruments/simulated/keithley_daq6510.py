"""A simulated Keithley DAQ6510 with a 7700 multiplexer in slot 1, at its SCPI socket.

Written from public clients, see `digitizers.keithley_daq6510`; the driver shares only the grammar of SCPI. One reading
buffer, `defbuffer1`, is simulated. Without a list of channels, a setting is that of the front terminals, or of the
channel that `ROUT:CLOS` has closed.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from benchctl_instruments.protocols import scpi
from benchctl_instruments.protocols.lines import parse_number
from benchctl_instruments.simulated.scanning_meter import (
    ILLEGAL_VALUE,
    INIT_IGNORED,
    OUT_OF_RANGE,
    Handler,
    MeterServer,
    Reading,
    RefusedError,
    SimulatedMeter,
)

BUFFER = "defbuffer1"
NO_SCAN_LIST = (5076, "No channels in the scan list")
BUFFER_POINTS, MOST_POINTS = 100_000, 7_000_000
FUNCTIONS = ("VOLTage[:DC]", "CURRent[:DC]", "RESistance", "FRESistance", "TEMPerature")
SENSORS = ("TC", "RTD", "TRTD", "FRTD", "THER", "CJC")
CHANNELS = range(101, 121)
FRONT = 0


class _Meter(SimulatedMeter):
    IDENTITY = "KEITHLEY INSTRUMENTS,MODEL DAQ6510,00000001,1.7.12b"

    def _own_handlers(self) -> dict[str, Handler]:
        of_a_function: dict[str, Handler] = {
            "NPLCycles": self._set_nplc,
            "NPLCycles?": lambda channels="": self._at(self._nplc, channels, 1.0),
            "RANGe[:UPPer]": self._set_range,
            "RANGe[:UPPer]?": lambda channels="": self._at(self._range_v, channels, 10.0),
            "RANGe:AUTO": lambda state, channels="": None,
            "AZERo": lambda state, channels="": None,
        }
        sense = {f"[SENSe:]{each}:{name}": handler for each in FUNCTIONS for name, handler in of_a_function.items()}
        return sense | {
            "[SENSe:]FUNCtion[:ON]": self._set_function,
            "[SENSe:]FUNCtion[:ON]?": lambda channels="": (
                f'"{self._function.get(self._where(channels)[0], "VOLT:DC")}"'
            ),
            "[SENSe:]TEMPerature:TRANsducer": lambda kind, channels="": self._known(kind, SENSORS),
            "[SENSe:]TEMPerature:RTD:FOUR": lambda kind, channels="": None,
            "[SENSe:]TEMPerature:THERmistor": lambda ohm, channels="": None,
            "[SENSe:]TEMPerature:TC:TYPE": lambda kind, channels="": self._known(kind, tuple("BEJKNRST")),
            "[SENSe:]TEMPerature:TC:RJUNction:RSELect": lambda kind, channels="": None,
            "[SENSe:]TEMPerature:UNIT": lambda unit, channels="": self._known(unit, ("CELS", "KELV", "FAHR")),
            "ROUTe[:CHANnel]:OPEN": lambda channels: self._close(()),
            "ROUTe[:CHANnel]:OPEN:ALL": lambda: self._close(()),
            "ROUTe[:CHANnel]:CLOSe": lambda channels: self._close(self._listed(channels)),
            "ROUTe[:CHANnel]:CLOSe?": lambda: scpi.channel_list(self._closed),
            "ROUTe:SCAN[:CREate]": self._create,
            "ROUTe:SCAN[:CREate]?": lambda: scpi.channel_list(self._channels),
            "ROUTe:SCAN:BUFFer": lambda name: self._known(name, (BUFFER.upper(),)),
            "ROUTe:SCAN:INTerval": lambda seconds: setattr(self, "_interval_s", parse_number(seconds)),
            "ROUTe:SCAN:INTerval?": lambda: f"{self._interval_s:g}",
            "ROUTe:SCAN:COUNt:SCAN": lambda count: setattr(self, "_count", int(parse_number(count))),
            "ROUTe:SCAN:COUNt:SCAN?": lambda: str(self._count),
            "ROUTe:SCAN:RESTart": lambda state: None,
            "ROUTe:SCAN:MODE": lambda mode: self._known(mode, ("ALL", "USED", "ABR")),
            "TRACe:POINts": self._set_points,
            "TRACe:POINts?": lambda buffer=BUFFER: str(self._points),
            "TRACe:CLEar": lambda buffer=BUFFER: self._readings.clear(),
            "TRACe:FILL:MODE": lambda mode, buffer=BUFFER: setattr(self, "_once", mode.upper() == "ONCE"),
            "TRACe:ACTual?": lambda buffer=BUFFER: str(len(self._readings)),
            "TRACe:DATA?": self._data,
            "FORMat[:DATA]": lambda kind: self._known(kind, ("ASC", "ASCII")),
            "TRIGger:STATe?": lambda: "RUNNING;RUNNING;1" if self._scan else "IDLE;IDLE;0",
            "READ?": self._read,
            "SYSTem:BEEPer[:IMMediate]": lambda frequency, duration: None,
        }

    def _reset_more(self) -> None:
        self._closed: tuple[int, ...] = ()
        self._interval_s, self._count = 0.0, 1
        self._points, self._once = BUFFER_POINTS, False

    def _error_text(self, code: int, text: str) -> str:
        return f'{code},"{text};{int(code != 0)};2026/01/01 00:00:00.000"' if code else f'{code},"{text};0;0 0"'

    def _timing(self) -> tuple[float, float]:
        if not self._channels:
            raise RefusedError(*NO_SCAN_LIST)
        return self._interval_s, self._count or math.inf

    def _initiate(self) -> None:
        before = list(self._readings)  # a scan appends to its buffer
        super()._initiate()
        self._readings.extendleft(reversed(before))

    def _store(self, readings: list[Reading]) -> None:
        self._readings.extend(readings[: self._points - len(self._readings)] if self._once else readings)
        while len(self._readings) > self._points:
            self._readings.popleft()

    def _data(self, start: str, end: str, buffer: str = BUFFER, *elements: str) -> str:
        self._known(buffer, (BUFFER.upper(),))
        first, last = int(parse_number(start)), int(parse_number(end))
        if not 1 <= first <= last <= len(self._readings):
            raise RefusedError(*OUT_OF_RANGE)
        forms: dict[str, Callable[[Reading], str]] = {
            "READ": lambda reading: _number(reading.value),
            "REL": lambda reading: f"{reading.time_s:.6f}",
            "CHAN": lambda reading: str(reading.channel),
        }
        try:
            wanted = [forms[element.upper()[:4]] for element in elements or ("READ",)]
        except KeyError:
            raise RefusedError(*ILLEGAL_VALUE) from None
        return ",".join(form(self._readings[index]) for index in range(first - 1, last) for form in wanted)

    def _read(self, *buffer: str) -> str:
        if self._scan:
            raise RefusedError(*INIT_IGNORED)
        channel = self._closed[0] if self._closed else FRONT
        value = self._now_v(channel)
        self._store([Reading(value=value, time_s=0.0, channel=channel)])
        return _number(value)

    def _create(self, channels: str) -> None:
        self._channels = self._listed(channels)

    def _close(self, channels: tuple[int, ...]) -> None:
        self._closed = channels

    def _set_function(self, name: str, channels: str = "") -> None:
        if not any(scpi.header_pattern(each).fullmatch(name.upper()) for each in FUNCTIONS):
            raise RefusedError(*ILLEGAL_VALUE)
        self._function |= dict.fromkeys(self._where(channels), name.upper())

    def _set_nplc(self, number: str, channels: str = "") -> None:
        self._set_each(self._nplc, number, channels or f"(@{self._where('')[0]})", 15.0)

    def _set_range(self, number: str, channels: str = "") -> None:
        self._set_each(self._range_v, number, channels or f"(@{self._where('')[0]})", 1000.0)

    def _set_points(self, number: str, buffer: str = BUFFER) -> None:
        if not 2 <= (points := int(parse_number(number))) <= MOST_POINTS:
            raise RefusedError(*OUT_OF_RANGE)
        self._points = points
        self._readings.clear()

    def _at(self, store: dict[int, float], channels: str, usual: float) -> str:
        return f"{store.get(self._where(channels)[0], usual):g}"

    def _where(self, channels: str) -> tuple[int, ...]:
        return self._listed(channels) if channels else self._closed[:1] or (FRONT,)

    def _listed(self, channels: str) -> tuple[int, ...]:
        found = scpi.parse_channels(channels)
        if not found or any(channel not in CHANNELS for channel in found):
            raise RefusedError(*OUT_OF_RANGE)
        return found


def _number(value: float) -> str:
    return f"{value:.8E}"


class SimulatedDAQ6510(MeterServer):
    """A DAQ6510 at `tcp://host:port`; see `MeterServer`."""

    METER = _Meter


Twin = SimulatedDAQ6510
