"""The inputs of a simulated T7: what is wired to them, how they are configured, and what its converters make of them.

As delivered the encoder is on DIO0 and DIO1, the gyro on AIN0, its thermistor on AIN1; the other analog inputs see 0 V.
Streamed volts are 16-bit codes; the slow converter of single readings resolves 24 bits. Both are ideal. Enabling
quadrature leaves the count as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.physics.adc import codes_from_volts, volts_from_codes
from benchctl_instruments.simulated.machines import SINGLE_READING_S, AnalogInputs
from benchctl_instruments.simulated.t7_register_map import ANALOG_INPUTS, DIGITAL_LINES

QUADRATURE = 10
RANGE, EF_ENABLE, EF_INDEX = 40000, 44000, 44100
DATA_CAPTURE_16 = 4899
READ_A_0 = 3000
HIGHEST_STREAMED_CODE = 0xFFFE  # FFFFh marks skipped scans and nothing else


@dataclass(slots=True)
class T7Terminals:
    """The inputs; `settings` are LabJack's registers, address -> value.

    `encoder_channel` is the digital line of the encoder's phase A, phase B is on the next one; `gyro_ain` and
    `thermistor_ain` are the analog inputs to which those two are wired. `zero` is the count at the last reset.
    """

    inputs: AnalogInputs
    settings: Mapping[int, float]
    encoder_channel: int = 0
    gyro_ain: int = 0
    thermistor_ain: int = 1
    zero: int = 0

    def single_code(self, channel: int) -> int:
        """An unhurried reading of an analog input, 24 bits."""
        _, gyro_v, thermistor_v = self._now()
        volts = self._wired(channel, gyro_v, thermistor_v)
        return int(codes_from_volts(volts, range_v=self._range_v(channel), bits=24)[0])

    def single_volts(self, channel: int) -> float:
        """The same in volts."""
        code = np.array([self.single_code(channel)])
        return float(volts_from_codes(code, range_v=self._range_v(channel), bits=24)[0])

    def count(self, line: int, *, reset: bool = False) -> int:
        """The count of a pair of lines, 0 where nothing is wired or quadrature is not enabled; it may be reset to 0."""
        if not self._counts(line):
            return 0
        count = int(self._now()[0][0])
        since_reset = count - self.zero
        if reset:
            self.zero = count
        return since_reset

    def can_stream(self, scan_list: Sequence[int]) -> bool:
        """Whether every address of a scan list is one that can be sampled here."""
        analog = {2 * channel for channel in range(ANALOG_INPUTS)}
        counts = {READ_A_0 + 2 * line for line in range(DIGITAL_LINES)}
        known = analog | counts | {DATA_CAPTURE_16}
        return bool(scan_list) and scan_list[0] != DATA_CAPTURE_16 and all(address in known for address in scan_list)

    def scans(
        self, scan_list: Sequence[int], first_s: float, interval_s: float, scans: int, *, start: int = 0
    ) -> npt.NDArray[np.uint16]:
        """Samples of each address at evenly spaced instants from scan `start` on, shape (scans, addresses)."""
        count, gyro_v, thermistor_v = self.inputs.sample(first_s, interval_s, scans, start=start)
        count = count - self.zero
        samples = np.empty((scans, len(scan_list)), np.uint16)
        upper: IntArray | int = 0  # what DATA_CAPTURE_16 gives: the upper half of the number before it
        for place, address in enumerate(scan_list):
            if address == DATA_CAPTURE_16:
                samples[:, place] = upper
            elif address >= READ_A_0:
                value = count if self._counts((address - READ_A_0) // 2) else np.zeros(scans, np.int64)
                samples[:, place], upper = value & 0xFFFF, value >> 16 & 0xFFFF
            else:
                volts = self._wired(address // 2, gyro_v, thermistor_v)
                codes = codes_from_volts(volts, range_v=self._range_v(address // 2))
                samples[:, place] = np.minimum(codes, HIGHEST_STREAMED_CODE)
        return samples

    def _wired(self, channel: int, gyro_v: FloatArray, thermistor_v: FloatArray) -> FloatArray:
        wired = {self.gyro_ain: gyro_v, self.thermistor_ain: thermistor_v}
        return wired.get(channel, np.zeros_like(gyro_v))

    def _counts(self, line: int) -> bool:
        places = (self.encoder_channel, self.encoder_channel + 1)
        return line in places and all(
            self.settings[EF_ENABLE + 2 * place] and self.settings[EF_INDEX + 2 * place] == QUADRATURE
            for place in places
        )

    def _range_v(self, channel: int) -> float:
        return self.settings[RANGE + 2 * channel]

    def _now(self) -> tuple[IntArray, FloatArray, FloatArray]:
        return self.inputs.sample(self.inputs.now(), SINGLE_READING_S, 1)
