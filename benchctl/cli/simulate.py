"""`benchctl simulate`: record a procedure on the simulated bench, without the instrument protocols."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.output import (
    BenchOption,
    JsonOption,
    ParameterOption,
    ProcedureArgument,
    QuietOption,
    SeedOption,
    parameters,
    result_of,
    toml_option,
)


def simulate(
    procedure: ProcedureArgument,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.h5", help="The recording to write.")],
    bench: BenchOption = "simulated",
    model: Annotated[
        Path | None,
        toml_option("--model", "A model file that the simulated bench follows, for example from a diagnosis."),
    ] = None,
    parameter: ParameterOption = None,
    seed: SeedOption = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Record a procedure on the simulated bench without the instrument protocols: same physics and runner, but faster.

    Example: `benchctl simulate rate_sweep -o sweep.h5 --seed 7`
    """
    from benchctl.app import run as app
    from benchctl.cli.campaigns import at_terminal
    from benchctl.plan.find import find_procedure

    with result_of("simulate", json_to, quiet) as result:
        loaded = app.bench_of(bench, None)
        plan = find_procedure(procedure).expand(parameters(parameter))
        outcome = app.simulate(plan, loaded, output, watch=at_terminal(quiet), model=model, seed=seed)
        result.values |= outcome.values()
        result.say(f"{output}: {outcome.whole} steps, {outcome.samples:,} samples in {outcome.wall_time_s:.1f} s")
