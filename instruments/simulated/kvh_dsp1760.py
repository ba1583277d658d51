"""A simulated KVH DSP-1760 on the wire. It shares only the protocol with the driver."""

from __future__ import annotations

import numpy as np

from instruments.interfaces import FloatArray
from instruments.protocols import kvh1760 as kvh
from instruments.simulated.digital_gyro import DigitalGyro, axis_index, on_axis
from instruments.simulated.machines import AnalogInputs
from instruments.simulated.settings import WorldSettings

CHOICES = {
    "config": ("0", "1"),
    "rotfmt": ("rate", "delta"),
    "rotunits": tuple(kvh.ROTATION_DEGREES),
    "tempunits": tuple(kvh.TEMPERATURE_STEP_C),
}


class SimulatedKvhDsp1760(DigitalGyro):
    """A DSP-1760 with one axis along the table's; as delivered it sends angles in radians, 1000 a second.

    Settings are as strict as the sources are silent: outside of `config,1`, and for values it does not know, there is
    no answer. A data rate may be any whole number that the line can carry.

    Parameters
    ----------
    inputs, settings
        The bench: as of `DigitalGyro`.
    rate_hz
        How many frames a second it sends as it is delivered; the driver may ask for another rate.
    axis
        "x", "y" or "z": the one that turns.
    baud
        The line's speed.
    over_tcp
        Serial over TCP instead of a pseudo-terminal.

    Attributes
    ----------
    status
        What every frame states; to be set by hand.
    """

    frame_bytes = kvh.FORMAT.length

    def __init__(
        self,
        inputs: AnalogInputs,
        settings: WorldSettings | None = None,
        *,
        rate_hz: float = 1000.0,
        axis: str = "z",
        baud: int = kvh.DEFAULT_BAUD,
        over_tcp: bool = False,
    ) -> None:
        super().__init__(inputs, settings or WorldSettings(), baud=baud, over_tcp=over_tcp)
        self.status = kvh.GYROS_VALID
        self._settings = {"config": "0", "rotfmt": "delta", "rotunits": "rad", "tempunits": "c", "dr": f"{rate_hz:.0f}"}
        self._axis = axis_index(axis)
        self._heard = kvh.SettingReader()
        self._sequence = 0

    def start(self) -> None:
        """Switch it on; it sends from the beginning."""
        self._begin_stream(float(self._settings["dr"]))
        super().start()

    def feed(self, data: bytes) -> bytes:
        """Change the settings that are asked for."""
        return b"".join(self._change(name, value) for name, value in self._heard.feed(data))

    def _change(self, name: str, value: str) -> bytes:
        if not self._may_be(name, value):
            return b""
        self._settings[name] = value
        if name == "config" and value == "1":
            self._end_stream()
        elif name == "config":
            self._begin_stream(float(self._settings["dr"]))
        return kvh.encode_echo(name, value)

    def _may_be(self, name: str, value: str) -> bool:
        if name != "config" and self._settings["config"] != "1":
            return False
        if name == "dr":
            return value.isdecimal() and 0.0 < int(value) * self._wire_s <= 1.0
        return value in CHOICES.get(name, ())

    def _skip(self, frames: int) -> None:
        self._sequence += frames

    def _frames(self, rate_dps: FloatArray, temperature_c: FloatArray) -> bytes:
        degrees = rate_dps if self._settings["rotfmt"] == "rate" else rate_dps / self._rate_hz
        rotation = on_axis(degrees / kvh.ROTATION_DEGREES[self._settings["rotunits"]], self._axis)
        temperature = np.rint(temperature_c / kvh.TEMPERATURE_STEP_C[self._settings["tempunits"]])
        first, self._sequence = self._sequence, self._sequence + len(rotation)
        return kvh.encode_frames(rotation, temperature, first_sequence=first, status=self.status)


Twin = SimulatedKvhDsp1760
