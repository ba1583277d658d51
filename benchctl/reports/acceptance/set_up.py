"""The facts of a recording for the acceptance report (unit, bench, place, operator), as rows."""

from __future__ import annotations

import io
import math
from base64 import b64decode
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from PIL import Image

from benchctl.bench import Bench, bench_of_text
from benchctl.campaign.provenance import software
from benchctl.limits import cut
from benchctl.metrology.result import Acceptance
from benchctl.recordings.model import Meta, StepInfo
from benchctl.recordings.reader import Recording
from benchctl.recordings.stated import expired_of
from benchctl.reports import setup_section, text
from benchctl.reports.acceptance.catalogue import Catalogue, duration, exact
from benchctl.reports.acceptance.document import EquipmentRow, Row
from benchctl.reports.coefficient_tables import Coefficient
from benchctl.reports.results import name_of, source_digest
from benchctl_instruments.errors import UsageError

_BEFORE_ANY = datetime(2000, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingFacts:
    """The recording that was judged, deviations from the request, and the coefficients that belong to it.

    `digest` is the recording's SHA-256, or those of the source files of an import; `deviations` are sentences.
    """

    path: Path
    meta: Meta
    infos: tuple[StepInfo, ...]
    digest: str
    deviations: tuple[str, ...] = ()
    coefficients: tuple[Coefficient, ...] = ()

    @property
    def name(self) -> str:
        """The recording's name, without its path."""
        return name_of(self.path)

    @property
    def started(self) -> datetime:
        """The start of the recording, UTC; 1 January 2000 if it is not stated."""
        try:
            start = datetime.fromisoformat(self.meta.provenance.get("started_utc", ""))
        except ValueError:
            return _BEFORE_ANY
        return start.astimezone(UTC) if start.tzinfo else start.replace(tzinfo=UTC)


def facts_of(recording: Recording) -> RecordingFacts:
    """Return the facts of an open recording; raises `UsageError` if an import's list of sources is invalid."""
    return RecordingFacts(
        path=recording.path,
        meta=recording.meta,
        infos=tuple(recording.infos),
        digest=source_digest(recording),
    )


_LOGO_PX = (900, 300)
_JUDGED_WITH = ("benchctl", "python", "numpy", "scipy")
_NOT_STATED = "not stated"
"""The text of `setup_section` for a missing date of a certificate."""


def header(acceptance: Acceptance, facts: RecordingFacts, words: Catalogue) -> tuple[Row, ...]:
    """Return customer, unit, standard, stage, recording and operator; unknown values are left out."""
    meta, papers = facts.meta, acceptance.papers
    provenance = meta.provenance
    firmware = papers.firmware or next(
        (one.firmware for one in setup_section.instruments(meta) if one.role == "gyro"), text.NOT_KNOWN
    )
    rows = (
        ("customer", papers.customer),
        ("unit", meta.unit.model),
        ("serial", meta.unit.serial),
        ("firmware", firmware if firmware != text.NOT_KNOWN else ""),
        ("rated_range", _plus_minus(meta.unit.range_dps, "deg/s", words)),
        ("standard", papers.standard),
        ("stage", words.stage(papers.stage)),
        ("recorded", cut(setup_section.utc(provenance.get("started_utc", "")))),
        ("recording", facts.name),
        ("procedure", provenance.get("procedure", "")),
        ("limits_file", acceptance.limits_name),
        ("bench", provenance.get("bench", "")),
        ("operator", provenance.get("operator", "")),
    )
    return _stated(rows, words)


def laboratory(meta: Meta) -> tuple[str, ...]:
    """Return name and address of the laboratory, if the bench states them."""
    bench = _bench(meta)
    stated = bench.laboratory if bench else None
    return tuple(cut(line) for line in (stated.name, stated.address) if line) if stated else ()


def logo(meta: Meta) -> bytes:
    """Return the laboratory's logo as a PNG image that is small enough for a page; empty if there is none."""
    stream = io.BytesIO()
    try:
        with Image.open(io.BytesIO(b64decode(meta.provenance.get("laboratory_logo", ""))), formats=["PNG"]) as image:
            image.thumbnail(_LOGO_PX)
            image.save(stream, "PNG")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):  # none, or not an image
        return b""
    return stream.getvalue()


def equipment(meta: Meta, words: Catalogue) -> tuple[EquipmentRow, ...]:
    """Return the instruments of the bench; those with an expired certificate are marked."""
    ended = {one.role.replace("_", " ") for one in expired_of(meta)}
    return tuple(
        EquipmentRow(
            role=words.word(one.role.replace(" ", "_"), "roles"),
            model=one.model,
            serial=one.serial,
            certificate=one.certificate,
            until=_until(one.calibrated_until, one.role in ended, words),
            expired=one.role in ended,
        )
        for one in setup_section.instruments(meta)
    )


