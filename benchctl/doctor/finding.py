"""A finding: what was looked at, how it stands, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["ok", "look", "bad"]
"""`ok`: as it should be. `look`: works, or cannot be told, and may cost a campaign. `bad`: does not work."""

MACHINE = "machine"
"""Where the findings belong that are not the bench's."""

UNUSABLE, BENCH_BAD = 2, 3
"""The exit status for input, or a machine, that cannot be used; and for a bench on which something does not answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that was looked at.

    `where` is `machine`, `results`, `ports`, `network`, `bench`, or an instrument's role; `what` the thing in a word or
    two; `says` how it stands; `do` what to do, empty where nothing is to be done. `unusable` marks a bad finding that
    is the input's or this machine's, not the bench's.
    """

    where: str
    what: str
    verdict: Verdict
    says: str
    do: str = ""
    unusable: bool = False


def ok(where: str, what: str, says: str, do: str = "") -> Finding:
    """As it should be."""
    return Finding(where=where, what=what, verdict="ok", says=says, do=do)


def look(where: str, what: str, says: str, do: str) -> Finding:
    """A warning."""
    return Finding(where=where, what=what, verdict="look", says=says, do=do)


def bad(where: str, what: str, says: str, do: str, *, unusable: bool = False) -> Finding:
    """Something that does not work."""
    return Finding(where=where, what=what, verdict="bad", says=says, do=do, unusable=unusable)


def exit_status(findings: Iterable[Finding]) -> int:
    """0 where nothing is bad; 2 where this machine or the input is among what is; 3 where only the bench is."""
    found = [finding for finding in findings if finding.verdict == "bad"]
    if not found:
        return 0
    return UNUSABLE if any(finding.unusable for finding in found) else BENCH_BAD


def summary(findings: Iterable[Finding]) -> str:
    """One line: how many are bad, and what to do first."""
    found = list(findings)
    bads, looks = ([each for each in found if each.verdict == verdict] for verdict in ("bad", "look"))
    if not bads:
        more = f"; {len(looks)} to look at before a long campaign" if looks else ""
        return f"nothing is bad{more}"
    first = next((each for each in bads if each.unusable), bads[0])
    return f"{_count(bads, found)}; first {first.where}, {first.what}: {first.do or first.says}"


def blamed(findings: Iterable[Finding]) -> str:
    """The same, shorter: how many are bad, and where."""
    found = list(findings)
    bads = [each for each in found if each.verdict == "bad"]
    return f"{_count(bads, found)}: {', '.join(dict.fromkeys(each.where for each in bads))}"


def _count(bads: list[Finding], found: list[Finding]) -> str:
    return f"{len(bads)} of {len(found)} findings {'is' if len(bads) == 1 else 'are'} bad"
