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

    number: str = Field(default="", max_length=200)
    k: float = Field(default=2.0, gt=0)

    @field_validator("number")
    @classmethod
    def _on_one_line(cls, value: str) -> str:
        if not value.isprintable():
            raise ValueError("expected a number as it is printed on the certificate, on one line")
        return value

    @property
    def says(self) -> str:
        """A description of the certificate as the source of its uncertainties."""
        return f"certificate{f' {self.number}' if self.number else ''}, k = {self.k:g}"


class RateTableCertificate(Certificate):
    """The certificate of a rate table.

    `encoder_arcsec` is the largest error of an angle, `tilt_deg` the angle of the axis from the vertical, and
    `mounting_deg` the angle of a unit's input axis from the table's axis.
    """

    encoder_arcsec: Figure = None
    tilt_deg: Figure = None
    mounting_deg: Figure = None


class ChamberCertificate(Certificate):
    """The certificate of a chamber: the uncertainty of the air temperature."""

    air_c: Figure = None


class DigitizerCertificate(Certificate):
    """The certificate of a digitizer: voltage gain and offset, clock, and the unit's thermistor with its amplifier."""

    gain_ppm: Figure = None
    offset_v: Figure = None
    clock_ppm: Figure = None
    thermometer_c: Figure = None


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
    def says(self) -> str:
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
