"""`benchctl check`: a dry run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.output import BenchOption, JsonOption, ParameterOption, QuietOption, parameters, result_of


def check(
    procedure: Annotated[str, typer.Argument(help="Its name, or a .py file.")],
    bench: BenchOption,
    parameter: ParameterOption = None,
    picture: Annotated[Path | None, typer.Option(help="Draw the timeline into this SVG or PNG file.")] = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Where the campaign is to land; default: in results/.")
    ] = Path("results"),
    offline: Annotated[bool, typer.Option("--offline", help="Do not ask the instruments who they are.")] = False,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """A dry run: expand the procedure, check every step against the bench, ask each instrument who it is; move nothing.

    Example: `benchctl check two_stage --bench bench.toml -p points=5 --picture timeline.svg`
    """
    from dataclasses import asdict

    from benchctl.atomic import free_bytes
    from benchctl.bench import load_bench
    from benchctl.campaign.check import bench_time_s, problems, room_problems
    from benchctl.campaign.expiry import expiring
    from benchctl.campaign.interlocks import words
    from benchctl.campaign.opened import open_bench
    from benchctl.campaign.timing import disk_bytes
    from benchctl.cli.timeline import timeline_lines
    from benchctl.cli.words import duration, size
    from benchctl.plan.find import find_procedure
    from instruments.errors import UsageError

    with result_of("check", json_to, quiet) as result:
        stands = load_bench(bench)
        plan = find_procedure(procedure).expand(parameters(parameter))
        found = problems(plan, stands)
        playable = not found
        takes_s = bench_time_s(plan, stands) if playable else None
        needs = disk_bytes(plan, stands.recorded_hz) if playable else None
        free = free_bytes(out)
        found += room_problems(plan, stands, out) if playable else []
        warnings = [each.says for each in expiring(plan, stands)] if playable else []
        result.values |= {
            "steps": len(plan.steps),
            "bench_time_s": takes_s,
            "disk_bytes": needs,
            "disk_free_bytes": free,
            "problems": [asdict(problem) for problem in found],
            "warnings": warnings,
        }
        for warning in warnings:
            result.say(f"warning: {warning}")
        if found:
            for problem in found:
                result.say(f"step {problem.step}: {problem.says}")
            beyond = f"{len(found)} of its {len(plan.steps)} steps go beyond it; the first is "
            raise UsageError(
                f"procedure {plan.procedure} cannot run on {stands.name}: {'' if playable else beyond}"
                f"step {found[0].step}, {found[0].says}"
            )
        result.say(
            f"{plan.procedure} on {stands.name}: {len(plan.steps)} steps, at least {duration(takes_s or 0)}, "
            f"{size(needs or 0)} on disk ({size(free)} are free at {out})"
        )
        for line in timeline_lines(plan, stands.limits, stands.safe.chamber_c):
            result.say(line)
        if stands.interlocks:
            result.say(f"interlocks: {words(stands.interlocks)}")
        if picture is not None:
            from benchctl.reports.timeline import draw_timeline

            draw_timeline(picture, plan, stands.limits, stands.safe.chamber_c)
            result.say(f"timeline: {picture}")
        if not offline:
            with open_bench(stands, purpose="benchctl check") as opened:
                result.values["instruments"] = {name: asdict(who) for name, who in opened.identities.items()}
            for name, who in opened.identities.items():
                result.say(f"{name}: {who.manufacturer} {who.model} {who.serial}".rstrip())
