"""The A4 pages of the PDF report: header and footer of each page, headings, text, tables, pictures.

The fonts are DejaVu Sans, which matplotlib contains: they include Cyrillic and the letters of formulas.
"""

from __future__ import annotations

import io
import math
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import matplotlib as mpl
from fpdf import FPDF
from fpdf.enums import Align, TableBordersLayout, TextEmphasis, VAlign, XPos, YPos
from fpdf.fonts import FontFace
from fpdf.table import Row as TableRow
from matplotlib.ft2font import FT2Font

from benchctl.limits import cut

INK, GREY, RULE = (34, 34, 34), (95, 95, 95), (187, 187, 187)
KIND_COLOURS = {"PASS": (0, 112, 90), "FAIL": (179, 38, 30), "INCONCLUSIVE": (138, 109, 0), "": GREY}
EXPIRED = KIND_COLOURS["FAIL"]

_FONTS = {("sans", ""): "DejaVuSans.ttf", ("sans", "B"): "DejaVuSans-Bold.ttf", ("mono", ""): "DejaVuSansMono.ttf"}
_MARGIN_MM, _TOP_MM, _BOTTOM_MM = 15.0, 19.0, 15.0
_BODY_PT = 8.0
_LEADING = 1.3
_MM_PER_PT = 25.4 / 72.0
_CELL_PADDING_MM = (0.35, 1.8, 0.35, 0.8)
_WIDEST_SHARE = 0.5
"""Upper bound of a column's minimum width relative to the page, however long its words."""
_NARROW_SHARE = 0.22
"""Columns up to this width relative to the page are not narrowed."""
_HEADING_NEEDS_MM = 34.0
"""Minimum space for a heading and its content; otherwise the heading starts a new page."""
_GUTTER_MM = 6.0
_LOGO_MM = (45.0, 15.0)
_SPACES = " \u00a0\u202f"
_LONGEST_VALUE, _LONGEST_CELL, _LONGEST_HEAD = 3000, 600, 200
"""Maximum numbers of characters of user text, so that no row of a table is higher than a page."""
_UNKNOWN = "\ufffd"


