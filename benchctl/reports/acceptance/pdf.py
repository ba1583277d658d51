"""The acceptance report as a PDF: the same contents as the page, in the same order."""

from __future__ import annotations

from contextlib import nullcontext

from fpdf.enums import TextEmphasis
from fpdf.fonts import FontFace

from benchctl.reports.acceptance.catalogue import Catalogue, catalogue
from benchctl.reports.acceptance.document import Badge, Report, Section, Table
from benchctl.reports.acceptance.sheet import EXPIRED, KIND_COLOURS, Sheet

_VERDICT_COLUMN = 3
_UNTIL_COLUMN = 4
_SUMMARY_MM, _TEST_MM, _WITH_PICTURE_MM = 150.0, 42.0, 69.0
"""Room for the table of all results, and for a test without and with a picture up to its budget."""
_NAME_SHARE = 0.3
_ROW_MM, _ROWS_AROUND = 4.6, 4
"""Height of a row of a budget, and the number of rows for its heading and the sentences below."""


def pdf(report: Report) -> bytes:
    """Return the document; the same report gives the same bytes."""
    words = catalogue(report.language)
    sheet = Sheet(
        language=report.language,
        title=f"{report.title}: {report.serial}",
        head=(f"{report.number} · {words.label('serial_short', serial=report.serial)}", report.verdict.text),
        kind=report.verdict.kind,
        foot=lambda page, pages: words.label("page", page=page, pages=pages),
    )
    sheet.set_creation_date(report.started)  # the bytes must not depend on the clock
    sheet.add_page()
    anchors = {test.anchor: sheet.add_link() for test in report.sections}
    _front(sheet, report, words)
    _summary(sheet, report, words, anchors)
    _set_up(sheet, report, words)
    sheet.heading(f"3 {words.label('tests')}", needs_mm=90.0)
    sheet.text_block(words.label("elsewhere" if report.sections else "nothing_judged"))
    for test in report.sections:
        _test(sheet, test, words, anchors[test.anchor])
    _rest(sheet, report, words)
    _appendix(sheet, report, words)
    return bytes(sheet.output())


def _front(sheet: Sheet, report: Report, words: Catalogue) -> None:
    sheet.letterhead(report.logo, report.laboratory)
    sheet.heading(report.title, level=1)
    sheet.text_block(report.number, grey=True)
    sheet.chip(report.verdict.text, report.verdict.kind, report.heading)
    sheet.text_block(report.tally)
    if report.simulated:
        sheet.banner(report.simulated, "INCONCLUSIVE")
    sheet.rows(report.header)
    sheet.heading(words.label("rule"), level=4)
    sheet.text_block(report.rule)
    for name, sentences, none in (
        ("anomalies_heading", report.anomalies, "none_found"),
        ("deviations_heading", report.deviations, "none_recorded"),
    ):
        sheet.heading(words.label(name), level=4, needs_mm=18.0)
        if sentences:
            sheet.bullets(sentences)
        else:
            sheet.text_block(words.label(none))
    sheet.blank_line()
    sheet.heading(words.label("signatures"), level=4, needs_mm=42.0)
    sheet.signature_lines(
        ("", *(words.label(key) for key in ("name", "signature", "date"))),
        [words.label(role) for role in ("tested_by", "approved_by")],
    )
    if report.signed:
        sheet.text_block(report.signed)


def _summary(sheet: Sheet, report: Report, words: Catalogue, anchors: dict[str, int]) -> None:
    sheet.heading(f"1 {words.label('result')}", needs_mm=_SUMMARY_MM)
    sheet.text_block(words.label("summary_caption"), grey=True)
    summary = report.summary
    sheet.grid(
        tuple(words.label(key) for key in ("test", "value", "limit", "verdict", "section")),
        [(row.test, row.value, row.limit, row.verdict.text, row.section) for row in summary],
        (False, True, True, False, True),
        looks=lambda row, column: _face(summary[row].verdict) if column == _VERDICT_COLUMN else None,
        links=[anchors.get(row.anchor) for row in summary],
    )


def _set_up(sheet: Sheet, report: Report, words: Catalogue) -> None:
    sheet.heading(f"2 {words.label('set_up')}")
    rows = report.equipment
    if rows:
        sheet.grid(
            tuple(words.label(key) for key in ("role", "model", "instrument_serial", "certificate", "valid_until")),
            [(row.role, row.model, row.serial, row.certificate, row.until) for row in rows],
            (False,) * 5,
            looks=lambda row, column: _EXPIRED if rows[row].expired and column == _UNTIL_COLUMN else None,
        )
    sheet.rows(report.environment)


def _test(sheet: Sheet, test: Section, words: Catalogue, link: int) -> None:
    above_mm = _WITH_PICTURE_MM if test.picture else _TEST_MM
    budget_mm = 0.0
    if test.budget:
        budget_mm = _ROW_MM * (len(test.budget.contributors.rows) + _ROWS_AROUND + 2 * bool(test.budget.says))
    sheet.heading(f"{test.number} {test.name}", level=3, needs_mm=above_mm + budget_mm)
    sheet.set_link(link)
    with sheet.beside(test.picture.png, test.picture.caption) if test.picture else nullcontext():
        sheet.text_block(" ".join([test.definition, test.formula]).strip())
        sheet.rows(
            [*test.result, (words.label("verdict"), test.verdict.text)],
            looks=lambda row: _face(test.verdict) if row == len(test.result) else _BOLD,
            name_share=_NAME_SHARE,
        )
        for name, reason in (("why_refused", test.refused), ("remedy", test.remedy)):
            if reason:
                sheet.text_block(f"{words.label(name)}: {reason}", bold=True)
        for note in test.notes:
            sheet.text_block(note)
        if test.conditions:
            sheet.text_block(f"{words.label('conditions')}: {test.conditions}", grey=True)
    if test.budget:
        sheet.keep(budget_mm)
        _table(sheet, test.budget.contributors)
        sheet.text_block(f"{test.budget.totals} {test.budget.says}")


def _rest(sheet: Sheet, report: Report, words: Catalogue) -> None:
    numbers = report.numbers
    for name, table in (("without_limit", report.without_limit), ("not_measured", report.not_measured)):
        if table.rows:
            sheet.heading(f"{numbers[name]} {words.label(name)}")
            sheet.text_block(words.label(f"{name}_says"))
            _table(sheet, table)
    if report.coefficients:
        sheet.heading(f"{numbers['coefficients']} {words.label('coefficients')}")
        sheet.grid(
            tuple(words.label(key) for key in ("symbol", "value", "meaning")),
            [(row.symbol, row.stated, row.says) for row in report.coefficients],
            (False, False, False),
        )


def _appendix(sheet: Sheet, report: Report, words: Catalogue) -> None:
    sheet.heading(words.label("appendix"), needs_mm=45.0)
    sheet.text_block(words.label("appendix_says"))
    sheet.rows(report.traceability, looks=lambda _: FontFace(family="mono"), name_share=0.33)


def _table(sheet: Sheet, table: Table) -> None:
    sheet.grid(table.headings, table.rows, table.numeric)


def _face(badge: Badge) -> FontFace:
    return FontFace(emphasis=TextEmphasis.B, color=KIND_COLOURS[badge.kind])


_BOLD = FontFace(emphasis=TextEmphasis.B)
_EXPIRED = FontFace(emphasis=TextEmphasis.B, color=EXPIRED)
