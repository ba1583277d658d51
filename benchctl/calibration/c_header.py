"""`benchctl export --to c-header`: the compensation as one C99 header for the firmware that reads the gyro.

It needs only `<math.h>`, compiles as C++ too, and depends only on the bytes of the coefficients: the same file gives
the same header. Its template is `c_header.h.j2`; `c_three_axes.h.j2` is the part for three axes. The operations are
those of `AppliedLaw.rate_dps`, in the same order, and `gyro_self_test` checks on the target that the rates agree.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy  # loads interpolate on first use
from jinja2 import Environment, PackageLoader, StrictUndefined

from benchctl.atomic import whole_file
from benchctl.calibration.axes_compensation import AxesCompensation
from benchctl.calibration.compensating import Compensation, self_test_points, tolerance_dps
from benchctl.calibration.discovered import CONVERGED as CONVERGED_RATE
from benchctl.calibration.discovered import FEWEST_TURNS, PLAIN_TURNS, TURNS, Discovered
from benchctl.calibration.model import CONVERGED, FLATTEST, STEEPEST, STEPS, AppliedLaw, reach
from benchctl.limits import cut
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.structure_places import LEAST_TURNING_DPS
from benchctl_instruments.physics.structure_shapes import EDGE
from benchctl_instruments.physics.structures import Structure

_LONGEST = 200
"""Maximum length of a text in characters; a C99 compiler need not accept a string of more than 4095 bytes."""


def in_comment(text: str) -> str:
    """Return a text for a block comment: one line of ASCII that cannot end the comment."""
    plain = cut(text, _LONGEST).encode("ascii", "backslashreplace").decode()
    printable = "".join(character if character.isprintable() else " " for character in plain)
    for ending, harmless in (("*/", "* /"), ("/*", "/ *"), ("??", "? ?")):
        while ending in printable:
            printable = printable.replace(ending, harmless)
    return printable.strip()


def string(text: str) -> str:
    """Return a string literal of the text's UTF-8 bytes; special ones are written as three octal digits."""
    written = (_character(byte) for byte in cut(text, _LONGEST).encode("utf-8"))
    return f'"{"".join(written)}"'


def number(value: float) -> str:
    """Return a constant of type double that is read back as the same double; in parentheses, because of its sign."""
    text = f"{value:.17g}"
    return f"({text if any(mark in text for mark in '.en') else f'{text}.0'})"


def polynomial(names: Sequence[str], argument: str) -> str:
    """Return c1·z + c2·z² + … by Horner's rule, from the names of its coefficients; `0.0` if there are none."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Constant:
    """A macro: its value, its description, and its expanded uncertainty if known."""

    name: str
    value: float
    comment: str
    expanded: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StageNames:
    """The macros of one stage's coefficients, in the order of `Factors`."""

    k_t: tuple[str, ...]
    k_omega: tuple[str, ...]


def stage_names(law: AppliedLaw, index: int) -> StageNames:
    """Return the names of a stage's coefficients; they include its number if there are several stages."""
    stage = law.stages[index]
    prefix = f"GYRO_STAGE{index + 1}_K" if len(law.stages) > 1 else "GYRO_K"
    return StageNames(
        k_t=tuple(f"{prefix}_T{i + 1}_PER_C{i + 1}" for i in range(len(stage.k_t))),
        k_omega=tuple(f"{prefix}_W{2 * i + 2}_PER_DPS{2 * i + 2}" for i in range(len(stage.k_omega))),
    )


def bias_names(compensation: Compensation) -> tuple[str, ...]:
    """Return the macros of the coefficients of the bias over temperature, from the first power up."""
    unit = _OUTPUTS[compensation.output_unit][1]
    return tuple(f"GYRO_U0_T{power}_{unit}_PER_C{power}" for power in range(1, len(compensation.law.bias) + 1))


