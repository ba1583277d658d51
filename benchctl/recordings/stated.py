"""The statements of a recording's bench.toml on its instruments: standard uncertainties, and expired certificates.

The figures of a certificate are expanded uncertainties; divided by its coverage factor they are standard uncertainties
(k = 1), after JCGM 100:2008 (GUM), 4.3.3. Values that are not stated are assumed, and marked as assumed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import date, datetime
from typing import Any

from benchctl.bench import Bench, bench_of_text
from benchctl.certificates import Certificate, Expired
from benchctl.documents import json_document
from benchctl.limits import cut
from benchctl.recordings.model import Meta
from benchctl_instruments.errors import UsageError

ASSUMED: Mapping[str, float] = {
    "tilt_deg": 0.1,
    "mounting_deg": 0.1,
    "gain_ppm": 50.0,
    "clock_ppm": 20.0,
    "thermometer_c": 0.1,
    "air_c": 0.3,
    "latitude_deg": 0.1,
}
"""Assumed standard uncertainties of values that are not stated, by the fields of `StatedUncertainties`."""

_LATITUDE_K = 2.0
_LONGEST_WORD = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """A standard uncertainty (k = 1), and its source in words."""

    standard: float
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedUncertainties:
    """The uncertainties of a bench, each in the unit of its name.

    `encoder_arcsec`: an angle of the table; `tilt_deg`: its axis from the vertical; `mounting_deg`: the unit's input
    axis from that axis; `gain_ppm`, `offset_v`, `clock_ppm`: the digitizer's volts and clock; `thermometer_c`: the
    unit's thermistor; `air_c`: the chamber's air; `latitude_deg`: the stated latitude.
    """

    encoder_arcsec: Stated
    tilt_deg: Stated
    mounting_deg: Stated
    gain_ppm: Stated
    offset_v: Stated
    clock_ppm: Stated
    thermometer_c: Stated
    air_c: Stated
    latitude_deg: Stated


_NO_CONVERTER = Stated(standard=0.0, says="none: the output is digital")


def stated(bench: Bench) -> StatedUncertainties:
    """Return the standard uncertainties of a bench: from its certificates, else from its digitizer, else assumed."""
    digitizer = bench.digitizer
    return _stated(bench, digitizer.encoder_accuracy_arcsec, digitizer.adc_step_v, "assumed")


def stated_of(meta: Meta) -> StatedUncertainties:
    """Return the same from the bench.toml that a recording stores; without certificates if it cannot be read.

    The digitizer's volts have no part in an output that is recorded as a number.
    """
    facts = meta.bench
    bench, assumed = None, "assumed"
    if text := meta.provenance.get("bench_toml"):
        try:
            bench = bench_of_text(text, "the recording's bench.toml")
        except UsageError:  # of another version; its samples are still valid
            assumed = "assumed: the recording's bench.toml cannot be read"
    found = _stated(bench, facts.encoder_accuracy_arcsec, facts.adc_step_v, assumed)
    return found if meta.output_unit == "V" else replace(found, gain_ppm=_NO_CONVERTER, offset_v=_NO_CONVERTER)


def expired_of(meta: Meta) -> tuple[Expired, ...]:
    """Return the instruments of a recording whose certificate had expired on the day (UTC) on which it was started.

    An instrument without a date is not included; nothing is included if the recording does not state its start.
    """
    started = _day(meta.provenance.get("started_utc"))
    if started is None:
        return ()
    found = []
    for role, entry in _instruments(meta).items():
        until = _day(entry.get("calibrated_until"))
        if until is not None and until < started:
            found.append(
                Expired(
                    role=role,
                    model=cut(str(entry.get("model") or entry.get("driver") or ""), _LONGEST_WORD),
                    serial=cut(str(entry.get("bench_serial") or entry.get("serial") or ""), _LONGEST_WORD),
                    calibrated_until=until,
                    started=started,
                )
            )
    return tuple(found)


def _stated(bench: Bench | None, accuracy_arcsec: float, step_v: float, assumed: str) -> StatedUncertainties:
    table = bench.rate_table.certificate if bench else None
    chamber = bench.chamber.certificate if bench else None
    digitizer = bench.digitizer.certificate if bench else None

    def known(certificate: Certificate | None, name: str) -> Stated:
        return _by(certificate, name) or Stated(standard=ASSUMED[name], says=assumed)

    return StatedUncertainties(
        encoder_arcsec=_by(table, "encoder_arcsec") or _of_encoder(accuracy_arcsec),
        tilt_deg=known(table, "tilt_deg"),
        mounting_deg=known(table, "mounting_deg"),
        gain_ppm=known(digitizer, "gain_ppm"),
        offset_v=_by(digitizer, "offset_v") or _of_converter(step_v),
        clock_ppm=known(digitizer, "clock_ppm"),
        thermometer_c=known(digitizer, "thermometer_c"),
        air_c=known(chamber, "air_c"),
        latitude_deg=_of_latitude(bench, assumed),
    )


def _by(certificate: Certificate | None, name: str) -> Stated | None:
    """Return a figure from a certificate; None if there is no certificate, or it does not state the figure."""
    if certificate is None or (figure := getattr(certificate, name)) is None:
        return None
    return Stated(standard=float(figure) / certificate.k, says=certificate.source)


def _of_encoder(accuracy_arcsec: float) -> Stated:
    """Return the standard uncertainty of a uniform distribution with this half-width (GUM, 4.3.7)."""
    if not accuracy_arcsec:
        return Stated(standard=0.0, says="not known, taken as none")
    return Stated(standard=accuracy_arcsec / math.sqrt(3.0), says=f"±{accuracy_arcsec:g}″ stated, uniform")


def _of_converter(step_v: float) -> Stated:
    if not step_v:
        return Stated(standard=0.0, says="not known, taken as none")
    return Stated(standard=step_v / math.sqrt(12.0), says="one step of the converter, uniform")


def _of_latitude(bench: Bench | None, assumed: str) -> Stated:
    expanded_deg = bench.site.latitude_uncertainty_deg if bench else None
    if expanded_deg is None:
        return Stated(standard=ASSUMED["latitude_deg"], says=assumed)
    return Stated(standard=expanded_deg / _LATITUDE_K, says=f"stated for the site, k = {_LATITUDE_K:g}")


def _instruments(meta: Meta) -> dict[str, dict[str, Any]]:
    """Return what a recording states about its instruments, by their role; empty if it cannot be read."""
    try:
        found = json_document(meta.provenance.get("instruments") or "{}", "instruments")
    except UsageError:
        return {}
    entries = found.items() if isinstance(found, dict) else ()
    return {cut(role, _LONGEST_WORD): entry for role, entry in entries if isinstance(entry, dict)}


def _day(text: object) -> date | None:
    """Return the day of a date or a time in ISO 8601; None if it is not valid."""
    try:
        return datetime.fromisoformat(str(text)).date()
    except ValueError:
        return None
