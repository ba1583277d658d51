"""A simulated Keysight 34970A with a 34901A multiplexer in slot 1, by SCPI on TCP (a 34972A) or a serial line.

Written from public clients, see `digitizers.keysight_34970a`; the driver shares only the grammar of SCPI. A scan list
is scanned in ascending order, whatever order it was written in; a new scan clears the memory of 50,000 readings, whose
oldest reading is lost when it is full.
"""

from __future__ import annotations

import math

from benchctl_instruments.protocols import scpi
from benchctl_instruments.protocols.lines import parse_number
from benchctl_instruments.simulated.scanning_meter import (
    OUT_OF_RANGE,
    Handler,
    MeterServer,
    Reading,
    RefusedError,
    SimulatedMeter,
)

NO_SCAN_LIST = (308, "No channels in scan list")
MEMORY_EMPTY = (-230, "Data corrupt or stale")
MOST_READINGS = 50_000
CHANNELS = range(101, 121)
SCAN_RUNS = 1 << 4
FIRST_S = 0.061  # from the start of a scan to its first reading
NPLC = (0.02, 0.2, 1.0, 2.0, 10.0, 20.0, 100.0, 200.0)
NAMED_RANGES_V = {"MIN": 0.1, "MAX": 300.0, "AUTO": 10.0, "DEF": 10.0}  # the one that it would choose for a gyro
TRANSDUCERS = ("TC", "TCOUPLE", "TCOUP", "RTD", "FRTD", "THER", "THERMISTOR")