def constants(compensation: Compensation) -> Iterator[Constant]:
    """Yield every number that the functions of the header use, and those that its user needs."""
    law, expanded = compensation.law, compensation.expanded
    unit, upper = compensation.output_unit, _OUTPUTS[compensation.output_unit][1]
    k0, u0, s = "K0_v_per_dps", "U0_v", "S_rad_per_dps"
    yield Constant(
        name=f"GYRO_K0_{upper}_PER_DPS",
        value=law.K0_v_per_dps,
        comment=f"{f'({unit})' if '/' in unit else unit}/(deg/s), scale factor",
        expanded=expanded.get(k0),
    )
    yield Constant(
        name=f"GYRO_U0_{upper}", value=law.U0_v, comment=f"{unit}, output at rest", expanded=expanded.get(u0)
    )
    if law.knows_temperature:
        yield Constant(name="GYRO_T0_C", value=law.T0_c, comment="degC, dT counts from here")
    if law.name == "sine":
        yield Constant(
            name="GYRO_S_RAD_PER_DPS",
            value=law.S_rad_per_dps,
            comment="rad/(deg/s), phase per rate",
            expanded=expanded.get(s),
        )
    for i, (name, value) in enumerate(zip(bias_names(compensation), law.bias, strict=True), start=1):
        yield Constant(
            name=name,
            value=value,
            comment=f"{unit}/degC^{i}, output at rest over dT^{i}",
            expanded=expanded.get(f"c{i}"),
        )
    for index in range(len(law.stages)):
        yield from _of_stage(compensation, index)
    yield from _limits(compensation)


def _of_stage(compensation: Compensation, index: int) -> Iterator[Constant]:
    law, expanded = compensation.law, compensation.expanded
    stage, names = law.stages[index], stage_names(law, index)
    letter = "g" if law.name == "sine" else "a"
    for i, (name, value) in enumerate(zip(names.k_t, stage.k_t, strict=True), start=1):
        yield Constant(name=name, value=value, comment=f"degC^-{i}, of dT^{i}", expanded=expanded.get(f"{letter}{i}"))
    for i, (name, value) in enumerate(zip(names.k_omega, stage.k_omega, strict=True), start=1):
        power = 2 * i
        yield Constant(
            name=name, value=value, comment=f"(deg/s)^-{power}, of rate^{power}", expanded=expanded.get(f"b{power}")
        )


def _limits(compensation: Compensation) -> Iterator[Constant]:
    law = compensation.law
    if law.name == "response" and law.stages[0].k_omega:
        end, most = reach(law.stages[0].k_omega)
        yield Constant(
            name="GYRO_REACH_DPS", value=end, comment="deg/s, beyond it the output does not determine the rate"
        )
        yield Constant(
            name="GYRO_REACH_INDICATED_DPS", value=most, comment="deg/s, the rate that the gyro indicates there"
        )
    yield Constant(
        name="GYRO_DELAY_S",
        value=law.delay_s,
        comment="s, output behind motion",
        expanded=compensation.expanded.get("delay_s"),
    )
    yield from _of_use(compensation)


def axes_constants(compensation: AxesCompensation) -> Iterator[Constant]:
    """Yield the same for three axes: `GYRO_MATRIX_XY` is the output x for a rate about y; then those per °C."""
    yield Constant(name="GYRO_T0_C", value=compensation.T0_c, comment="degC, dT counts from here")
    for law, suffix, per in ((compensation.at_T0, "", ""), (compensation.per_c, "_per_c", "/degC")):
        for name, value, unit in law.numbers():
            yield Constant(
                name=f"GYRO_{name}{suffix}".upper(),
                value=value,
                comment=f"{unit}{per}",
                expanded=compensation.expanded.get(f"{name}{suffix}"),
            )
    yield from _of_use(compensation)


def _of_use(compensation: Compensation | AxesCompensation) -> Iterator[Constant]:
    valid = compensation.valid
    slowest, fastest = valid.rate_dps
    yield Constant(name="GYRO_VALID_RATE_MIN_DPS", value=slowest, comment="deg/s, measured from here")
    yield Constant(name="GYRO_VALID_RATE_MAX_DPS", value=fastest, comment="deg/s, measured to here")
    coldest, warmest = valid.temperature_c
    if math.isfinite(coldest) and math.isfinite(warmest):
        yield Constant(name="GYRO_VALID_TEMPERATURE_MIN_C", value=coldest, comment="degC, measured from here")
        yield Constant(name="GYRO_VALID_TEMPERATURE_MAX_C", value=warmest, comment="degC, measured to here")
    yield Constant(name="GYRO_COVERAGE_FACTOR", value=compensation.k, comment="their level is that of this k, 95.45 %")


