"""Two runs of one procedure for a terminal: what differs in how they were made, then test by test, then in short."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from textwrap import wrap

from benchctl.limits import cut
from benchctl.metrology.rerun import Compared
from benchctl.reports import text
from benchctl.reports.acceptance.catalogue import Catalogue, catalogue
from benchctl.reports.acceptance.values import stated
from benchctl.reports.rerunning import Rerun

_WIDEST = 120
_GAP = 2
_GROUP = 13
_TITLES = {"bench": "bench.toml"}
_HEADINGS = ("test", "E_n", "", "first ± U", "again ± U", "difference ± U")


def lines(rerun: Rerun) -> str:
    """A line or more a group, a line a test, and what follows; none wider than 120 characters."""
    told = [*_of_the_runs(rerun), *_of_groups(rerun), "", *_of_tests(rerun), *_in_short(rerun)]
    return "\n".join(cut(_plain(line), _WIDEST) for line in told)


def _of_the_runs(rerun: Rerun) -> Iterator[str]:
    first, (before, now) = rerun.first, rerun.seeds
    told = first.meta.provenance
    made = ", ".join(filter(None, (told.get("procedure"), told.get("started_utc"), first.meta.status)))
    yield f"{'first':{_GROUP}}{first.path}: {made}, unit {first.meta.unit.serial}"
    if now is not None:
        seed = f"seed {now} where the first run had {text.NOT_KNOWN if before is None else before}"
        yield f"{'noise':{_GROUP}}simulated, {'the same: ' if now == before else 'drawn anew: '}{seed}"


def _of_groups(rerun: Rerun) -> Iterator[str]:
    for group, told in asdict(rerun.differences).items():
        yield from _group(_TITLES.get(group, group), told)
    if rerun.first.stated is None:
        yield f"{'acceptance':{_GROUP}}none lies beside the first run"
    else:
        yield from _group("acceptance", rerun.first.unlike_stated)


def _group(title: str, told: Iterable[str]) -> Iterator[str]:
    first, *more = tuple(told) or ("the same",)
    yield f"{title:{_GROUP}}{first}"
    yield from (f"{'':{_GROUP}}{line}" for line in more)


def _of_tests(rerun: Rerun) -> Iterator[str]:
    words = catalogue("en")
    rows = [_HEADINGS, *(_row(one, words) for one in rerun.tests if one.is_told)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "".join(cell.ljust(width + _GAP) for cell, width in zip(row, widths, strict=True)).rstrip()


def _row(one: Compared, words: Catalogue) -> tuple[str, ...]:
    difference = text.NOT_KNOWN if one.difference is None else text.with_uncertainty(one.difference, one.uncertainty)
    cells = (
        one.name,
        text.plain(one.e_n, "", 2),
        "differs" if one.differs else "",
        stated(one.first.measured, words),
        stated(one.again.measured, words, unit=False),
        difference,
    )
    return tuple(map(_plain, cells))


def _in_short(rerun: Rerun) -> Iterator[str]:
    apart = [one.name for one in rerun.tests if one.differs]
    both = sum(one.e_n is not None for one in rerun.tests)
    if apart:
        yield from wrap(f"differ: {', '.join(apart)}", _WIDEST)
    else:
        yield f"no test differs: |E_n| ≤ 1 in all {both} that can be compared"
    for one in rerun.tests:
        if one.verdict_changed:
            yield f"judged otherwise: {one.name} is {one.again.verdict}, was {one.first.verdict}"
    if rerun.accepted is None or rerun.verdicts is None:
        yield "not judged: no acceptance lies beside the first run; --limits FILE names limits"
        return
    before, now = rerun.verdicts
    why = f": {rerun.accepted.fails}" if rerun.accepted.fails else ""
    yield f"{now} again{why}" if now == before else f"{now}, was {before}{why}"


def _plain(line: str) -> str:
    """One line of printable characters, each of one column."""
    return "".join(" " if one.isspace() else one for one in line if not unicodedata.category(one).startswith("C"))
