"""Rows of a page that describe where, when and how a recording was made."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchctl.documents import json_document
from benchctl.limits import cut
from benchctl.recordings.model import Meta, StepInfo
from benchctl.reports import text
from benchctl_instruments.errors import UsageError

_KIND_NAMES: Mapping[str, str] = {
    "soak": "soak",
    "static": "at rest",
    "constant_rate": "constant rate",
    "sine": "sine",
    "thermal_ramp": "thermal ramp",
    "motion": "other motion",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Instrument:
    """An instrument of the bench with its identification and the end of its calibration."""

    role: str
    model: str
    serial: str
    firmware: str
    calibrated_until: str
    certificate: str


def kind_name(kind: str) -> str:
    """Return a kind of step in words."""
    return _KIND_NAMES.get(kind, kind.replace("_", " "))


def facts(meta: Meta, infos: Sequence[StepInfo]) -> list[tuple[str, str]]:
    """Return names and values that describe the set-up; unknown values are left out."""
    stated, bench = meta.provenance, meta.bench
    recorded = [info for info in infos if info.samples]
    rows = [
        ("Gyro", " ".join(part for part in (meta.unit.model, f"serial {meta.unit.serial}") if part)),
        ("Rated range", f"±{text.plain(meta.unit.range_dps, '°/s')}" if meta.unit.range_dps else ""),
        ("Bench", stated.get("bench", "")),
        ("Operator", stated.get("operator", "")),
        ("Started", utc(stated.get("started_utc", ""))),
        ("Procedure", stated.get("procedure", "")),
        ("Parameters", ", ".join(f"{name} = {_listed(value)}" for name, value in parameters(meta).items())),
        ("Duration", text.duration(max(i.t_end for i in infos) - min(i.t_start for i in infos)) if infos else ""),
        ("Samples", f"{text.count(sum(i.samples for i in infos))} in {len(recorded)} recorded steps of {len(infos)}"),
        ("Sample rate", text.plain(sample_rate_hz(meta, infos) or None, "Hz", 3)),
        ("Encoder", _encoder(meta)),
        ("Converter", f"{bench.adc_bits} bits over ±{text.plain(bench.adc_range_v, 'V')}" if bench.adc_bits else ""),
        ("Latitude", text.plain(bench.latitude_deg, "°", 3) if bench.latitude_deg is not None else ""),
        ("Treatment of the import", stated.get("treatment", "")),
    ]
    return [(name, value) for name, value in rows if value]


def sample_rate_hz(meta: Meta, infos: Sequence[StepInfo]) -> float:
    """Return the sample rate of the steps; if they differ or do not state it, the requested one."""
    rates_hz = {info.sample_rate_hz for info in infos if info.samples}
    return (rates_hz.pop() if len(rates_hz) == 1 else None) or meta.bench.sample_rate_hz


def parameters(meta: Meta) -> dict[str, object]:
    """Return the procedure's parameters by name."""
    return _mapping(meta.provenance.get("parameters", ""))


def instruments(meta: Meta) -> list[Instrument]:
    """Return the instruments that the recording names."""
    found = []
    for role, described in _mapping(meta.provenance.get("instruments", "")).items():
        described = described if isinstance(described, dict) else {}
        maker, model = (str(described.get(key) or "") for key in ("manufacturer", "model"))
        found.append(
            Instrument(
                role=role.replace("_", " "),
                model=" ".join(part for part in (maker, model or str(described.get("driver") or "")) if part)
                or text.NOT_KNOWN,
                serial=str(described.get("bench_serial") or described.get("serial") or text.NOT_KNOWN),
                firmware=str(described.get("firmware") or text.NOT_KNOWN),
                calibrated_until=str(described.get("calibrated_until") or "not stated"),
                certificate=str(described.get("certificate") or text.NOT_KNOWN),
            )
        )
    return found


def provenance(meta: Meta, digest: str) -> list[tuple[str, str]]:
    """Return the digests, and the programs with their versions."""
    rows = [
        ("Recording, SHA-256", digest),
        ("Procedure, SHA-256", meta.provenance.get("procedure_sha256", "")),
        *((name, str(version)) for name, version in _mapping(meta.provenance.get("software", "")).items()),
    ]
    return [(name, value) for name, value in rows if value]


def step_groups(infos: Sequence[StepInfo], uses: Mapping[int, str]) -> list[dict[str, object]]:
    """Summarize the steps by kind and use, in order of first occurrence; `uses` gives the use of each step."""
    groups: dict[tuple[str, str], list[StepInfo]] = {}
    for info in infos:
        groups.setdefault((info.kind, uses.get(info.index, "not used")), []).append(info)
    return [
        {
            "kind": kind_name(kind),
            "use": use,
            "steps": len(members),
            "rates": _span([info.amplitude_dps or info.rate_dps for info in members], "°/s"),
            "frequencies": _levels([info.frequency_hz for info in members], "Hz"),
            "temperatures": _span([info.chamber_setpoint_c for info in members], "°C"),
            "samples": sum(info.samples for info in members),
        }
        for (kind, use), members in groups.items()
    ]


def cut_steps(infos: Sequence[StepInfo]) -> list[str]:
    """Return a sentence for each incomplete step and each step with gaps in its stream."""
    cut = [f"step {info.index} ({info.name}) is not complete" for info in infos if not info.whole]
    gaps = [f"step {i.index} ({i.name}): {i.gaps} gaps in the stream" for i in infos if i.gaps]
    return cut + gaps


def _encoder(meta: Meta) -> str:
    bench = meta.bench
    counts = f"{text.count(bench.encoder_counts_per_rev)} counts a revolution" if bench.encoder_counts_per_rev else ""
    accuracy = f"accurate to {text.plain(bench.encoder_accuracy_arcsec, '″')}" if bench.encoder_accuracy_arcsec else ""
    return ", ".join(part for part in (counts, accuracy) if part)


def _span(values: Sequence[float | None], unit: str) -> str:
    known = [value for value in values if value is not None and math.isfinite(value)]
    return text.span(min(known), max(known), unit) if known else ""


def _levels(values: Sequence[float | None], unit: str) -> str:
    known = sorted({value for value in values if value})
    if not known:
        return ""
    return text.with_unit(", ".join(text.plain(value, "", 3) for value in known), unit)


def utc(stamp: str) -> str:
    """Return a time stamp as printed."""
    return stamp.replace("T", " ").replace("+00:00", " UTC")


def _listed(value: object) -> str:
    return "(" + ", ".join(str(item) for item in value) + ")" if isinstance(value, list) else str(value)


def _mapping(recorded: str) -> dict[str, object]:
    """Return a JSON object of the provenance; text that cannot be parsed is kept under the key `as recorded`."""
    found = json_object(recorded)
    return {"as recorded": cut(recorded)} if found is None else found


def json_object(recorded: str) -> dict[str, object] | None:
    """Return a JSON object of the provenance, empty if nothing was recorded; None if it is not one."""
    try:
        found = json_document(recorded, "provenance") if recorded else {}
    except UsageError:
        return None
    return found if isinstance(found, dict) else None