_OUTPUTS = {"V": ("volts", "V"), "deg/s": ("stated_dps", "DPS")}
"""The argument of the functions and the unit in the names of the macros, for each unit of an output."""

_FORMULAS = {
    "sine": "rate = asin(S x / k(T)) / S",
    "polynomial": "rate = x k(T) k(x), and again by the factors of each further stage",
    "response": "rate k(rate) = x / k(T)",
}


def c_header(compensation: Compensation | AxesCompensation) -> str:
    """Return the text of the header.

    Raises
    ------
    UsageError
        If the output of one axis is neither in volts nor in deg/s, or the law has no output for a rate in `valid`.
    """
    environment = Environment(
        loader=PackageLoader("benchctl.calibration", ""),
        autoescape=False,  # noqa: S701 - C, whose texts the filters make harmless
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "in_comment": in_comment,
        "string_literal": string,
        "number": number,
        "polynomial": polynomial,
    }
    valid = compensation.valid
    common = {
        "compensation": compensation,
        "temperature_known": all(math.isfinite(end) for end in valid.temperature_c),
        "tolerance_dps": tolerance_dps(valid),
    }
    if isinstance(compensation, AxesCompensation):
        return environment.get_template("c_three_axes.h.j2").render(
            inputs="three stated rates",
            constants=list(axes_constants(compensation)),
            points=compensation.self_test_points(),
            **common,
        )
    if compensation.output_unit not in _OUTPUTS:
        raise UsageError(
            f"these coefficients are of an output in {compensation.output_unit}, expected "
            f"{' or '.join(_OUTPUTS)} for a C header; export --to json"
        )
    output, unit = _OUTPUTS[compensation.output_unit]
    law = compensation.law
    stages = [stage_names(law, index) for index in range(len(law.stages))]
    return environment.get_template("c_header.h.j2").render(
        inputs="volts" if unit == "V" else "the stated rate",
        output=output,
        unit=unit,
        law=law,
        formula=_FORMULAS[law.name],
        constants=list(constants(compensation)),
        stages=stages,
        slopes=[f"{2 * i + 3}.0 * {name}" for i, name in enumerate(stages[0].k_omega)],
        bias=bias_names(compensation),
        points=self_test_points(compensation),
        STEEPEST=STEEPEST,
        FLATTEST=FLATTEST,
        CONVERGED=CONVERGED,
        STEPS=STEPS,
        structures=c_structures(law.discovered),
        TURNS=TURNS,
        PLAIN_TURNS=PLAIN_TURNS,
        FEWEST_TURNS=FEWEST_TURNS,
        CONVERGED_RATE=CONVERGED_RATE,
        LEAST_TURNING_DPS=LEAST_TURNING_DPS,
        **common,
    )


def export_c_header(compensation: Compensation | AxesCompensation, path: Path) -> None:
    """Write the header atomically; raise `UsageError` if the law is not suitable or the disk cannot be written."""
    text = c_header(compensation)
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="ascii", newline="\n")