class Sheet(FPDF):
    """A document of A4 pages; `head` are the header texts left and right, `kind` sets the right one's colour."""

    def __init__(
        self, *, language: str, title: str, head: tuple[str, str], kind: str, foot: Callable[..., str]
    ) -> None:
        super().__init__(format="A4")
        self._head, self._kind, self._foot = head, kind, foot
        for (family, style), file in _FONTS.items():
            self.add_font(family, style, _font_file(file))
        self.set_margins(_MARGIN_MM, _TOP_MM, _MARGIN_MM)
        self.c_margin = 0.0
        self.set_auto_page_break(True, _BOTTOM_MM)
        self.set_lang(language)
        self.set_title(title)
        self.set_creator("benchctl")

    def header(self) -> None:
        """See `FPDF`."""
        self.set_y(10.0)
        left, right = self._head
        right_mm = self._width(right, "B") + 2.0
        self._ink(GREY, _BODY_PT)
        self.cell(self.epw - right_mm, 4.0, self._fitted(left, self.epw - right_mm - 2.0))
        self._ink(KIND_COLOURS[self._kind], _BODY_PT, "B")
        self.cell(right_mm, 4.0, printable(right), align=Align.R)
        self.set_draw_color(*RULE)
        self.set_line_width(0.2)
        self.line(_MARGIN_MM, 15.0, self.w - _MARGIN_MM, 15.0)
        self.set_y(_TOP_MM)

    def footer(self) -> None:
        """See `FPDF`."""
        self.set_y(-11.0)
        self._ink(GREY, _BODY_PT)
        self.cell(0, 4.0, self._foot(page=str(self.page_no()), pages="{nb}"))

    def heading(self, words: str, level: int = 2, *, needs_mm: float = _HEADING_NEEDS_MM) -> None:
        """Print a heading, on a new page if there is not enough room for its content."""
        self.keep(needs_mm)
        size = {1: 15.0, 2: 11.5, 3: 9.5, 4: 8.0}[level]
        if self.get_y() > _TOP_MM + 1.0:
            self.ln({1: 2.0, 2: 4.0, 3: 3.4, 4: 1.6}[level])
        self.start_section(printable(words), level=max(level - 2, 0)) if level in (2, 3) else None
        self._ink(INK, size, "B")
        self._block(words, size)
        if level == 2:
            self._rule(INK, 0.35)
        self.ln(0.8)

    def keep(self, height_mm: float) -> None:
        """Begin a new page if this one has less room than `height_mm`."""
        if self.will_page_break(height_mm):
            self.add_page()

    def text_block(self, words: str, *, grey: bool = False, bold: bool = False) -> None:
        """Print a paragraph."""
        self._ink(GREY if grey else INK, _BODY_PT, "B" if bold else "")
        self._block(words, _BODY_PT)
        self.ln(0.9)

    def bullets(self, sentences: Sequence[str]) -> None:
        """Print a list of sentences."""
        for sentence in sentences:
            self._ink(INK, _BODY_PT)
            self.cell(4.0, _BODY_PT * _LEADING * _MM_PER_PT, "•")
            self._block(sentence, _BODY_PT)
        self.ln(0.8)

    def banner(self, words: str, kind: str) -> None:
        """Print a sentence with a coloured bar at its left."""
        top = self.get_y()
        self.set_x(self.l_margin + 4.0)
        self._ink(INK, _BODY_PT, "B")
        self._block(words, _BODY_PT)
        with self.local_context(fill_color=KIND_COLOURS[kind]):
            self.rect(self.l_margin, top, 1.6, self.get_y() - top, style="F")
        self.ln(1.6)

    def chip(self, words: str, kind: str, beside: str) -> None:
        """Print a verdict on its colour, with a sentence to its right."""
        width = self._width(words, "B", 11.0) + 7.0
        self._ink((255, 255, 255), 11.0, "B")
        with self.local_context(fill_color=KIND_COLOURS[kind]):
            self.cell(width, 7.0, printable(words), fill=True, align=Align.C)
        self._ink(INK, 11.0, "B")
        self.set_x(self.get_x() + 3.0)
        self.multi_cell(0, 7.0, printable(beside), align=Align.L, new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.ln(1.6)

    def rows(
        self,
        rows: Sequence[tuple[str, str]],
        *,
        name_share: float = 0.27,
        looks: Callable[[int], FontFace | None] = lambda row: None,
    ) -> None:
        """Print names and values in two columns; `looks` returns the font of a value by its row."""
        if not rows:
            return
        self._ink(INK, _BODY_PT)
        with self.table(
            col_widths=(name_share, 1.0 - name_share),
            first_row_as_headings=False,
            borders_layout=TableBordersLayout.NONE,
            line_height=_BODY_PT * _LEADING * _MM_PER_PT,
            padding=(0.25, 1.5, 0.25, 0.0),
            align=Align.L,
            text_align=Align.L,
            v_align=VAlign.T,
        ) as table:
            for number, (name, value) in enumerate(rows):
                row = table.row()
                row.cell(printable(cut(name, _LONGEST_CELL)), style=FontFace(color=GREY))
                row.cell(printable(cut(value, _LONGEST_VALUE)), style=looks(number))
        self.ln(1.6)

    def grid(
        self,
        headings: Sequence[str],
        rows: Sequence[Sequence[str]],
        numeric: Sequence[bool],
        *,
        looks: Callable[[int, int], FontFace | None] = lambda row, column: None,
        links: Sequence[int | None] = (),
    ) -> None:
        """Print a table of the page's width, whose headings are repeated on each page.

        `looks` returns the font of a cell by its row and column; `links` are the targets of each row's last cell.
        """
        widths = self._column_widths([headings, *rows])
        self._ink(INK, _BODY_PT)
        self.set_draw_color(*RULE)
        self.set_line_width(0.15)
        with self.table(
            col_widths=tuple(widths),
            align=Align.L,
            headings_style=FontFace(emphasis=TextEmphasis.B, color=INK, fill_color=(240, 241, 243)),
            borders_layout=TableBordersLayout.HORIZONTAL_LINES,
            line_height=_BODY_PT * _LEADING * _MM_PER_PT,
            padding=_CELL_PADDING_MM,
            v_align=VAlign.T,
            text_align=tuple(Align.R if right else Align.L for right in numeric),
        ) as table:
            _fill(table.row(), headings, [None] * len(headings), None)
            for number, cells in enumerate(rows):
                faces = [looks(number, place) for place in range(len(cells))]
                _fill(table.row(), cells, faces, links[number] if links else None)
        self.ln(2.0)

    @contextmanager
    def beside(self, png: bytes, caption: str) -> Iterator[None]:
        """Print what follows in the left half, with a picture and its caption to its right."""
        page, top, width = self.page, self.get_y(), (self.epw - _GUTTER_MM) / 2.0
        self.set_left_margin(self.w - _MARGIN_MM - width)
        self.set_y(top)
        self.image(io.BytesIO(png), w=width, alt_text=printable(caption))
        self.set_y(self.get_y() + 0.6)
        self.text_block(caption, grey=True)
        bottom = self.get_y()
        self.set_left_margin(_MARGIN_MM)
        self.set_right_margin(_MARGIN_MM + width + _GUTTER_MM)
        self.set_y(top)
        yield
        self.set_right_margin(_MARGIN_MM)
        if self.page == page:
            self.set_y(max(bottom, self.get_y()))

    def letterhead(self, logo: bytes, lines: Sequence[str]) -> None:
        """Print the laboratory at the left and its logo at the right."""
        top = self.get_y()
        if logo:
            self.image(io.BytesIO(logo), x=Align.R, y=top, w=_LOGO_MM[0], h=_LOGO_MM[1], keep_aspect_ratio=True)
            self.set_y(top)
        for place, line in enumerate(lines):
            self.text_block(self._fitted(line, self.epw - _LOGO_MM[0]), bold=place == 0)
        self.set_y(max(self.get_y(), top + (_LOGO_MM[1] if logo else 0.0)))

    def signature_lines(self, headings: Sequence[str], who: Sequence[str]) -> None:
        """Print a line for each signature."""
        widths = (0.31 * self.epw, 0.27 * self.epw, 0.24 * self.epw, 0.18 * self.epw)
        self._ink(GREY, _BODY_PT)
        for heading, width in zip(headings, widths, strict=True):
            self.cell(width, 5.0, printable(heading))
        self.ln(5.0)
        for role in who:
            self.ln(9.0)
            self._ink(INK, _BODY_PT)
            self.cell(widths[0], 5.0, printable(role))
            x, y = self.l_margin + widths[0], self.get_y() + 5.0
            for width in widths[1:]:
                self.line(x, y, x + width - 4.0, y)
                x += width
            self.ln(6.0)

    def blank_line(self) -> None:
        """Print a blank line for handwriting."""
        self.ln(7.0)
        self._rule(RULE, 0.2)

    def _column_widths(self, rows: Sequence[Sequence[str]]) -> list[float]:
        """Return column widths for text on one line; if the sum is too large, wide columns wrap between words."""
        pad = _CELL_PADDING_MM[1] + _CELL_PADDING_MM[3] + 0.6
        columns = list(zip(*rows, strict=True))
        natural = [max(self._width(cell, "B") for cell in column) + pad for column in columns]
        least = [max(self._width(word, "B") for cell in column for word in cell.split(" ")) + pad for column in columns]
        if sum(natural) > self.epw:
            natural = _yielding(natural, [min(one, _WIDEST_SHARE * self.epw) for one in least], self.epw)
        total = sum(natural)
        return [self.epw * one / total for one in natural]

    def _block(self, words: str, size: float) -> None:
        height = size * _LEADING * _MM_PER_PT
        self.multi_cell(0, height, printable(words), align=Align.L, new_x=XPos.LMARGIN, new_y=YPos.NEXT)

    def _rule(self, colour: tuple[int, int, int], width: float) -> None:
        self.set_draw_color(*colour)
        self.set_line_width(width)
        self.line(self.l_margin, self.get_y(), self.w - self.r_margin, self.get_y())
        self.ln(1.2)

    def _ink(self, colour: tuple[int, int, int], size: float, style: str = "") -> None:
        self.set_font("sans", style, size)
        self.set_text_color(*colour)

    def _width(self, words: str, style: str = "", size: float = _BODY_PT) -> float:
        self.set_font("sans", style, size)
        return float(self.get_string_width(printable(words)))

    def _fitted(self, words: str, width: float) -> str:
        """Truncate a text to a width."""
        shown = printable(cut(words, _LONGEST_HEAD))
        while shown and self.get_string_width(shown) > width:
            shown = shown[:-2] + "…"
        return shown


def _yielding(wanted: Sequence[float], least: Sequence[float], room: float) -> list[float]:
    """Share the room among columns: narrow ones keep their width, wide ones are reduced, but not below `least`.

    Long texts share by the square roots of their lengths, so that a cell of many lines does not narrow a short one.
    """
    shared = [one if one <= _NARROW_SHARE * room else 0.0 for one in wanted]
    waiting = [place for place, width in enumerate(shared) if not width]
    while waiting:
        left = room - sum(shared)
        roots = sum(math.sqrt(wanted[place]) for place in waiting)
        parts = {place: left * math.sqrt(wanted[place]) / roots for place in waiting}
        bounded = {place: min(wanted[place], max(least[place], part)) for place, part in parts.items()}
        fixed = [place for place in waiting if bounded[place] != parts[place]] or waiting
        for place in fixed:
            shared[place] = bounded[place]
        waiting = [place for place in waiting if place not in fixed]
    return shared


def _fill(row: TableRow, cells: Sequence[str], faces: Sequence[FontFace | None], link: int | None) -> None:
    """Write a row; a link belongs to its last cell."""
    for place, (cell, face) in enumerate(zip(cells, faces, strict=True), start=1):
        row.cell(printable(cut(cell, _LONGEST_CELL)), style=face, link=link if place == len(cells) else None)


def printable(words: str) -> str:
    """Replace characters that the font lacks by U+FFFD, and line breaks by spaces; control codes are not allowed."""
    return "".join(_letter(one) for one in words)


def _letter(one: str) -> str:
    if one.isspace():
        return one if one in _SPACES else " "
    return one if ord(one) in _letters() and not unicodedata.category(one).startswith("C") else _UNKNOWN


@cache
def _letters() -> frozenset[int]:
    return frozenset(code for code in FT2Font(str(_font_file(_FONTS["sans", ""]))).get_charmap() if code >= ord(" "))


def _font_file(name: str) -> Path:
    return Path(mpl.get_data_path(), "fonts", "ttf", name)
