"""Describe where a recording comes from: procedure, bench, instruments, software, operator, time; restore its bench."""

from __future__ import annotations

import datetime
import getpass
import hashlib
import json
import platform
import sys
from dataclasses import asdict
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import benchctl
from benchctl.bench import Bench, bench_of_text
from benchctl.documents import json_document
from benchctl.limits import shown
from benchctl.plan import Plan
from benchctl.recordings.model import BenchFacts, Meta, Status, Unit
from benchctl_instruments.errors import UsageError

if TYPE_CHECKING:  # reports read provenance and do not need a bench with all its physics
    from benchctl.campaign.opened import OpenBench


def describe(opened: OpenBench, plan: Plan, status: Status) -> Meta:
    """Return everything about a campaign that is not a sample, as its recording stores it."""
    bench = opened.bench
    instruments = {
        name: {
            **asdict(opened.identities[name]),
            "bench_serial": entry.serial,
            "calibrated_until": str(entry.calibrated_until or ""),
            "certificate": entry.certificate.number if entry.certificate else "",
            "driver": entry.model,
        }
        for name, entry in bench.entries.items()
    }
    return Meta(
        status=status,
        unit=Unit(serial=bench.unit.serial, range_dps=bench.unit.range_dps, model=bench.unit.model),
        bench=bench_facts(bench),
        simulation=None if bench.simulation is None else bench.simulation.model_dump(mode="json"),
        provenance={
            "procedure": plan.procedure,
            "procedure_source": plan.source,
            "procedure_sha256": hashlib.sha256(plan.source.encode()).hexdigest(),
            "parameters": json.dumps(dict(plan.parameters), sort_keys=True),
            "bench": bench.name,
            "bench_toml": bench.text,
            "chamber_profile": bench.chamber_profile,
            "laboratory_logo": bench.logo,
            "bench_physics": json.dumps(bench.physics, sort_keys=True) if bench.simulated else "",
            "bench_effects": json.dumps(bench.effects, sort_keys=True) if bench.simulated else "",
            "instruments_reached": opened.reached,
            "instruments": json.dumps(instruments, sort_keys=True),
            "software": json.dumps(software(), sort_keys=True),
            "operator": bench.operator or _user(),
            "started_utc": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        },
    )


def recorded_bench(meta: Meta, whose: str) -> Bench:
    """Return the bench that a recording was made on, from its stored texts; `whose` names the recording in errors.

    Raises
    ------
    UsageError
        The recording stores no bench, or its texts are not a valid bench.
    """
    provenance = meta.provenance
    text = provenance.get("bench_toml", "")
    bench = bench_of_text(text, f"the bench.toml of {whose}", provenance.get("chamber_profile", ""))
    obeyed = {name: table_of(meta, f"bench_{name}", whose) for name in ("physics", "effects")}
    stored = {name: table for name, table in obeyed.items() if provenance.get(f"bench_{name}")}
    bench = bench.with_unit(meta.unit.serial)  # a run may name another than its bench.toml
    return bench.silent().model_copy(update=stored)  # the URLs of its messages are masked


def table_of(meta: Meta, name: str, whose: str) -> dict[str, Any]:
    """Return a table that the provenance stores as JSON; empty if it is absent, `UsageError` if it is not a table."""
    text = meta.provenance.get(name)
    found = json_document(text, f"{name} of {whose}") if text else {}
    if not isinstance(found, dict):
        raise UsageError(f"{name} of {whose}: expected a table (a JSON object), got {shown(found)}")
    return found


def bench_facts(bench: Bench) -> BenchFacts:
    """Return the facts about the bench that fits need."""
    return BenchFacts(
        sample_rate_hz=bench.digitizer.sample_rate_hz,
        encoder_counts_per_rev=bench.digitizer.encoder_counts_per_rev,
        encoder_accuracy_arcsec=bench.digitizer.encoder_accuracy_arcsec,
        adc_bits=bench.digitizer.adc_bits,
        adc_range_v=bench.digitizer.adc_range_v,
        latitude_deg=bench.site.latitude_deg,
    )


def software() -> dict[str, str]:
    """Return the versions of the software that a result depends on."""
    names = ("numpy", "scipy", "h5py", "pymodbus", "pyserial")
    return {
        "benchctl": benchctl.__version__,
        "python": sys.version.split()[0],
        "platform": platform.platform(),
        **{name: version(name) for name in names},
    }


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # the user has no name here, as in many containers
        return ""
