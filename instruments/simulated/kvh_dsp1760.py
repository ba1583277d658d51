"""A simulated KVH DSP-1760. It shares only the protocol with the driver."""

from __future__ import annotations

import re

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.protocols import kvh1760 as kvh
from benchctl_instruments.simulated.digital_gyro import DigitalGyro
from benchctl_instruments.simulated.machines import GyroInputs
from benchctl_instruments.simulated.settings import WorldSettings

SETTINGS = {  # a pattern of the permitted values, and the value as delivered
    "config": ("[01]", "0"),
    "dr": ("|".join(map(str, kvh.RATES_HZ)), "1000"),
    "rotfmt": ("rate|delta|reset", "delta"),
    "rotunits": ("|".join(kvh.ROTATION_DEGREES), "rad"),
    "tempunits": ("f|" + "|".join(kvh.TEMPERATURE_STEP_C), "c"),
    "axes": (r"(-?[\d.]+,){8}-?[\d.]+", "1,0,0,0,1,0,0,0,1"),
    "baud": ("9600|19200|38400|57600|115200|460800|576000|921600", "921600"),
    "filten": ("[01]", "1"),
    "filttype": ("g,(cheby|butter|ave)", "g,cheby"),
    "msync": ("imu|ext", "imu"),
}
"""The settings of public clients (avl_core kvh_imu.h, ros_kvh1750, LSST M1M3). Of these axes, baud, filter and
synchronisation are stored and have no effect."""


class SimulatedKvhDsp1760(DigitalGyro):
    """A DSP-1760 with one axis along the table's; as delivered it sends angles in radians, 1000 per second.

    In `config,1` it changes and reports its settings (`SETTINGS`) and answers INVALID to everything else, also to a
    data rate that its line cannot carry; outside `config,1` it does not answer. It has no built-in test (`?BIT`).

    Parameters
    ----------
    inputs, settings, axis, baud, over_tcp
        See `DigitalGyro`.
    rate_hz
        The data rate as delivered; the driver may change it.
    echoes_exit
        Whether `=config,0` is echoed before the first frame; the public sources differ.

    Attributes
    ----------
    status
        The status of every frame; may be assigned.
    """

    frame_bytes = kvh.FORMAT.length

    def __init__(
        self,
        inputs: GyroInputs,
        settings: WorldSettings | None = None,
        *,
        rate_hz: float = 1000.0,
        echoes_exit: bool = True,
        axis: str = "z",
        baud: int = kvh.DEFAULT_BAUD,
        over_tcp: bool = False,
    ) -> None:
        if rate_hz not in kvh.RATES_HZ:
            known = ", ".join(map(str, kvh.RATES_HZ))
            raise UsageError(f"rate_hz {rate_hz:g}: a simulated KVH DSP-1760 has one of {known}")
        super().__init__(inputs, settings or WorldSettings(), axis=axis, baud=baud, over_tcp=over_tcp)
        self.status = kvh.GYROS_VALID
        self._delivered = {name: value for name, (_, value) in SETTINGS.items()} | {"dr": f"{rate_hz:g}"}
        self._settings = dict(self._delivered)
        self._echoes_exit = echoes_exit
        self._heard = kvh.CommandReader()
        self._sequence = 0

    def start(self) -> None:
        """Switch it on; it sends from the beginning."""
        self._begin_stream(float(self._settings["dr"]))
        super().start()

    def feed(self, data: bytes) -> bytes:
        """Execute the commands."""
        return b"".join(self._answer(command) for command in self._heard.feed(data))

    def _answer(self, command: kvh.Kvh1760Command) -> bytes:
        name, value = command.name, command.value
        if self._settings["config"] != "1" and (command.sign, name) != ("=", "config"):
            return b""
        if command.sign == "?" and name in self._settings and not value:
            return kvh.encode_answer(name, self._settings[name])
        if command.sign == "=" and name == "rstcfg" and not value:
            self._settings = self._delivered | {"config": "1"}
            return kvh.encode_answer(name)
        if command.sign == "?" or not self._may_be(name, value):
            return kvh.encode_answer("invalid", name, *([value] if value else []))
        self._settings[name] = self._delivered[name] if value == "reset" else value
        if name != "config":
            return kvh.encode_answer(name, value)
        if value == "1":
            self._end_stream()
        else:
            self._begin_stream(float(self._settings["dr"]))
        return kvh.encode_answer(name, value) if value == "1" or self._echoes_exit else b""

    def _may_be(self, name: str, value: str) -> bool:
        if name not in SETTINGS or not re.fullmatch(SETTINGS[name][0], value):
            return False
        return name != "dr" or int(value) * self._wire_s <= 1.0

    def _skip(self, frames: int) -> None:
        self._sequence += frames

    def _frames(self, rates_dps: FloatArray, temperature_c: FloatArray) -> bytes:
        degrees = rates_dps if self._settings["rotfmt"] == "rate" else rates_dps / self._rate_hz
        rotation = degrees / kvh.ROTATION_DEGREES[self._settings["rotunits"]]
        unit = self._settings["tempunits"]
        temperature = np.rint(
            1.8 * temperature_c + 32.0 if unit == "f" else temperature_c / kvh.TEMPERATURE_STEP_C[unit]
        )
        first, self._sequence = self._sequence, self._sequence + len(rotation)
        return kvh.encode_frames(rotation, temperature, first_sequence=first, status=self.status)


Twin = SimulatedKvhDsp1760
