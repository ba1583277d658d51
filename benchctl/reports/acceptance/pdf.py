"""The acceptance report as a PDF: the same contents as the page, in the same order."""

from __future__ import annotations

from fpdf.enums import TextEmphasis
from fpdf.fonts import FontFace

from benchctl.reports.acceptance.catalogue import Catalogue, catalogue
from benchctl.reports.acceptance.document import Badge, Budget, Picture, Report, Section, Table
from benchctl.reports.acceptance.sheet import EXPIRED, KIND_COLOURS, Sheet

_VERDICT_COLUMN = 3
_UNTIL_COLUMN = 4
_TOTALS_MM = 20.0


def pdf(report: Report) -> bytes:
    """Return the document; the same report gives the same bytes."""
    words = catalogue(report.language)
    sheet = Sheet(
        language=report.language,
        title=f"{report.title}: {report.serial}",
        head=(f"{report.title} · {words.label('serial_short', serial=report.serial)}", report.verdict.text),
        kind=report.verdict.kind,
        foot=lambda page, pages: words.label("page", page=page, pages=pages),
    )
    sheet.dated(report.started)
    sheet.add_page()
    anchors = {test.anchor: sheet.add_link() for test in report.sections}
    _front(sheet, report, words)
    _summary(sheet, report, words, anchors)
    _set_up(sheet, report, words)
    sheet.heading(f"3 {words.label('tests')}", needs_mm=90.0)
    if not report.sections:
        sheet.text_block(words.label("nothing_judged"))
    for test in report.sections:
        _test(sheet, test, words, anchors[test.anchor])
    _rest(sheet, report, words)
    _appendix(sheet, report, words)
    return bytes(sheet.output())


def _front(sheet: Sheet, report: Report, words: Catalogue) -> None:
    sheet.heading(report.title, level=1)
    sheet.chip(report.verdict.text, report.verdict.kind, report.heading)
    sheet.text_block(report.tally)
    if report.simulated:
        sheet.banner(report.simulated, "INCONCLUSIVE")
    sheet.rows(report.header)


def _summary(sheet: Sheet, report: Report, words: Catalogue, anchors: dict[str, int]) -> None:
    sheet.heading(f"1 {words.label('result')}")
    sheet.text_block(words.label("summary_caption"), small=True, grey=True)
    summary = report.summary
    sheet.grid(
        tuple(words.label(key) for key in ("test", "value", "limit", "verdict", "section")),
        [(row.test, row.value, row.limit, row.verdict.text, row.section) for row in summary],
        (False, True, True, False, True),
        looks=lambda row, column: _face(summary[row].verdict) if column == _VERDICT_COLUMN else None,
        links=[anchors.get(row.anchor) for row in summary],
    )
    sheet.heading(words.label("rule"), level=4, needs_mm=20.0)
    sheet.text_block(report.rule)


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
    sheet.heading(f"{test.number} {test.name}", level=3, needs_mm=62.0)
    sheet.set_link(link)
    sheet.text_block(test.definition)
    if test.formula:
        sheet.text_block(f"    {test.formula}", bold=True)
    sheet.grid(
        (*(name for name, _ in test.result), words.label("verdict")),
        [(*(value for _, value in test.result), test.verdict.text)],
        (False, False, False),
        looks=lambda _, column: _face(test.verdict) if column == len(test.result) else _BOLD,
        fill=False,
    )
    sheet.bullets(test.notes)
    reasons = (("why_refused", test.refused), ("remedy", test.remedy))
    sheet.rows([*((words.label(name), reason) for name, reason in reasons if reason), *test.conditions])
    picture_first = test.picture is None or sheet.has_room_for(test.picture.png)
    if picture_first:
        _picture(sheet, test.picture)
    _budget(sheet, test.budget, words)
    if not picture_first:  # rather than leave the rest of the page blank
        _picture(sheet, test.picture)
    if test.points:
        sheet.heading(words.label("points"), level=4, needs_mm=38.0)
        sheet.folded(test.points.headings, test.points.rows, test.points.numeric)


def _picture(sheet: Sheet, picture: Picture | None) -> None:
    if picture:
        sheet.picture(picture.png, picture.drawing.caption)


def _budget(sheet: Sheet, budget: Budget | None, words: Catalogue) -> None:
    if budget is None:
        return
    sheet.heading(words.label("uncertainty"), level=4)
    _table(sheet, budget.contributors)
    last = len(budget.totals) - 1
    sheet.keep(_TOTALS_MM)
    sheet.grid(
        (),
        budget.totals,
        (False, True),
        fill=False,
        small=True,
        looks=lambda row, _: _BOLD if row == last else None,
    )
    sheet.text_block(f"{budget.largest} {budget.says}".strip())


def _rest(sheet: Sheet, report: Report, words: Catalogue) -> None:
    numbers = report.numbers
    for name, table in (("without_limit", report.without_limit), ("not_measured", report.not_measured)):
        if table.rows:
            sheet.heading(f"{numbers[name]} {words.label(name)}")
            sheet.text_block(words.label(f"{name}_says"))
            _table(sheet, table)
    sheet.heading(f"{numbers['anomalies']} {words.label('anomalies')}")
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
    if report.coefficients:
        sheet.heading(f"{numbers['coefficients']} {words.label('coefficients')}")
        sheet.grid(
            tuple(words.label(key) for key in ("symbol", "value", "meaning")),
            [(row.symbol, row.stated, row.says) for row in report.coefficients],
            (False, False, False),
        )
    sheet.heading(f"{numbers['signatures']} {words.label('signatures')}", needs_mm=52.0)
    sheet.signature_lines(
        ("", *(words.label(key) for key in ("name", "signature", "date"))),
        [words.label(role) for role in ("tested_by", "approved_by")],
    )
    if report.signed:
        sheet.blank_line()
        sheet.text_block(report.signed)


def _appendix(sheet: Sheet, report: Report, words: Catalogue) -> None:
    sheet.heading(words.label("appendix"), needs_mm=60.0)
    sheet.text_block(words.label("appendix_says"))
    sheet.rows(report.traceability, mono=True)
    sheet.text_block(words.label("footer"), small=True, grey=True)


def _table(sheet: Sheet, table: Table) -> None:
    sheet.grid(table.headings, table.rows, table.numeric, small=True)


def _face(badge: Badge) -> FontFace:
    return FontFace(emphasis=TextEmphasis.B, color=KIND_COLOURS[badge.kind])


_BOLD = FontFace(emphasis=TextEmphasis.B)
_EXPIRED = FontFace(emphasis=TextEmphasis.B, color=EXPIRED)
