"""The words that the metrology hands to its reports, read from its source: labels, sources of uncertainty, origins."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import benchctl.metrology
import benchctl.metrology.allan
import benchctl.recordings.stated

_SOURCES = (*Path(benchctl.metrology.__path__[0]).rglob("*.py"), Path(benchctl.recordings.stated.__file__))

_LABELS = {"Column": ("name", 0), "column": ("name", 0), "Trace": ("label", 0)}
_AXES = ("x", "y")
_FIGURES = ("single", "independent", "scattered")
_SOURCE = dict.fromkeys((*_FIGURES, "Quantity"), ("name", 0)) | {"Contribution": ("source", 0)}
_SAYS = {"Contribution": ("says", 3), "Quantity": ("says", 3), "Stated": ("says", 1)} | dict.fromkeys(
    _FIGURES, ("says", 2)
)
_UNIT_OF = {"Column": ("unit", 1), "column": ("unit", 1)}


def labels() -> set[str]:
    """Names of columns and traces, and of axes."""
    return _told(_LABELS) | {text for axis in _AXES for text in _told({"Picture": (axis, -1)})}


def sources() -> set[str]:
    """What uncertainties come from."""
    return _told(_SOURCE)


def origins() -> set[str]:
    """Where a figure of uncertainty is taken from; `0` stands for what is filled in."""
    return _told(_SAYS)


def reasons() -> set[str]:
    """Why the Allan deviation does not show a term."""
    tree = ast.parse(Path(benchctl.metrology.allan.__file__).read_text(encoding="utf-8"))
    given = [node for node in ast.walk(tree) if isinstance(node, ast.Assign)]
    return {
        str(node.value.value)
        for node in given
        if isinstance(node.targets[0], ast.Subscript)
        and ast.unparse(node.targets[0].value) == "refused"
        and isinstance(node.value, ast.Constant)
    }


def units() -> set[str]:
    """Units of columns and axes."""
    axes = {text for name in ("x_unit", "y_unit", "left_unit") for text in _told({"Picture": (name, -1)})}
    return _told(_UNIT_OF) | axes


def _told(places: dict[str, tuple[str, int]]) -> set[str]:
    return {text for call in _calls() for text in _argument(call, places)}


def _calls() -> Iterator[ast.Call]:
    for path in _SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                yield node


def _argument(call: ast.Call, places: dict[str, tuple[str, int]]) -> Iterator[str]:
    name = call.func.id if isinstance(call.func, ast.Name) else None
    if name not in places:
        return
    keyword, place = places[name]
    given = [one.value for one in call.keywords if one.arg == keyword]
    given += call.args[place : place + 1] if 0 <= place < len(call.args) else []
    for value in given:
        if isinstance(value, ast.Constant) and isinstance(value.value, str):
            yield value.value
        elif isinstance(value, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "0" for part in value.values)
