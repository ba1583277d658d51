"""`benchctl doctor`: what may keep a bench from working, and what to do about it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchctl.cli.candidates import bench_files
from benchctl.cli.output import JsonOption, QuietOption, result_of

if TYPE_CHECKING:
    from benchctl.doctor.finding import Finding

_TITLES = {
    "machine": "This machine",
    "results": "Where campaigns land",
    "ports": "Serial ports",
    "network": "Network",
    "bench": "The bench",
}
_WIDEST = 20


def doctor(
    bench: Annotated[
        str | None,
        typer.Option(
            "--bench",
            metavar="BENCH",
            autocompletion=bench_files,
            help="A bench.toml, whose ports and instruments are looked at, too.",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Where campaigns are to land; default: in results/.")
    ] = Path("results"),
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Look at this machine, at ports, network and instruments, and say what to do; move nothing.

    An instrument is asked who it is, as `benchctl check` does, unless another program has it. Exit status 0: nothing
    is bad; 2: this machine or the bench's file cannot be used; 3: something on the bench does not answer.
    Example: `benchctl doctor --bench bench.toml`
    """
    from dataclasses import asdict

    from benchctl.doctor.examine import examine
    from benchctl.doctor.finding import UNUSABLE, blamed, exit_status, summary
    from benchctl_instruments.errors import LinkError, UsageError

    with result_of("doctor", json_to, quiet) as result:
        found: list[Finding] = []
        group = ""
        for finding in examine(bench, out):
            if finding.where != group:
                group = finding.where
                result.say(f"{'' if not found else chr(10)}{_TITLES.get(group, group)}")
            found.append(finding)
            for line in lines_of(finding):
                result.say(line)
        told = [asdict(finding) for finding in found]
        result.values["findings"] = [{name: each[name] for name in _KEYS} for each in told]
        result.say(f"\n{summary(found)}")
        status = exit_status(found)
        if status:
            raise (UsageError if status == UNUSABLE else LinkError)(blamed(found))


_KEYS = ("where", "what", "verdict", "says", "do")


def lines_of(finding: Finding) -> list[str]:
    """A finding for a person: how it stands, and, where something is to be done, what."""
    lines = [f"  {finding.verdict:<4}  {finding.what:<{_WIDEST}}  {finding.says}"]
    if finding.do:
        lines.append(f"  {'':<4}  {'':<{_WIDEST}}  -> {finding.do}")
    return lines
