"""A procedure: a function that yields steps, with its parameters taken from its signature.

A parameter is a keyword with a default; its type is `float`, `int`, `bool`, `str` or `tuple[float, ...]`.
`Annotated[int, "description with unit", Range(1, 100)]` documents it and declares the valid numbers.
"""

from __future__ import annotations

import inspect
import itertools
import math
import traceback
import typing
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from benchctl.closeness import meant
from benchctl.limits import MOST_STEPS, cut, shown
from benchctl.plan.steps import Step
from benchctl.units import quantity, unit_stated
from benchctl_instruments.errors import BenchError, UsageError


@dataclass(frozen=True, slots=True)
class Range:
    """The valid numbers of a parameter, in its own unit; for a list, of each of its numbers.

    The range includes `high`, and `low` unless `above` is true.
    """

    low: float = -math.inf
    high: float = math.inf
    above: bool = False

    def __contains__(self, value: float) -> bool:
        return value <= self.high and (value > self.low if self.above else value >= self.low)

    def __str__(self) -> str:
        low, high = (f"{bound:g}" if math.isfinite(bound) else "" for bound in (self.low, self.high))
        if self.above:
            return f"more than {low}, at most {high}" if high else f"more than {low}"
        return f"{low} to {high}" if low and high else f"{low} or more" if low else f"at most {high}" if high else ""


POSITIVE = Range(0.0, above=True)
"""More than 0, for durations, rates and frequencies."""

