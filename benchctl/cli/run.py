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
    resume: Annotated[
        Path | None, typer.Option("--resume", metavar="CAMPAIGN", help="Go on with a campaign that ended early.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Resume without asking before the table moves.")] = False,
    seed: SeedOption = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Run a procedure, record it, and fit it where it calibrates; or go on with a campaign that ended early.

    Example: `benchctl run two_stage --bench simulated -p points=5 -p soak_s=3600`; after a crash the same command with
    `--resume results/20261120-180000_two_stage_SIM-0001`
    """
    from benchctl.bench import load_bench
    from benchctl.cli.campaigns import new_folder, play, summary, told
    from benchctl.cli.resuming import resumed
    from benchctl.plan.find import find_procedure
    from instruments.errors import UsageError

    with result_of("run", json_to, quiet) as result:
        stands = load_bench(bench)
        if seed is not None and not stands.simulated:
            raise UsageError(f"--seed {seed}: only a bench with simulated = true has a seed; {stands.name} is none")
        stands = stands.with_seed(seed)
        plan = find_procedure(procedure).expand(parameters(parameter))
        if resume is not None and out is not None:
            raise UsageError(f"--out {out}: a campaign that is resumed stays in its folder, {resume}")
        if resume is not None:
            outcome = resumed(plan, stands, resume, seeded=seed is not None, yes=yes, quiet=quiet)
        else:
            outcome = play(plan, stands, out or new_folder(plan.procedure, stands.unit.serial), quiet=quiet)
        result.values |= {"campaign": outcome.campaign, **told(outcome)}
        result.say(summary(outcome))
        if outcome.error is not None:
            raise outcome.error
        if plan.calibrates:
            from benchctl.reports.fitting import fit_recordings

            fitted = fit_recordings([outcome.recording], outcome.campaign)
            result.values |= {key: fitted.values[key] for key in ("coefficients", "error_percent")}
            result.say(fitted.says)