def environment(facts: RecordingFacts, words: Catalogue) -> tuple[Row, ...]:
    """Return temperatures, place, mounting, sign conventions and sampling."""
    meta, infos = facts.meta, facts.infos
    bench = meta.bench
    length_s = max(i.t_end for i in infos) - min(i.t_start for i in infos) if infos else 0.0
    rows = (
        ("environment", set_points([info.chamber_setpoint_c for info in infos], words)),
        ("mounting", "; ".join(_mounting(meta, infos, words))),
        ("latitude", "" if bench.latitude_deg is None else text.with_unit(exact(bench.latitude_deg, words), "°")),
        ("encoder", _encoder(meta, words)),
        ("converter", _converter(meta, words)),
        ("sample_rate", _with_unit(setup_section.sample_rate_hz(meta, infos), "Hz", words)),
        ("duration", duration(length_s, words) if infos else ""),
        ("steps", _steps(infos, words)),
        ("parameters", ", ".join(f"{name} = {value}" for name, value in setup_section.parameters(meta).items())),
    )
    return _stated(rows, words)


def traceability(acceptance: Acceptance, facts: RecordingFacts, words: Catalogue) -> tuple[Row, ...]:
    """Return the digests of all inputs of the report, and the versions of the programs."""
    recorded_with = setup_section.json_object(facts.meta.provenance.get("software", "")) or {}
    rows = (
        (words.label("recording_sha256"), facts.digest),
        (words.label("limits_sha256", file=acceptance.limits_name), acceptance.limits_sha256),
        (words.label("procedure_sha256"), facts.meta.provenance.get("procedure_sha256", "")),
        (words.label("recorded_with"), _versions(recorded_with)),
        (words.label("judged_with"), _versions({name: software()[name] for name in _JUDGED_WITH})),
    )
    return tuple((name, value) for name, value in rows if value)


def deviations(facts: RecordingFacts, words: Catalogue) -> tuple[str, ...]:
    """Return the deviations of the recording from the procedure, and those that the operator states."""
    found = []
    for info in facts.infos:
        step = f"{info.index} ({info.name})"
        if info.is_cut_attempt:
            found.append(words.label("made_again", step=step))
        if info.gaps:
            found.append(words.label("stream_gaps", step=step, count=str(info.gaps)))
    return (*found, *facts.deviations)


def _stated(rows: Iterable[tuple[str, str]], words: Catalogue) -> tuple[Row, ...]:
    return tuple((words.label(key), value) for key, value in rows if value)


def _until(told: str, expired: bool, words: Catalogue) -> str:
    if told == _NOT_STATED:
        return words.label("not_stated")
    return words.label("expired", date=told) if expired else told


def set_points(celsius: Iterable[float], words: Catalogue) -> str:
    """Return the range of the chamber's set points, °C; empty if none is known."""
    known = [value for value in celsius if math.isfinite(value)]
    if not known:
        return ""
    low, high = (exact(end, words) for end in (min(known), max(known)))
    return words.label("set_point", low=low) if low == high else words.label("set_points", low=low, high=high)


def _mounting(meta: Meta, infos: Iterable[StepInfo], words: Catalogue) -> Iterator[str]:
    moved = [str(info.index) for info in infos if info.kind == "mount"]
    yield words.label("mounted_both", steps=", ".join(moved)) if moved else words.label("mounted")
    yield words.label("sign")
    bench = _bench(meta)
    if bench is not None and bench.digitizer.encoder_sign < 0:
        yield words.label("encoder_reversed")


def _bench(meta: Meta) -> Bench | None:
    """Return the bench.toml stored in a recording; None if there is none that this version can read."""
    try:
        return bench_of_text(meta.provenance.get("bench_toml", ""), "bench.toml")
    except UsageError:
        return None


def _encoder(meta: Meta, words: Catalogue) -> str:
    counts, accuracy = meta.bench.encoder_counts_per_rev, meta.bench.encoder_accuracy_arcsec
    if not counts:
        return ""
    if not accuracy:
        return words.label("encoder_counts", counts=text.count(counts))
    return words.label("encoder_told", counts=text.count(counts), accuracy=exact(accuracy, words))


def _converter(meta: Meta, words: Catalogue) -> str:
    bits, range_v = meta.bench.adc_bits, meta.bench.adc_range_v
    return words.label("converter_told", bits=str(bits), range=exact(range_v, words)) if bits else ""


def _steps(infos: tuple[StepInfo, ...], words: Catalogue) -> str:
    samples = text.count(sum(info.samples for info in infos))
    return words.label("steps_told", steps=str(len(infos)), samples=samples) if infos else ""


def _plus_minus(value: float, unit: str, words: Catalogue) -> str:
    return f"±{_with_unit(value, unit, words)}" if value else ""


def _with_unit(value: float, unit: str, words: Catalogue) -> str:
    return text.with_unit(exact(value, words), words.unit(unit)) if value else ""


def _versions(told: Mapping[str, object]) -> str:
    return ", ".join(f"{name} {version}" for name, version in told.items())