_EXPRESSIONS: Mapping[str, str] = {
    "step": "{change} * gyro_ramp(x, {at}, {width})",
    "step_below": "{change} * gyro_ramp(-x, -{at}, {width})",
    "steps": "{change} * gyro_ramp(x, {at}, {width}) + {change_2} * gyro_ramp(x, {at_2}, {width})",
    "jump": "(x >= {at} ? {change} : 0.0)",
    "plateau": "{change} * (gyro_ramp(x, {at}, {edge} * {length}) - gyro_ramp(x, {at} + {length}, {edge} * {length}))",
    "kink": "{above} * fmax(x - {at}, 0.0)",
    "kink_below": "{below} * fmin(x - {at}, 0.0)",
    "power": "{change} * pow(fmax(x - {at}, 0.0) / fmax({high} - {at}, 1e-9), {exponent})",
    "power_below": "{change} * pow(fmax({at} - x, 0.0) / fmax({at} - {low}, 1e-9), {exponent})",
    "bend": "{below} * fmin(x - {at}, 0.0) + {above} * fmax(x - {at}, 0.0)",
    "bump": "{change} * exp(-0.5 * ((x - {at}) / {width}) * ((x - {at}) / {width}))",
    "resonance": "{change} / (1.0 + ((x - {at}) / {width}) * ((x - {at}) / {width}))",
    "wave": "{cosine} * cos(GYRO_TURN / {period} * x) + {sine} * sin(GYRO_TURN / {period} * x)",
    "line": "{c1} * x",
    "parabola": "({c1} + {c2} * x) * x",
    "cubic": "({c1} + ({c2} + {c3} * x) * x) * x",
    "rise": "{change} * exp(fmin((x - {high}) / {tau}, 0.0))",
    "fall": "{change} * exp(fmin(({low} - x) / {tau}, 0.0))",
    "negative": "(x < 0.0 ? {change} : 0.0)",
    "positive": "(x > 0.0 ? {change} : 0.0)",
    "either": "(x != 0.0 ? {change} : 0.0)",
}
_COORDINATES = {
    "gyro_temp": "celsius",
    "rate": "rate_dps",
    "abs_rate": "fabs(rate_dps)",
    "rate_sign": "gyro_direction(rate_dps)",
    "output": "output",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class CStructure:
    """A structure in C.

    `constants` are name, value and unit of its macros; `pieces` are those of a cubic spline: the start of each, and its
    coefficients from the third power down. `expression` is its function of `x`, which is `coordinate`; it is multiplied
    by `times` unless that is empty.
    """

    says: str
    acts_on: str
    constants: Sequence[tuple[str, float, str]]
    pieces: Sequence[Sequence[float]]
    table: str
    coordinate: str
    times: str
    expression: str

    @property
    def text(self) -> str:
        """All expressions of the structure, from which the required functions are determined."""
        return f"{self.coordinate} {self.times} {self.expression}"


def c_structures(discovered: Discovered) -> list[CStructure]:
    """Return the structures to be subtracted from the output; raise `UsageError` for a shape without a C version."""
    return [_in_c(number, name, one) for number, (name, one) in enumerate(discovered.structures.items(), start=1)]


def _in_c(number: int, named: str, one: Structure) -> CStructure:
    prefix = f"GYRO_STRUCTURE{number}_"
    names = {parameter: f"{prefix}{parameter.upper()}" for parameter in one.parameters}
    stated: Sequence[str] = tuple(one.parameters)
    table, pieces = "", list[list[float]]()
    if one.shape.startswith("spline"):
        stated, table, pieces = ("low", "high"), f"gyro_structure{number}_pieces", _pieces(one)
        expression = f"gyro_spline({table}, {len(pieces)}, fmin(fmax(x, {names['low']}), {names['high']}))"
    elif one.shape in _EXPRESSIONS:
        expression = _EXPRESSIONS[one.shape].format(**names, edge=EDGE)
    else:
        raise UsageError(f"{named}: the shape {one.shape} is not written in C; export --to json")
    return CStructure(
        says=_plain(one.says()),
        acts_on=one.acts_on,
        constants=[(names[name], one.values[name], one.parameters[name].unit) for name in stated],
        pieces=pieces,
        table=table,
        coordinate=_COORDINATES[one.over],
        times=_COORDINATES[one.times] if one.times else "",
        expression=expression,
    )


def _plain(text: str) -> str:
    for sign, word in (("°C", "degC"), ("°/s", "deg/s"), ("°", " deg"), ("±", "+-")):
        text = text.replace(sign, word)
    return text


def _pieces(one: Structure) -> list[list[float]]:
    values = [one.values[name] for name in one.parameters if name not in ("low", "high")]
    knots = np.linspace(one.values["low"], one.values["high"], len(values))
    curve = scipy.interpolate.make_interp_spline(knots, values, k=3)
    cubic = scipy.interpolate.PPoly.from_spline((curve.t, curve.c, curve.k))
    begins = zip(cubic.x[:-1].tolist(), cubic.x[1:].tolist(), cubic.c.T.tolist(), strict=True)
    return [[begin, *powers] for begin, end, powers in begins if end > begin]
