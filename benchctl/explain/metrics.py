"""Results of `benchctl accept`, each by the definition that its report prints."""

from __future__ import annotations

from collections.abc import Iterator

from benchctl.explain.entry import Entry
from benchctl.explain.glossary import beside, shared
from benchctl.metrology.names import PROCEDURES, UNITS
from benchctl.reports.acceptance.catalogue import catalogue


def metric_entries() -> Iterator[Entry]:
    """Every result, in the order of the report."""
    words = catalogue("en")
    for name, unit in UNITS.items():
        told, more = words.test(name), beside("metrics", name)
        facts = {"Unit": words.unit(unit), "Computed": more.get("computed", ""), "Others mean": more.get("others", "")}
        if name in PROCEDURES:
            facts["Measured by"] = f"benchctl run {PROCEDURES[name]}; benchctl run acceptance has it too"
        facts["Limit"] = f"[limits.{name}] in limits.toml"
        yield Entry(
            name=name,
            title=told.name,
            group=more.get("group", "metrics"),
            words=told.definition,
            equation=told.formula,
            facts={label: says for label, says in facts.items() if says},
            drawing=more.get("picture", ""),
            **shared(more),
        )
