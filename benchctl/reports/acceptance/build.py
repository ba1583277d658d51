"""Build the acceptance report from the results: its contents, order and section numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from benchctl.limits import cut
from benchctl.metrology.result import Acceptance, Judged
from benchctl.reports.acceptance import set_up
from benchctl.reports.acceptance.catalogue import Catalogue, catalogue, limits, stated
from benchctl.reports.acceptance.document import TESTS_SECTION, Badge, Report, SummaryRow, Table
from benchctl.reports.acceptance.sections import anchor, badge, section
from benchctl.reports.acceptance.set_up import RecordingFacts
from benchctl.reports.acceptance.signed import SIGNATURE
from benchctl.reports.verdict import is_simulated
from benchctl.sshsig import SigningKey

_LONGEST_NAME = 120


def report_of(acceptance: Acceptance, facts: RecordingFacts, language: str, key: SigningKey | None = None) -> Report:
    """Return the report in one language, to be signed by `key`; raises `UsageError` for an unsupported language."""
    words = catalogue(language)
    serial = cut(facts.meta.unit.serial, _LONGEST_NAME)
    infos = {info.index: info for info in facts.infos}
    full = [one for one in acceptance.judged if one.limit is not None]
    free = [one for one in acceptance.judged if one.limit is None and one.measured.value is not None]
    refused = [one for one in acceptance.judged if one.limit is None and one.measured.value is None]
    numbers = {id(one): f"{TESTS_SECTION}.{place}" for place, one in enumerate(full, start=1)}
    verdict = words.word(f"unit_{acceptance.verdict}", "verdicts")
    return Report(
        language=words.language,
        title=cut(acceptance.papers.title, _LONGEST_NAME) or words.label("title"),
        number=_number(acceptance, facts, words),
        laboratory=set_up.laboratory(facts.meta),
        logo=set_up.logo(facts.meta),
        serial=serial,
        started=facts.started,
        verdict=Badge(text=verdict, kind=acceptance.verdict),
        heading=words.label("unit_heading", serial=serial),
        tally=tally(acceptance, words),
        simulated=words.label("simulated") if is_simulated(facts.meta) else "",
        header=set_up.header(acceptance, facts, words),
        summary=tuple(_summary_row(one, numbers.get(id(one), ""), words) for one in (*full, *free, *refused)),
        rule=words.said(acceptance.rule.says),
        equipment=set_up.equipment(facts.meta, words),
        environment=set_up.environment(facts, words),
        sections=tuple(section(one, numbers[id(one)], infos, words) for one in full),
        without_limit=_without_limit(free, words),
        not_measured=_not_measured(refused, words),
        anomalies=tuple(words.said(one) for one in acceptance.anomalies),
        deviations=set_up.deviations(facts, words),
        coefficients=tuple(replace(one, stated=words.number(one.stated)) for one in facts.coefficients),
        signed=_signed(key, words) if key else "",
        traceability=set_up.traceability(acceptance, facts, words),
    )


def _number(acceptance: Acceptance, facts: RecordingFacts, words: Catalogue) -> str:
    """Return number and revision of the report; without a number its date, serial number and digest."""
    papers = acceptance.papers
    own = "-".join(part for part in (f"{facts.started:%Y%m%d}", facts.meta.unit.serial, facts.digest[:8]) if part)
    return words.label(
        "number", number=cut(papers.number or own, _LONGEST_NAME), revision=cut(papers.revision or "0", _LONGEST_NAME)
    )


def tally(acceptance: Acceptance, words: Catalogue) -> str:
    """Return a sentence with the number of tests of each verdict."""
    verdicts = Counter(one.verdict for one in acceptance.judged)
    free = [one for one in acceptance.judged if one.verdict is None]
    refused = sum(one.measured.value is None for one in free)
    return words.label(
        "tally",
        judged=str(len(acceptance.judged) - len(free)),
        passed=str(verdicts["PASS"]),
        failed=str(verdicts["FAIL"]),
        inconclusive=str(verdicts["INCONCLUSIVE"]),
        free=str(len(free) - refused),
        refused=str(refused),
    )


def _signed(key: SigningKey, words: Catalogue) -> str:
    name = cut(key.name, _LONGEST_NAME)
    return words.label("signed", name=name, fingerprint=key.public.fingerprint, file=SIGNATURE)


def _named(one: Judged, words: Catalogue) -> str:
    """Return a test's name with its unit; without the unit if it is dimensionless."""
    unit = words.unit(one.measured.unit)
    name = words.test(one.measured.name).name
    return f"{name}, {unit}" if unit else name


def _summary_row(one: Judged, number: str, words: Catalogue) -> SummaryRow:
    return SummaryRow(
        test=_named(one, words),
        value=stated(one.measured, words, unit=False),
        limit=limits(one.limit, words, unit=False),
        verdict=badge(one, words),
        section=number,
        anchor=anchor(number) if number else "",
    )


def _without_limit(free: Sequence[Judged], words: Catalogue) -> Table:
    return Table(
        headings=tuple(words.label(key) for key in ("test", "value", "definition_and_notes")),
        rows=tuple((_named(one, words), stated(one.measured, words, unit=False), _defined(one, words)) for one in free),
        numeric=(False, True, False),
    )


def _defined(one: Judged, words: Catalogue) -> str:
    test = words.test(one.measured.name)
    return " ".join([f"{test.definition} {test.formula}.", *(words.said(note) for note in one.measured.notes)])


def _not_measured(refused: Sequence[Judged], words: Catalogue) -> Table:
    return Table(
        headings=(words.label("test"), words.label("why")),
        rows=tuple(
            (words.test(one.measured.name).name, words.said(one.measured.refused) if one.measured.refused else "")
            for one in refused
        ),
        numeric=(False, False),
    )
