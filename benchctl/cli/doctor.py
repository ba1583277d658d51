"""`benchctl doctor`: check this machine and a bench, and advise what to do."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from benchctl.cli.output import JsonOption, QuietOption, bench_option, out_option, result_of

if TYPE_CHECKING:
    from benchctl.doctor.finding import Finding

_TITLES = {
    "machine": "This machine",
    "results": "Where campaigns land",
    "ports": "Serial ports",
    "bench": "The bench",
}
_WIDEST = 20


def doctor(
    bench: Annotated[str | None, bench_option("A bench.toml; its ports and instruments are also checked.")] = None,
    out: Annotated[Path, out_option("Folder of the campaigns; default: results/.")] = Path("results"),
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Check disk, ports, permissions, network and instruments, and advise what to do; nothing moves.

    Instruments are identified as by `benchctl check`, unless another program uses them. Exit status 0: nothing is bad;
    2: this machine or the bench file cannot be used; 3: a device on the bench does not answer.
    Example: `benchctl doctor --bench bench.toml`
    """
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
        result.values["findings"] = [
            {"where": each.where, "what": each.what, "verdict": each.verdict, "says": each.message, "do": each.do}
            for each in found
        ]
        result.say(f"\n{summary(found)}")
        status = exit_status(found)
        if status:
            raise (UsageError if status == UNUSABLE else LinkError)(blamed(found))


def lines_of(finding: Finding) -> list[str]:
    """Return the lines that show a finding at the terminal."""
    lines = [f"  {finding.verdict:<4}  {finding.what:<{_WIDEST}}  {finding.message}"]
    if finding.do:
        lines.append(f"  {'':<4}  {'':<{_WIDEST}}  -> {finding.do}")
    return lines
