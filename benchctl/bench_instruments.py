"""The tables of bench.toml that name an instrument: its driver, its address, its certificate, its inputs."""

from __future__ import annotations

import datetime
from typing import Any, Literal, TypeVar

from pydantic import Field, field_validator

from benchctl.certificates import Certificate, ChamberCertificate, DigitizerCertificate, RateTableCertificate
from benchctl.limits import HIGHEST_RATE_HZ, MOST_COUNTS_PER_REV
from benchctl.tables import Table
from benchctl_instruments.arrays import FloatArray

Volts = TypeVar("Volts", float, FloatArray)

_CERTIFICATE = Field(default=None, description="What it states: expanded uncertainties; the rest is assumed.")


class InstrumentEntry(Table):
    """An instrument: `model` names the driver, `options` are further keyword arguments of that driver."""

    model: str = Field(description="The driver; those that this installation has are offered, others may be added.")
    address: str | None = Field(
        default=None,
        description="tcp://HOST:PORT, serial:///dev/ttyUSB0?baud=19200, serial://COM3?baud=9600,"
        " socket://HOST:PORT for a serial line behind a TCP box, visa://GPIB0::7::INSTR (needs benchctl[visa]),"
        " or daqmx://Dev1 (needs benchctl[daqmx]).",
        examples=["tcp://192.168.1.60:502"],
    )
    serial: str = Field(
        default="", title="Serial number", description="As its certificate names it.", examples=["CH-1234"]
    )
    calibrated_until: datetime.date | None = Field(
        default=None, description="The last day on which its certificate holds.", examples=["2027-01-31"]
    )
    certificate: Certificate | None = _CERTIFICATE
    options: dict[str, Any] = Field(
        default_factory=dict,
        description="Further keywords of the driver; its docstring names them.",
        examples=[{"unit_id": 3}],
    )


class RateTableEntry(InstrumentEntry):
    """The rate table, with the encoder on its axis and the mounting fixture of the unit."""

    certificate: RateTableCertificate | None = _CERTIFICATE


class ChamberEntry(InstrumentEntry):
    """The climate chamber."""

    model: str = Field(
        description="The driver; those of this installation are offered."
        " Or the path of a profile that ends in .toml, next to this file.",
        examples=["own_profile.toml"],
    )
    certificate: ChamberCertificate | None = _CERTIFICATE


class DigitizerEntry(InstrumentEntry):
    """The digitizer, and the scaling of its inputs."""

    stream_address: str | None = Field(
        default=None,
        title="Stream",
        description="Where the stream is; port 702 of the same host where it is not given.",
    )
    sample_rate_hz: float = Field(
        default=500.0, gt=0, le=HIGHEST_RATE_HZ, title="Sample rate", description="Scans a second."
    )
    adc_bits: int = Field(default=16, ge=8, le=32, title="Bits", description="Of the converter.")
    adc_range_v: float = Field(default=10.0, gt=0, title="Range", description="± so much.")
    encoder_counts_per_rev: int = Field(
        gt=0,
        le=MOST_COUNTS_PER_REV,
        title="Encoder",
        description="Counts a revolution, all edges counted.",
        examples=[360000],
    )
    encoder_sign: Literal[1, -1] = Field(
        default=1, title="Sign", description="-1 where the count falls while the table turns counter-clockwise."
    )
    encoder_accuracy_arcsec: float = Field(
        default=0.0, ge=0, title="Encoder's accuracy", description="Of an angle; 0: not stated.", examples=[20.0]
    )
    thermistor_c_per_v: float = Field(
        title="Thermistor", description="Degrees a volt of its amplifier; not 0.", examples=[20.0]
    )
    thermistor_c_at_0v: float = Field(
        default=0.0, title="Thermistor at 0 V", description="In °C, where its amplifier gives 0 V."
    )
    certificate: DigitizerCertificate | None = _CERTIFICATE

    @field_validator("thermistor_c_per_v")
    @classmethod
    def _tells_temperature(cls, value: float) -> float:
        if value == 0:
            raise ValueError("expected another number than 0, which would make every voltage one temperature")
        return value

    @property
    def degrees_per_count(self) -> float:
        """The table's angle by one count of its encoder, with the encoder's sign."""
        return self.encoder_sign * 360.0 / self.encoder_counts_per_rev

    @property
    def adc_step_v(self) -> float:
        """The quantization step of the converter."""
        return 2.0 * self.adc_range_v / 2.0**self.adc_bits

    def gyro_celsius(self, thermistor_v: Volts) -> Volts:
        """Return the gyro's temperature [°C] from the thermistor amplifier's voltage; one reading, or shape (n,)."""
        return self.thermistor_c_at_0v + self.thermistor_c_per_v * thermistor_v


class GyroEntry(InstrumentEntry):
    """A digital gyro under test, which sends frames; `options` states, among others, the axis that the table turns."""

    frame_rate_hz: float = Field(
        default=1000.0, gt=0, le=HIGHEST_RATE_HZ, title="Frame rate", description="Frames a second."
    )
    sign: Literal[1, -1] = Field(
        default=1, description="-1 where its rate falls while the table turns counter-clockwise."
    )
    axes: Literal[1, 3] = Field(
        default=1, description="3: the rates of x, y and z are recorded, too, for the procedure three_axes."
    )
