"""Certificates of a bench's instruments: type B uncertainties (JCGM 100:2008, 4.3) and expiry dates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Annotated, Protocol

from pydantic import Field, field_validator

from benchctl.tables import Table

Figure = Annotated[float, Field(ge=0)] | None
"""An expanded uncertainty as stated by a certificate; None if it is not stated."""


class Certificate(Table):
    """The common part of all certificates: the number, and the coverage factor `k` of the uncertainties."""

    number: str = Field(
        default="", max_length=200, description="That of the certificate, on one line.", examples=["LNE 2026-123"]
    )
    k: float = Field(default=2.0, gt=0, title="Coverage factor", description="Of all figures of this certificate.")

    @field_validator("number")
    @classmethod
    def _on_one_line(cls, value: str) -> str:
        if not value.isprintable():
            raise ValueError("expected a number as it is printed on the certificate, on one line")
        return value

    @property
    def source(self) -> str:
        """A description of the certificate as the source of its uncertainties."""
        return f"certificate{f' {self.number}' if self.number else ''}, k = {self.k:g}"


class RateTableCertificate(Certificate):
    """The certificate of a rate table.

    `encoder_arcsec` is the largest error of an angle, `tilt_deg` the angle of the axis from the vertical, and
    `mounting_deg` the angle of a unit's input axis from the table's axis.
    """

    encoder_arcsec: Figure = Field(
        default=None, title="Encoder", description="The largest error of an angle.", examples=[2.0]
    )
    tilt_deg: Figure = Field(default=None, title="Tilt", description="Of the axis from the vertical.", examples=[0.02])
    mounting_deg: Figure = Field(
        default=None,
        title="Mounting",
        description="Of a unit's input axis from the table's axis, by the fixture.",
        examples=[0.1],
    )


class ChamberCertificate(Certificate):
    """The certificate of a chamber: the uncertainty of the air temperature."""

    air_c: Figure = Field(default=None, title="Air", description="Of the temperature of the air.", examples=[0.3])


class DigitizerCertificate(Certificate):
    """The certificate of a digitizer: voltage gain and offset, clock, and the unit's thermistor with its amplifier."""

    gain_ppm: Figure = Field(default=None, title="Gain", description="Of its volts.", examples=[40.0])
    offset_v: Figure = Field(default=None, title="Offset", description="Of its volts.", examples=[2e-05])
    clock_ppm: Figure = Field(default=None, title="Clock", description="Of its clock.", examples=[10.0])
    thermometer_c: Figure = Field(
        default=None, title="Thermometer", description="Of the unit's thermistor with its amplifier.", examples=[0.1]
    )


class Calibrated(Protocol):
    """The part of an instrument of bench.toml that concerns the expiry of its certificate."""

    @property
    def model(self) -> str:
        """The name of its driver."""

    @property
    def serial(self) -> str:
        """Its serial number; empty if none is stated."""

    @property
    def calibrated_until(self) -> date | None:
        """The last day on which its certificate is valid."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Expired:
    """An instrument whose certificate expires before a run ends; `started` is the UTC date of the start of the run."""

    role: str
    model: str
    serial: str
    calibrated_until: date
    started: date

    @property
    def message(self) -> str:
        """A one-line message."""
        who = " ".join(part for part in (self.role, self.model, self.serial) if part)
        if self.calibrated_until < self.started:
            return f"{who}: its certificate expired on {self.calibrated_until}"
        return f"{who}: its certificate expires on {self.calibrated_until}, before the run's planned end"


def expired(entries: Mapping[str, Calibrated], on: date, until: date | None = None) -> tuple[Expired, ...]:
    """Return the instruments whose certificate is not valid from `on` to `until` (by default `on`).

    `entries` are keyed by role.
    """
    return tuple(
        Expired(
            role=role,
            model=entry.model,
            serial=entry.serial,
            calibrated_until=entry.calibrated_until,
            started=on,
        )
        for role, entry in entries.items()
        if entry.calibrated_until is not None and entry.calibrated_until < (until or on)
    )