class SimulatedMeter34970A(SimulatedMeter):
    """Its states, without I/O."""

    IDENTITY = "HEWLETT-PACKARD,34970A,0,13-2-2"

    def _own_handlers(self) -> dict[str, Handler]:
        sense = {
            f"[SENSe:]{function}:NPLCycles": self._set_nplc
            for function in ("VOLTage[:DC]", "CURRent[:DC]", "TEMPerature", "RESistance", "FRESistance")
        }
        return sense | {
            "CONFigure:VOLTage[:DC]": self._configure_volts,
            "CONFigure:TEMPerature": self._configure_temperature,
            "MEASure:VOLTage[:DC]?": self._measure,
            "UNIT:TEMPerature": lambda unit, channels="": self._known(unit, ("C", "F", "K")),
            "ROUTe:SCAN": self._set_scan,
            "ROUTe:SCAN?": self._scan_block,
            "ROUTe:SCAN:SIZE?": lambda: f"{len(self._channels):+d}",
            "ROUTe:CHANnel:DELay": lambda seconds, channels: None,
            "ROUTe:CHANnel:DELay:AUTO": lambda state, channels: None,
            "TRIGger:SOURce": self._set_source,
            "TRIGger:SOURce?": lambda: self._source,
            "TRIGger:TIMer": lambda seconds: setattr(self, "_interval_s", parse_number(seconds)),
            "TRIGger:TIMer?": lambda: _number(self._interval_s),
            "TRIGger:COUNt": self._set_count,
            "TRIGger:COUNt?": lambda: _number(min(self._count, scpi.OVERLOAD)),
            "[SENSe:]VOLTage[:DC]:NPLCycles?": self._nplc_of,
            "ROUTe:OPEN": lambda channels: None,
            "FORMat:READing:TIME": lambda state: setattr(self, "_with_time", state.upper() in ("ON", "1")),
            "FORMat:READing:TIME:TYPE": lambda kind: self._known(kind, ("REL", "RELATIVE")),
            "FORMat:READing:CHANnel": lambda state: setattr(self, "_with_channel", state.upper() in ("ON", "1")),
            "READ?": self._read,
            "FETCh?": self._fetch,
            "DATA:POINts?": lambda: f"{len(self._readings):+d}",
            "DATA:REMove?": self._remove,
            "STATus:OPERation:CONDition?": lambda: f"{SCAN_RUNS if self._scan else 0:+d}",
            "SYSTem:REMote": lambda: None,
            "DISPlay": lambda state: None,
        }

    def _reset_more(self) -> None:
        self._source, self._interval_s, self._count = "IMM", 0.0, 1.0
        self._with_time = self._with_channel = False

    def _error_text(self, code: int, text: str) -> str:
        return f'{code:+d},"{text}"'

    def _timing(self) -> tuple[float, float]:
        if not self._channels:
            raise RefusedError(*NO_SCAN_LIST)
        return (self._interval_s if self._source == "TIM" else 0.0), self._count

    def _store(self, readings: list[Reading]) -> None:
        super()._store(readings)
        while len(self._readings) > MOST_READINGS:
            self._readings.popleft()

    def _read(self) -> str:
        self._initiate()
        return self._fetch()

    def _fetch(self) -> str:
        self._finish()
        if not self._readings:
            raise RefusedError(*MEMORY_EMPTY)
        return ",".join(map(self._text, self._readings))

    def _remove(self, count: str) -> str:
        if not 1 <= (few := int(parse_number(count))) <= len(self._readings):
            raise RefusedError(*OUT_OF_RANGE)
        return ",".join(self._text(self._readings.popleft()) for _ in range(few))

    def _text(self, reading: Reading) -> str:
        text = _number(reading.value)
        text += f",{reading.time_s + FIRST_S:012.3f}" if self._with_time else ""
        return text + (f",{reading.channel}" if self._with_channel else "")

    def _configure_volts(self, *arguments: str) -> None:
        *settings, channels = arguments
        listed = self._listed(channels)
        range_v = settings[0].upper() if settings else "AUTO"
        volts = NAMED_RANGES_V.get(range_v) or parse_number(settings[0])
        self._function |= dict.fromkeys(listed, "VOLT")
        self._range_v |= dict.fromkeys(listed, volts)
        self._nplc |= dict.fromkeys(listed, 1.0)

    def _configure_temperature(self, transducer: str, kind: str, *more: str) -> None:
        self._known(transducer, TRANSDUCERS)
        listed = self._listed(more[-1] if more else "")
        self._function |= dict.fromkeys(listed, f"TEMP {transducer},{kind}")
        self._nplc |= dict.fromkeys(listed, 1.0)

    def _measure(self, *arguments: str) -> str:
        self._configure_volts(*arguments)
        return ",".join(_number(self._now_v(channel)) for channel in self._listed(arguments[-1]))

    def _set_nplc(self, number: str, channels: str) -> None:
        self._listed(channels)
        if parse_number(number) not in NPLC:
            raise RefusedError(*OUT_OF_RANGE)
        self._set_each(self._nplc, number, channels, NPLC[-1])

    def _nplc_of(self, channels: str) -> str:
        return ",".join(_number(self._nplc.get(channel, 1.0)) for channel in self._listed(channels))

    def _set_scan(self, channels: str) -> None:
        self._channels = tuple(sorted(set(self._listed(channels))))

    def _scan_block(self) -> str:
        listed = scpi.channel_list(self._channels)
        return f"#{len(str(len(listed)))}{len(listed)}{listed}"

    def _set_source(self, source: str) -> None:
        self._known(source[:3], ("IMM", "BUS", "EXT", "TIM"))
        self._source = source[:3].upper()

    def _set_count(self, count: str) -> None:
        self._count = math.inf if count.upper().startswith("INF") else parse_number(count)

    def _listed(self, channels: str) -> tuple[int, ...]:
        found = scpi.parse_channels(channels)
        if any(channel not in CHANNELS for channel in found):
            raise RefusedError(*OUT_OF_RANGE)
        return found


def _number(value: float) -> str:
    return f"{value:+.8E}"


class Simulated34970A(MeterServer):
    """A 34970A at `tcp://host:port` or on a serial line; see `MeterServer`."""

    METER = SimulatedMeter34970A


Twin = Simulated34970A
