"""`benchctl run`: a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.output import (
    BenchOption,
    JsonOption,
    ParameterOption,
    QuietOption,
    SeedOption,
    parameters,
    result_of,
)


def run(
    procedure: Annotated[str, typer.Argument(help="Its name, or a .py file.")],
    bench: BenchOption,
    parameter: ParameterOption = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="The campaign's folder; default: a new one in results/.")
    ] = None,
    seed: SeedOption = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Run a procedure, record it, and fit it where it calibrates.

    Example: `benchctl run two_stage --bench simulated -p points=5 -p soak_s=3600`
    """
    from benchctl.bench import load_bench
    from benchctl.cli.campaigns import new_folder, play, summary, told
    from benchctl.plan.find import find_procedure
    from instruments.errors import UsageError

    with result_of("run", json_to, quiet) as result:
        stands = load_bench(bench)
        if seed is not None and not stands.simulated:
            raise UsageError(f"--seed {seed}: only a bench with simulated = true has a seed; {stands.name} is none")
        stands = stands.with_seed(seed)
        plan = find_procedure(procedure).expand(parameters(parameter))
        folder = out or new_folder(plan.procedure, stands.unit.serial)
        outcome = play(plan, stands, folder, quiet=quiet)
        result.values |= {"campaign": outcome.campaign, **told(outcome)}
        result.say(summary(outcome))
        if outcome.error is not None:
            raise outcome.error
        if plan.calibrates:
            from benchctl.reports.fitting import fit_recordings

            fitted = fit_recordings([outcome.recording], folder)
            result.values |= {key: fitted.values[key] for key in ("coefficients", "error_percent")}
            result.say(fitted.says)
