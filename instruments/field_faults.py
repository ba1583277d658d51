"""Convert pydantic's validation errors of a table's fields to the wording used here: "expected a number, got 'x'"."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from benchctl_instruments.errors import in_line

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

_KINDS = {
    "number": "a number",
    "integer": "an integer",
    "string": "text",
    "boolean": "true or false",
    "list": "a list",
    "tuple": "a list",
    "dictionary": "a table",
}
_VALID = re.compile(rf"Input should be a valid ({'|'.join(_KINDS)})\b.*", re.DOTALL)
_WORDS = (
    (r"Input should be greater than or equal to (.+)", r"a number of at least \1"),
    (r"Input should be less than or equal to (.+)", r"a number of at most \1"),
    (r"Input should be greater than (.+)", r"a number above \1"),
    (r"Input should be less than (.+)", r"a number below \1"),
    (r"(?:String|Value) should have (at \w+ \d+ \w+).*", r"text of \1"),
    (r"\w+ should have (at \w+ \d+ \w+).*", r"\1"),
    (r"Input should be (.+)", r"\1"),
)
_OTHER_TAG = re.compile(r"Input tag (.+) found using '(\w+)' .* expected tags: (.+)", re.DOTALL)
_NO_TAG = re.compile(r"Unable to extract tag using discriminator '(\w+)'")


def field_fault(fault: ErrorDetails, shown: Callable[[Any], str]) -> str:
    """Return what is wrong, without the place; `shown` formats a value."""
    match fault["type"]:
        case "missing":
            return "this field is needed and is not there"
        case "extra_forbidden":
            return "there is no such field"
        case "value_error":
            return fault["msg"].removeprefix("Value error, ")
        case "union_tag_invalid" if found := _OTHER_TAG.fullmatch(fault["msg"]):
            return f"expected {found[2]} to be one of {found[3]}, got {found[1]}"
        case "union_tag_not_found" if found := _NO_TAG.fullmatch(fault["msg"]):
            return f"{found[1]} is needed and is not there"
        case _:
            return f"{expectation(fault['msg'])}, got {shown(fault['input'])}"


def expectation(message: str) -> str:
    """Return a pydantic message about a value, reworded as an expectation.

    >>> expectation("Input should be greater than or equal to 0")
    'expected a number of at least 0'
    >>> expectation("Input should be a valid integer, unable to parse string as an integer")
    'expected an integer'
    """
    if found := _VALID.fullmatch(message):
        return f"expected {_KINDS[found[1]]}"
    for pattern, words in _WORDS:
        if found := re.fullmatch(pattern, message, re.DOTALL):
            return f"expected {found.expand(words)}"
    return in_line(message)