ANY = Range()


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A parameter of a procedure; `says` is its description. Its name states the unit of its numbers."""

    name: str
    type: Any
    default: Any
    says: str = ""
    range: Range = ANY

    def parse(self, text: str) -> Any:
        """Convert a text from the command line to a value; numbers may have a unit, see `benchctl.units`.

        Raises
        ------
        UsageError
            If the text is not of the parameter's type, or a number is out of range.
        """
        try:
            value = _PARSERS[self.type](text, unit_stated(self.name))
            self.require_in_range(value)
        except UsageError as err:
            raise UsageError(f"parameter {self.name}: {err}; its default is {self.default}") from err
        return value

    def require_in_range(self, value: Any) -> None:
        """Raise `UsageError` if a value of the parameter's type contains a number out of range."""
        if self.range == ANY:
            return
        for number in value if isinstance(value, tuple) else (value,):
            if number not in self.range:
                raise UsageError(f"expected {self.range}, got {shown(number)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The steps of a procedure with these parameters, and the source of the procedure."""

    procedure: str
    parameters: Mapping[str, Any]
    steps: tuple[Step, ...]
    calibrates: bool
    source: str = ""


@dataclass(frozen=True, slots=True)
class Procedure:
    """A procedure that can be listed, checked and run.

    If `calibrates` is true, its recording contains the data for a calibration, and `run` fits it immediately.
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
        """The first line of the docstring, which states what the procedure measures."""
        return (inspect.getdoc(self.function) or "").partition("\n")[0]

    def expand(self, texts: Mapping[str, str] | None = None) -> Plan:
        """Return the plan with these parameters, given as texts; the others keep their defaults.

        Raises
        ------
        UsageError
            For an unknown parameter, a value of the wrong type or out of range, a combination that the procedure
            refuses, or if it yields anything but steps or more than `MOST_STEPS`.
        """
        known = {parameter.name: parameter for parameter in self.parameters}
        values = {name: parameter.default for name, parameter in known.items()}
        for name, text in (texts or {}).items():
            if name not in known:
                raise UsageError(self._unknown(name, list(known)))
            values[name] = known[name].parse(text)
        given = cut(str(values))
        try:
            steps = tuple(itertools.islice(self.function(**values), MOST_STEPS + 1))
        except BaseException as err:
            # Any exception of a user's procedure is a fault of it or of its parameters, reported in one line.
            if isinstance(err, KeyboardInterrupt):
                raise
            where = fault_in(inspect.getfile(inspect.unwrap(self.function)), err)
            raise UsageError(
                f"procedure {self.name}: these parameters give no plan: {where}; they are {given}"
            ) from err
        if not steps:
            raise UsageError(f"procedure {self.name}: these parameters give no steps: {given}")
        if len(steps) > MOST_STEPS:
            raise UsageError(
                f"procedure {self.name}: these parameters give more than {MOST_STEPS} steps, which no plan may: {given}"
            )
        for number, step in enumerate(steps, 1):
            if not isinstance(step, Step):
                raise UsageError(
                    f"procedure {self.name}: step {number} is {shown(step)}, expected a step of benchctl.plan"
                )
        return Plan(
            procedure=self.name, parameters=values, steps=steps, calibrates=self.calibrates, source=self._source()
        )

    def _source(self) -> str:
        """Return the text of the file that defines it; empty if there is none, such as at an interactive prompt."""
        try:
            return inspect.getsource(inspect.getmodule(self.function) or self.function)
        except (OSError, TypeError):
            return ""

    def _unknown(self, name: str, known: list[str]) -> str:
        listed = ", ".join(known)
        return f"procedure {self.name} has no parameter {name!r}: {meant(name, known, f'it has {listed}')}"


def procedure(*, calibrates: bool = False) -> Callable[[Callable[..., Iterable[Step]]], Procedure]:
    """Make a procedure of a function that yields steps."""
    return lambda function: Procedure(function, calibrates)


def _read_parameters(function: Callable[..., Iterable[Step]]) -> Iterable[Parameter]:
    hints = typing.get_type_hints(function, include_extras=True)
    for name, signed in inspect.signature(function).parameters.items():
        hint: Any = hints.get(name)
        described: list[Any] = []
        if typing.get_origin(hint) is typing.Annotated:
            hint, *described = typing.get_args(hint)
        if hint not in _PARSERS or signed.default is inspect.Parameter.empty:
            raise UsageError(
                f"procedure {function.__name__}: parameter {name} needs a default and a type of "
                "float, int, bool, str or tuple[float, ...]"
            )
        text = next((each for each in described if isinstance(each, str)), "")
        limits = next((each for each in described if isinstance(each, Range)), ANY)
        parameter = Parameter(name=name, type=hint, default=signed.default, says=text, range=limits)
        try:
            parameter.require_in_range(parameter.default)
        except UsageError as err:
            raise UsageError(f"procedure {function.__name__}: the default of {name}: {err}") from err
        yield parameter


def fault_in(file: str, err: BaseException) -> str:
    """Return the message of an error in one line, preceded by the line of `file` that raised it, if known."""
    lines = [frame.lineno for frame in traceback.extract_tb(err.__traceback__) if frame.filename == file]
    message = str(err) if isinstance(err, BenchError) else f"{type(err).__name__}: {err}"
    return f"{f'{file}, line {lines[-1]}: ' if lines else ''}{cut(' '.join(message.split()))}"


def _parse_whole(text: str, unit: str) -> int:
    with suppress(ValueError):
        return int(text)
    number = quantity(text, unit) if unit else math.nan
    if not number.is_integer():
        raise UsageError(f"expected an integer, got {shown(text)}")
    return int(number)


def _parse_bool(text: str, unit: str) -> bool:
    words = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False}
    if text.lower() not in words:
        raise UsageError(f"expected yes or no, got {shown(text)}")
    return words[text.lower()]


def _parse_numbers(text: str, unit: str) -> tuple[float, ...]:
    parts = text.split(",")
    try:
        numbers = tuple(quantity(part, unit) for part in parts)
    except UsageError as err:
        raise UsageError(f"expected numbers with commas between them, and of one of them {err}") from err
    if len({_is_bare(part) for part in parts}) > 1:
        raise UsageError(f"expected numbers that are all bare or all have a unit, got {shown(text)}")
    return numbers


def _is_bare(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


_PARSERS: dict[Any, Callable[[str, str], Any]] = {
    float: quantity,
    int: _parse_whole,
    bool: _parse_bool,
    str: lambda text, unit: text,
    tuple[float, ...]: _parse_numbers,
}
"""Functions that convert a text to a value, given the unit that the parameter's name states."""
