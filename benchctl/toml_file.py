"""Read a TOML file into a pydantic model, with errors that name the file, the line and the field."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from benchctl.closeness import nearest
from benchctl.documents import toml_document
from benchctl.limits import MOST_TOML_BYTES, cut, listed, read_whole, shown
from benchctl.units import quantity, unit_stated
from benchctl_instruments.errors import UsageError
from benchctl_instruments.field_faults import field_fault

Model = TypeVar("Model", bound=BaseModel)
Place = tuple[str | int, ...]
"""The path to a field: names of tables and, in a list of tables, an index from 0."""

_HEADER = re.compile(r"\s*(\[\[?)([^\[\]]+)\]\]?\s*(?:#|$)")
_KEY = re.compile(r"\s*([A-Za-z0-9_.\-\"']+)\s*=")
_NAMED = re.compile(r"\[*([\w.]+)\]*(?: (\w+))?")
_MOST_COMPARED = 10
"""The number of unknown keys compared with the known ones; comparing thousands would take seconds."""


def read_text(path: Path, what: str) -> str:
    """Return the text of a file; `what` is its role in an error message.

    Raises
    ------
    UsageError
        If it does not exist, is not UTF-8, or is too large.
    """
    try:
        text = read_whole(path, MOST_TOML_BYTES, f"{what} ").decode("utf-8")
    except UnicodeDecodeError as err:
        raise UsageError(f"{what} {path}: expected UTF-8 text, byte {err.start} is not") from err
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse_toml(text: str, model: type[Model], name: str) -> Model:
    """Validate a TOML text and return the model; `name` is the file's name in an error message.

    Raises
    ------
    UsageError
        One line that names the file, the line of the first wrong field, all missing fields, and the number of others.
    """
    document = toml_in_units(text, name)
    try:
        return model.model_validate(document)
    except ValidationError as err:
        raise UsageError(f"{name}, {_faults(err, model, text, document)}") from err


def toml_in_units(text: str, name: str) -> dict[str, Any]:
    """Return the values of a TOML text; numbers with a unit are converted to the units that their keys state.

    For example, `silence_s = "2 min"` becomes 120.0; other strings are not changed.

    Raises
    ------
    UsageError
        If it is not TOML, or a key that states a unit has a string that is no number of that kind; names the line.
    """
    document: dict[str, Any] = _in_units(toml_document(text, name), (), text, name)
    return document


def line_of(text: str, place: Place) -> int:
    r"""Return the line, counted from 1, on which a field is set, or the line of its table if it is not set.

    >>> line_of('[a]\nb = 1\n', ("a", "b"))
    2
    >>> line_of('[[a]]\nb = 1\n[[a]]\nb = 2\n', ("a", 1, "b"))
    4
    """
    table: Place = ()
    latest: dict[Place, int] = {}
    best = 1
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            table = _table(_parts(header[2]), latest, place, is_new=header[1] == "[[")
            if table == place[: len(table)]:
                best = number
        elif key := _KEY.match(line):
            full = table + _parts(key[1])
            if full == place[: len(full)] and len(full) > len(table):
                return number
    return best


def named_place(message: str) -> Place:
    """Return the field at the beginning of a message: `safe.chamber_c (99) lies …`, or `[effects.warm_up] tau_s: …`."""
    found = _NAMED.match(message)
    return (*_parts(found[1]), *([found[2]] if found[2] else [])) if found else ()


def _table(parts: tuple[str, ...], latest: dict[Place, int], place: Place, *, is_new: bool) -> Place:
    """Return the path of a header's table, as far as it agrees with `place`.

    `latest` holds the index of the latest table of each list on that path; a header with `is_new` increments it.
    """
    found: Place = ()
    for count, part in enumerate(parts, 1):
        found += (part,)
        if found != place[: len(found)]:
            break
        if is_new and count == len(parts):
            latest[found] = latest.get(found, -1) + 1
        if found in latest:
            found += (latest[found],)
    return found


def _parts(dotted: str) -> tuple[str, ...]:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))


def _in_units(value: Any, place: Place, text: str, name: str) -> Any:
    if isinstance(value, dict):
        return {key: _in_units(item, (*place, key), text, name) for key, item in value.items()}
    if isinstance(value, list):
        return [_in_units(item, (*place, number), text, name) for number, item in enumerate(value)]
    keys = [part for part in place if isinstance(part, str)]
    if not isinstance(value, str) or not unit_stated(keys[-1]):
        return value
    try:
        return quantity(value, unit_stated(keys[-1]))
    except UsageError as err:
        raise UsageError(f"{name}, line {line_of(text, place)}: {cut('.'.join(keys))}: {err}") from err


def _in_document(loc: Place, document: Any) -> Place:
    """Return the path of a fault without the names that pydantic inserts for the types of a union."""
    found: Place = ()
    for part in loc:
        with suppress(IndexError, KeyError, TypeError):
            document = document[part]
            found += (part,)
    return found


def _faults(err: ValidationError, model: type[BaseModel], text: str, document: dict[str, Any]) -> str:
    """Return line and message of the first fault, or of a misspelt key of a missing field; then all missing fields."""
    found = err.errors(include_url=False, include_context=False)
    missing = [each["loc"] for each in found if each["type"] == "missing"]
    unknown = [each for each in found if each["type"] == "extra_forbidden"][:_MOST_COMPARED]
    meant = {each["loc"]: nearest(str(each["loc"][-1]), _fields(model, each["loc"][:-1])) for each in unknown}
    misspelt = [each for each in unknown if (*each["loc"][:-1], meant[each["loc"]]) in missing]
    missing = [loc for loc in missing if loc not in {(*each["loc"][:-1], meant[each["loc"]]) for each in misspelt}]
    head = misspelt[0] if misspelt else found[0]
    place, fault, names = head["loc"], field_fault(head, shown), listed([_dotted(loc) for loc in missing])
    if head["type"] == "missing":
        others = len(found) - len(missing)
        words = f"{names}: {fault if len(missing) == 1 else 'these fields are needed and are not there'}"
    else:
        others = len(found) - len(missing) - len(misspelt) - 1
        if head["type"] == "value_error":  # from a table's validator, whose message begins with the field
            place += named_place(fault)
        if near := meant.get(head["loc"]):
            fault += f": did you mean {near}?"
        field = _dotted(head["loc"])
        words = f"{field}{': ' if field else ''}{cut(fault)}{f'; needed and not there: {names}' if names else ''}"
    more = f" (and {others} more)" if others else ""
    return f"line {line_of(text, _in_document(place, document))}: {words}{more}"


def _dotted(loc: Place) -> str:
    return cut(".".join(str(part) for part in loc))


def _fields(kind: Any, loc: Place) -> Iterator[str]:
    """Yield the names of the fields of the table at a path; `kind` is the type at the start of the path."""
    loc = loc[1:] if loc and (isinstance(loc[0], int) or get_origin(kind) is dict) else loc
    if not inspect.isclass(kind):
        for part in get_args(kind):
            yield from _fields(part, loc)
    elif issubclass(kind, BaseModel):
        if not loc:
            yield from kind.model_fields
        elif loc[0] in kind.model_fields:
            yield from _fields(kind.model_fields[str(loc[0])].annotation, loc[1:])
        elif any(loc[0] in get_args(field.annotation) for field in kind.model_fields.values()):  # a type of a union
            yield from _fields(kind, loc[1:])
