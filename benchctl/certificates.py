"""Certificates of a bench's instruments: how well each is known (type B, JCGM 100:2008, 4.3), and until when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Annotated, Protocol

from pydantic import Field, field_validator

from benchctl.tables import Table

Figure = Annotated[float, Field(ge=0)] | None
"""An expanded uncertainty as a certificate states it; None: it does not."""


class Certificate(Table):
    """What a certificate states of any instrument: its number, and the coverage factor `k` of its figures."""

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
        """The source of its figures, in words."""
        return f"certificate{f' {self.number}' if self.number else ''}, k = {self.k:g}"


class RateTableCertificate(Certificate):
    """Of a rate table: the largest error of an angle, the axis from the vertical, a unit's input axis from the axis."""

    encoder_arcsec: Figure = None
    tilt_deg: Figure = None
    mounting_deg: Figure = None


class ChamberCertificate(Certificate):
    """Of a chamber: the temperature of its air."""

    air_c: Figure = None


class DigitizerCertificate(Certificate):
    """Of a digitizer: gain and offset of its volts, its clock, and the unit's thermistor with its amplifier."""

    gain_ppm: Figure = None
    offset_v: Figure = None
    clock_ppm: Figure = None
    thermometer_c: Figure = None


class Calibrated(Protocol):
    """An instrument of bench.toml, as far as its certificate's date goes."""

    @property
    def model(self) -> str:
        """The name of its driver."""

    @property
    def serial(self) -> str:
        """Its serial number; empty where none is stated."""

    @property
    def calibrated_until(self) -> date | None:
        """The last day on which its certificate holds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Expired:
    """An instrument whose certificate ended before a run did; `started` is the day, by UTC, on which that began."""

    role: str
    model: str
    serial: str
    calibrated_until: date
    started: date

    @property
    def says(self) -> str:
        """One line on it."""
        who = " ".join(part for part in (self.role, self.model, self.serial) if part)
        if self.calibrated_until < self.started:
            return f"{who}: its certificate expired on {self.calibrated_until}"
        return f"{who}: its certificate expires on {self.calibrated_until}, before the run's planned end"


def expired(entries: Mapping[str, Calibrated], on: date, until: date | None = None) -> tuple[Expired, ...]:
    """The instruments, by their role, whose certificate does not hold from `on` to the day `until`, by default `on`."""
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
