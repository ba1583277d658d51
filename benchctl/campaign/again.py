"""Read the plan and the bench of a recording, so that it can be run again."""

from __future__ import annotations

import json
from typing import Any

from benchctl.bench import Bench
from benchctl.campaign.opened import another_day, as_drawn
from benchctl.campaign.provenance import recorded_bench, table_of
from benchctl.limits import cut, listed, shown
from benchctl.plan import Plan
from benchctl.plan.find import find_procedure, procedure_names
from benchctl.plan.procedure import Procedure
from benchctl.recordings.model import Meta
from benchctl_instruments.errors import UsageError

CHOSEN_HERE = (
    "physics.seed",
    "physics.encoder.eccentricity_phase_deg",
    "physics.encoder.ellipticity_phase_deg",
)
"""Dotted names of what `bench_again` sets on a simulated bench if no seed is given."""

_LONGEST_WORD = 200


def plan_again(meta: Meta, whose: str) -> Plan:
    """Return the plan of a recording's procedure, as it is installed today, with the recording's parameters.

    The procedure source stored in the recording is never run, nor a file that it names. `whose` names the recording in
    errors.

    Raises
    ------
    UsageError
        The recording does not state its procedure, the procedure is not installed, or the installed one does not accept
        the recorded parameters.
    """
    name = meta.provenance.get("procedure", "")
    if not name:
        how = "it was imported" if meta.status == "imported" else "it does not say how it was made"
        raise UsageError(
            f"--again {whose}: {how}, and so names no procedure to run again; run one by its name (benchctl procedures "
            "lists them) and hold the two against each other with benchctl compare"
        )
    installed = procedure_names()
    if name not in installed:
        raise UsageError(
            f"--again {whose}: its procedure {shown(name)} is not installed, and the source that the recording keeps "
            f"is not run; there are {listed(installed)}; install it (entry points benchctl.procedures), or run its "
            "file: benchctl run FILE.py --bench BENCH"
        )
    try:
        procedure = find_procedure(name)
        return procedure.expand(_texts(procedure, table_of(meta, "parameters", whose)))
    except UsageError as err:
        raise UsageError(f"--again {whose}: {cut(str(err))}") from err


def bench_again(meta: Meta, whose: str, named: Bench | None, seed: int | None) -> Bench:
    """Return the bench for the new run: `named` if given, else the recorded bench if it was simulated.

    A simulated bench has the noise of `seed`. Without `seed` it gets new noise, as on another day on the same bench:
    the recorded seed plus one, with the recorded encoder mounting.

    Raises
    ------
    UsageError
        No bench is named and the recorded one was real, the recorded bench cannot be read, or another unit is on it.
    """
    made_on = _simulated(meta, whose) if named is None or named.simulated else None
    bench = named or made_on
    if bench is None:
        raise UsageError(
            f"--again {whose}: was not made on a simulated bench; name the bench to run it on with --bench FILE"
        )
    if bench.unit.serial != meta.unit.serial:
        raise UsageError(
            f"--again {whose}: it is of unit {cut(meta.unit.serial, _LONGEST_WORD)}, and {bench.name} has unit "
            f"{bench.unit.serial}; mount the same unit and state it in [unit] of the bench, or run the procedure anew"
        )
    if not bench.simulated or seed is not None:
        return bench.with_seed(seed)
    return bench if made_on is None else _on_the_day_after(made_on, bench)


def _simulated(meta: Meta, whose: str) -> Bench | None:
    """Return the bench that the recording was made on; None if its instruments were not simulated."""
    if not meta.provenance.get("bench_toml"):
        return None
    bench = recorded_bench(meta, whose)
    return bench if bench.simulated else None


def _on_the_day_after(first: Bench, bench: Bench) -> Bench:
    """Return `bench` with noise that neither bench has had; its encoder is mounted as in `first` unless stated."""
    return as_drawn(bench, another_day(first, 1).physics)


def _texts(procedure: Procedure, recorded: dict[str, Any]) -> dict[str, str]:
    """Return recorded parameters as command-line texts, without those equal to the installed defaults."""
    defaults = {one.name: json.loads(json.dumps(one.default)) for one in procedure.parameters}
    return {
        name: parameter_text(value)
        for name, value in recorded.items()
        if name not in defaults or defaults[name] != value
    }


def parameter_text(value: object) -> str:
    """Return the value of a parameter as a text of the command line."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ",".join(parameter_text(item) for item in value)
    return str(value)
