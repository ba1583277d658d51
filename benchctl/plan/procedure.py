"""A procedure: a function that yields steps, with its parameters read off its signature.

A parameter is a keyword with a default; its type is `float`, `int`, `bool`, `str` or `tuple[float, ...]`, and
`Annotated[float, "what it is, in which unit"]` documents it.
"""

from __future__ import annotations

import difflib
import inspect
import math
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from benchctl.plan.steps import Step
from instruments.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A parameter of a procedure; `says` is what it is, in words."""

    name: str
    type: Any
    default: Any
    says: str = ""

    def parse(self, text: str) -> Any:
        """The value that a text on the command line stands for.

        Raises
        ------
        UsageError
            Where the text is not of the parameter's type.
        """
        try:
            return _PARSERS[self.type](text)
        except ValueError as err:
            wants = _EXPECTED[self.type]
            raise UsageError(
                f"parameter {self.name}: expected {wants}, got {text!r}; its default is {self.default}"
            ) from err


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The steps of a procedure with these parameters, and where they came from."""

    procedure: str
    parameters: Mapping[str, Any]
    steps: tuple[Step, ...]
    calibrates: bool
    source: str = ""


@dataclass(frozen=True, slots=True)
class Procedure:
    """A procedure that can be listed, checked and run.

    `calibrates` says that its recording holds what a calibration needs, so that `run` fits it at once.
    """

    function: Callable[..., Iterable[Step]]
    calibrates: bool = False
    parameters: tuple[Parameter, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", tuple(_read_parameters(self.function)))

    @property
    def name(self) -> str:
        """The function's name."""
        return self.function.__name__

    @property
    def says(self) -> str:
        """What it measures: the first line of the docstring."""
        return (inspect.getdoc(self.function) or "").partition("\n")[0]

    def expand(self, texts: Mapping[str, str] | None = None) -> Plan:
        """The steps with these parameters, given as texts; the others keep their defaults.

        Raises
        ------
        UsageError
            For a parameter that it does not have, a value of the wrong type, a combination that it refuses, or where
            it yields something else than steps.
        """
        known = {parameter.name: parameter for parameter in self.parameters}
        values = {name: parameter.default for name, parameter in known.items()}
        for name, text in (texts or {}).items():
            if name not in known:
                raise UsageError(self._unknown(name, list(known)))
            values[name] = known[name].parse(text)
        try:
            steps = tuple(self.function(**values))
        except (Exception, SystemExit) as err:
            # Whatever a user's procedure raises is a fault of it or of its parameters, told in one line.
            raise UsageError(
                f"procedure {self.name}: these parameters give no plan ({type(err).__name__}: {err}): {values}"
            ) from err
        if not steps:
            raise UsageError(f"procedure {self.name}: these parameters give no steps: {values}")
        for number, step in enumerate(steps, 1):
            if not isinstance(step, Step):
                raise UsageError(f"procedure {self.name}: its step {number} is no step but {step!r}")
        return Plan(
            procedure=self.name, parameters=values, steps=steps, calibrates=self.calibrates, source=self._source()
        )

    def _source(self) -> str:
        """The whole file that it stands in; empty where there is none, as for one typed at a prompt."""
        try:
            return inspect.getsource(inspect.getmodule(self.function) or self.function)
        except (OSError, TypeError):
            return ""

    def _unknown(self, name: str, known: list[str]) -> str:
        close = difflib.get_close_matches(name, known, 1)
        hint = f"did you mean {close[0]}?" if close else f"it has {', '.join(known)}"
        return f"procedure {self.name} has no parameter {name!r}: {hint}"


def procedure(*, calibrates: bool = False) -> Callable[[Callable[..., Iterable[Step]]], Procedure]:
    """Make a procedure of a function that yields steps."""
    return lambda function: Procedure(function, calibrates)


def _read_parameters(function: Callable[..., Iterable[Step]]) -> Iterable[Parameter]:
    hints = typing.get_type_hints(function, include_extras=True)
    for name, parameter in inspect.signature(function).parameters.items():
        hint, says = hints.get(name), ""
        if typing.get_origin(hint) is typing.Annotated:
            hint, says = typing.get_args(hint)[:2]
        if hint not in _PARSERS or parameter.default is inspect.Parameter.empty:
            raise UsageError(
                f"procedure {function.__name__}: parameter {name} needs a default and a type of "
                "float, int, bool, str or tuple[float, ...]"
            )
        yield Parameter(name=name, type=hint, default=parameter.default, says=says)


def _parse_float(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _parse_bool(text: str) -> bool:
    words = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False}
    if text.lower() not in words:
        raise ValueError(text)
    return words[text.lower()]


_PARSERS: dict[Any, Callable[[str], Any]] = {
    float: _parse_float,
    int: int,
    bool: _parse_bool,
    str: str,
    tuple[float, ...]: lambda text: tuple(_parse_float(part) for part in text.split(",")),
}

_EXPECTED: dict[Any, str] = {
    float: "a finite number",
    int: "a whole number",
    bool: "yes or no",
    str: "a text",
    tuple[float, ...]: "numbers with commas between them",
}
