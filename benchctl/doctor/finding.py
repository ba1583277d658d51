"""A finding of the doctor: what was checked, the result, and what to do."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["ok", "look", "bad"]
"""`ok`: works. `look`: a warning. `bad`: does not work."""

UNUSABLE, BENCH_BAD = 2, 3
"""Exit status for input or a machine that cannot be used; and for a bench on which something does not answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One check.

    `where` is `machine`, `results`, `ports`, `bench`, or an instrument's role; `what` the checked item; `message` the
    result; `do` the advice, empty if nothing is to be done. `unusable` marks a bad finding that is caused by the
    input or this machine, not by the bench.
    """

    where: str
    what: str
    verdict: Verdict
    message: str
    do: str = ""
    unusable: bool = False


def ok(where: str, what: str, message: str, do: str = "") -> Finding:
    """Return a finding that is as expected."""
    return Finding(where=where, what=what, verdict="ok", message=message, do=do)


def look(where: str, what: str, message: str, do: str) -> Finding:
    """Return a warning."""
    return Finding(where=where, what=what, verdict="look", message=message, do=do)


def bad(where: str, what: str, message: str, do: str, *, unusable: bool = False) -> Finding:
    """Return a finding of something that does not work."""
    return Finding(where=where, what=what, verdict="bad", message=message, do=do, unusable=unusable)


def exit_status(findings: Iterable[Finding]) -> int:
    """Return 0 without a bad finding, 2 if this machine or the input is bad, 3 if only the bench is."""
    bads = [finding for finding in findings if finding.verdict == "bad"]
    if not bads:
        return 0
    return UNUSABLE if any(finding.unusable for finding in bads) else BENCH_BAD


def summary(findings: Iterable[Finding]) -> str:
    """Return one line: how many findings are bad, and what to do first."""
    found = list(findings)
    bads, warnings = ([each for each in found if each.verdict == verdict] for verdict in ("bad", "look"))
    if not bads:
        more = f"; {len(warnings)} to look at before a long campaign" if warnings else ""
        return f"nothing is bad{more}"
    first = next((each for each in bads if each.unusable), bads[0])
    return f"{_count(bads, found)}; first {first.where}, {first.what}: {first.do or first.message}"


def blamed(findings: Iterable[Finding]) -> str:
    """Return one short line: how many findings are bad, and where."""
    found = list(findings)
    bads = [each for each in found if each.verdict == "bad"]
    return f"{_count(bads, found)}: {', '.join(dict.fromkeys(each.where for each in bads))}"


def _count(bads: list[Finding], found: list[Finding]) -> str:
    return f"{len(bads)} of {len(found)} findings {'is' if len(bads) == 1 else 'are'} bad"
