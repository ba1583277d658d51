"""Where a recording comes from: procedure, bench, instruments, software, operator, time; and the bench again."""

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

if TYPE_CHECKING:  # reports read provenance, and need no bench with all its physics for it
    from benchctl.campaign.opened import OpenBench


def describe(opened: OpenBench, plan: Plan, status: Status) -> Meta:
    """Everything about a campaign that is not a sample, as its recording keeps it."""
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
    """The bench that a recording was made on, as it keeps it; `whose` names the recording in an error.

    Raises
    ------
    UsageError
        Where it keeps none, or its texts are no bench.
    """
    provenance = meta.provenance
    text = provenance.get("bench_toml", "")
    bench = bench_of_text(text, f"the bench.toml of {whose}", provenance.get("chamber_profile", ""))
    obeyed = {name: table_of(meta, f"bench_{name}", whose) for name in ("physics", "effects")}
    return bench.model_copy(update={name: table for name, table in obeyed.items() if provenance.get(f"bench_{name}")})


def table_of(meta: Meta, name: str, whose: str) -> dict[str, Any]:
    """A table that a recording's provenance keeps as JSON; empty where there is none, `UsageError` where it is none."""
    text = meta.provenance.get(name)
    found = json_document(text, f"{name} of {whose}") if text else {}
    if not isinstance(found, dict):
        raise UsageError(f"{name} of {whose}: expected a table (a JSON object), got {shown(found)}")
    return found


def bench_facts(bench: Bench) -> BenchFacts:
    """What fits must know of the bench."""
    return BenchFacts(
        sample_rate_hz=bench.digitizer.sample_rate_hz,
        encoder_counts_per_rev=bench.digitizer.encoder_counts_per_rev,
        encoder_accuracy_arcsec=bench.digitizer.encoder_accuracy_arcsec,
        adc_bits=bench.digitizer.adc_bits,
        adc_range_v=bench.digitizer.adc_range_v,
        latitude_deg=bench.site.latitude_deg,
    )


def software() -> dict[str, str]:
    """Versions of what a result depends on."""
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
    except (OSError, KeyError):  # no such user is known here, as in many containers
        return ""
