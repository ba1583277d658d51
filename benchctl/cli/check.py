"""`benchctl check`: dry run of a procedure."""

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
    UnitOption,
    out_option,
    parameters,
    result_of,
)


def check(
    procedure: ProcedureArgument,
    bench: BenchOption,
    parameter: ParameterOption = None,
    unit: UnitOption = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", metavar="FILE", help="Draw the timeline into this SVG or PNG file.")
    ] = None,
    out: Annotated[Path, out_option("Folder of the campaign; default: a new one in results/.")] = Path("results"),
    offline: Annotated[bool, typer.Option("--offline", help="Do not query the identity of the instruments.")] = False,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Dry run: expand the procedure, check every step against the bench, and identify each instrument; nothing moves.

    Also lists the questions to the operator.

    Example: `benchctl check two_stage --bench bench.toml -p points=5 --picture timeline.svg`,
    `benchctl check misalignment --bench simulated --offline`
    """
    from dataclasses import asdict

    from benchctl.app.run import bench_of
    from benchctl.campaign.opened import open_bench
    from benchctl.cli.dry_run import preview
    from benchctl.plan.find import find_procedure

    with result_of("check", json_to, quiet) as result:
        loaded = bench_of(bench, None, unit)
        plan = find_procedure(procedure).expand(parameters(parameter))
        preview(result, plan, loaded, out)
        if picture is not None:
            from benchctl.reports.timeline import draw_timeline

            draw_timeline(picture, plan, loaded.limits, loaded.safe.chamber_c)
            result.say(f"timeline: {picture}")
        if not offline:
            with open_bench(loaded, purpose="benchctl check") as opened:
                result.values["instruments"] = {name: asdict(who) for name, who in opened.identities.items()}
            for name, who in opened.identities.items():
                result.say(f"{name}: {who.manufacturer} {who.model} {who.serial}".rstrip())
