"""Texts and numbers from files as C writes them: nothing that a file says can end a comment, a string or a line."""

from __future__ import annotations

from collections.abc import Sequence

from benchctl.limits import cut

_LONGEST = 200
"""Characters of a text; C99 compilers need not take a string of more than 4095 bytes."""


def in_comment(text: str) -> str:
    """A text inside a block comment, on its line and in ASCII."""
    plain = cut(text, _LONGEST).encode("ascii", "backslashreplace").decode()
    printable = "".join(character if character.isprintable() else " " for character in plain)
    for ending, harmless in (("*/", "* /"), ("/*", "/ *"), ("??", "? ?")):
        while ending in printable:
            printable = printable.replace(ending, harmless)
    return printable.strip()


def string(text: str) -> str:
    """A string literal with the text's UTF-8 bytes, all but plain ones as three octal digits."""
    written = (_character(byte) for byte in cut(text, _LONGEST).encode("utf-8"))
    return f'"{"".join(written)}"'


def number(value: float) -> str:
    """A constant of type double that gives the same double back; in brackets, since it may have a sign."""
    text = f"{value:.17g}"
    return f"({text if any(mark in text for mark in '.en') else f'{text}.0'})"


def polynomial(names: Sequence[str], argument: str) -> str:
    """c1·z + c2·z² + … by Horner's rule, from the names of its coefficients; `0.0` where there are none."""
    if not names:
        return "0.0"
    *lower, text = names
    text = f"{text} * {argument}"
    for name in reversed(lower):
        text = f"({name} + {text}) * {argument}"
    return text


def _character(byte: int) -> str:
    plain = 32 <= byte < 127 and chr(byte) not in '"\\?'
    return chr(byte) if plain else f"\\{byte:03o}"
