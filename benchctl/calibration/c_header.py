"""`benchctl export --to c-header`: the compensation as one C99 header for the firmware that reads the gyro.

It needs `<math.h>` alone, compiles as C++ too, and depends on the coefficients' bytes only: the same file gives the
same header. The operations are those of `AppliedLaw.rate_dps`, in its order; `gyro_self_test` checks on the
target that the same rates come out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchctl.atomic import whole_file
from benchctl.calibration.applied_law import CONVERGED, FLATTEST, STEEPEST, STEPS, AppliedLaw, reach
from benchctl.calibration.compensating import Compensation, self_test_points, tolerance_dps
from benchctl.limits import cut
from benchctl_instruments.errors import UsageError

_LONGEST = 200
"""Longest text in characters; C99 compilers need not accept a string of more than 4095 bytes."""


def in_comment(text: str) -> str:
    """Return a text for a block comment: one line of ASCII that cannot end the comment."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Constant:
    """A macro: its value, what it is, and its expanded uncertainty where that is known."""

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
    """How the coefficients of a stage are called; with its number where there are several."""
    stage = law.stages[index]
    prefix = f"GYRO_STAGE{index + 1}_K" if len(law.stages) > 1 else "GYRO_K"
    return StageNames(
        k_t=tuple(f"{prefix}_T{i + 1}_PER_C{i + 1}" for i in range(len(stage.k_t))),
        k_omega=tuple(f"{prefix}_W{2 * i + 2}_PER_DPS{2 * i + 2}" for i in range(len(stage.k_omega))),
    )


def constants(compensation: Compensation) -> Iterator[Constant]:
    """Every number that the functions of the header use, and those that its user should know."""
    law, expanded = compensation.law, compensation.expanded
    k0, u0, s = "K0_v_per_dps", "U0_v", "S_rad_per_dps"
    yield Constant(
        name="GYRO_K0_V_PER_DPS", value=law.K0_v_per_dps, comment="V/(deg/s), scale factor", expanded=expanded.get(k0)
    )
    yield Constant(name="GYRO_U0_V", value=law.U0_v, comment="V, output at rest", expanded=expanded.get(u0))
    if law.knows_temperature:
        yield Constant(name="GYRO_T0_C", value=law.T0_c, comment="degC, dT counts from here")
    if law.name == "sine":
        yield Constant(
            name="GYRO_S_RAD_PER_DPS",
            value=law.S_rad_per_dps,
            comment="rad/(deg/s), phase per rate",
            expanded=expanded.get(s),
        )
    for i, value in enumerate(law.bias, start=1):
        yield Constant(
            name=f"GYRO_U0_T{i}_V_PER_C{i}",
            value=value,
            comment=f"V/degC^{i}, output at rest over dT^{i}",
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
    law, valid = compensation.law, compensation.valid
    if law.name == "response" and law.stages[0].k_omega:
        end, most = reach(law.stages[0].k_omega)
        yield Constant(name="GYRO_REACH_DPS", value=end, comment="deg/s, beyond it the output tells no rate")
        yield Constant(name="GYRO_REACH_INDICATED_DPS", value=most, comment="deg/s, what the gyro makes of that")
    yield Constant(
        name="GYRO_DELAY_S",
        value=law.delay_s,
        comment="s, output behind motion",
        expanded=compensation.expanded.get("delay_s"),
    )
    slowest, fastest = valid.rate_dps
    yield Constant(name="GYRO_VALID_RATE_MIN_DPS", value=slowest, comment="deg/s, measured from here")
    yield Constant(name="GYRO_VALID_RATE_MAX_DPS", value=fastest, comment="deg/s, measured to here")
    coldest, warmest = valid.temperature_c
    if math.isfinite(coldest) and math.isfinite(warmest):
        yield Constant(name="GYRO_VALID_TEMPERATURE_MIN_C", value=coldest, comment="degC, measured from here")
        yield Constant(name="GYRO_VALID_TEMPERATURE_MAX_C", value=warmest, comment="degC, measured to here")
    yield Constant(name="GYRO_COVERAGE_FACTOR", value=compensation.k, comment="their level is that of this k, 95.45 %")


_GUARD = "GYRO_COMPENSATION_H"
_FORMULAS = {
    "sine": "rate = asin(S x / k(T)) / S",
    "polynomial": "rate = x k(T) k(x), and again by the factors of each further stage",
    "response": "rate k(rate) = x / k(T)",
}


def c_header(compensation: Compensation) -> str:
    """The text of the header.

    Raises
    ------
    UsageError
        The output is not in volts, or the law has no output for a rate in `valid`.
    """
    if compensation.output_unit != "V":
        raise UsageError(
            f"these coefficients are of an output in {compensation.output_unit}, expected V for a "
            "C header; export --to json"
        )
    parts = (
        _opening(compensation),
        _macros(compensation),
        _rate(compensation),
        _valid(compensation),
        _self_test(compensation),
        ["", f"#endif /* {_GUARD} */"],
    )
    return "\n".join(line for part in parts for line in part) + "\n"


def export_c_header(compensation: Compensation, path: Path) -> None:
    """Write the header atomically; `UsageError` where the law or the disk refuses."""
    text = c_header(compensation)
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="ascii", newline="\n")


def _opening(compensation: Compensation) -> Iterator[str]:
    yield "/*"
    yield " * Compensation of a gyroscope, written by benchctl: from volts and degrees Celsius to degrees per second."
    yield " *"
    yield f" * unit: {in_comment(compensation.unit) or 'not named'}"
    for name, digest in compensation.sources:
        yield f" * fitted on: {in_comment(name)}, digest {in_comment(digest)}"
    yield f" * coefficients.json: SHA-256 {compensation.sha256}"
    law = _FORMULAS[compensation.law.name]
    yield f" * law of the {'joint fit' if compensation.by == 'joint' else 'stages'}: {law},"
    yield " *   with x = (volts - U0(T)) / K0, U0(T) and k(T) polynomials in dT = celsius - T0"
    if compensation.error_percent is not None:
        percent = f"{compensation.error_percent:.3g} %"
        yield f" * largest error on runs that were not fitted: {percent} of the run's largest rate"
    yield " *"
    yield " * The rate is the sensed one: that of the case and the part of the Earth's rate along the axis. It belongs"
    yield " * to the output's time less GYRO_DELAY_S. _EXPANDED is the expanded uncertainty of a constant, with the"
    yield " * coverage factor GYRO_COVERAGE_FACTOR. For doubles of 64 bits, without -ffast-math: see gyro_self_test."
    yield " */"
    yield f"#ifndef {_GUARD}"
    yield f"#define {_GUARD}"
    yield ""
    yield "#include <math.h>"


def _macros(compensation: Compensation) -> Iterator[str]:
    yield ""
    yield f"#define GYRO_UNIT_SERIAL {string(compensation.unit)}"
    for i, (_, digest) in enumerate(compensation.sources, start=1):
        yield f"#define GYRO_SOURCE_{i}_DIGEST {string(digest)}"
    yield f"#define GYRO_COEFFICIENTS_SHA256 {string(compensation.sha256)}"
    yield ""
    for constant in constants(compensation):
        yield from _defined(constant)


def _defined(constant: Constant) -> Iterator[str]:
    yield f"#define {constant.name} {number(constant.value)} /* {constant.comment} */"
    if constant.expanded is not None:
        yield f"#define {constant.name}_EXPANDED {number(constant.expanded)}"


def _rate(compensation: Compensation) -> Iterator[str]:
    law = compensation.law
    stages = [stage_names(law, i) for i in range(len(law.stages))]
    if law.name == "response" and law.stages[0].k_omega:
        yield from _inverse(stages[0].k_omega)
    yield ""
    yield "/* Sensed rate in degrees per second; NaN where the law has none for these volts. */"
    yield "static inline double gyro_rate_dps(double volts, double celsius)"
    yield "{"
    yield from _indicated(law)
    if law.name == "sine":
        yield f"    const double sine = GYRO_S_RAD_PER_DPS * indicated_dps{_over(stages[0].k_t)};"
        yield "    return fabs(sine) <= 1.0 ? asin(sine) / GYRO_S_RAD_PER_DPS : (double)NAN;"
    elif law.name == "response":
        target = f"indicated_dps{_over(stages[0].k_t)}"
        yield f"    return gyro_inverse({target});" if law.stages[0].k_omega else f"    return {target};"
    else:
        yield "    double rate_dps = indicated_dps;"
        for stage in stages:
            yield from _corrected(stage)
        yield "    return rate_dps;"
    yield "}"


def _indicated(law: AppliedLaw) -> Iterator[str]:
    """The indicated rate, from volts and the straight line at this temperature."""
    bias = tuple(f"GYRO_U0_T{i + 1}_V_PER_C{i + 1}" for i in range(len(law.bias)))
    if law.knows_temperature:
        yield "    const double dt_c = celsius - GYRO_T0_C;"
    if bias:
        yield f"    const double bias_v = {polynomial(bias, 'dt_c')};"
    yield f"    const double indicated_dps = (volts - GYRO_U0_V{' - bias_v' if bias else ''}) / GYRO_K0_V_PER_DPS;"
    if not law.knows_temperature:
        yield "    (void)celsius;"


def _over(names: tuple[str, ...]) -> str:
    return f" / (1.0 + {polynomial(names, 'dt_c')})" if names else ""


def _corrected(stage: StageNames) -> Iterator[str]:
    """Yield the factors of one stage, both of that stage's input."""
    factors = [(stage.k_t, "dt_c"), (stage.k_omega, "square")]
    product = "".join(f" * (1.0 + {polynomial(names, argument)})" for names, argument in factors if names)
    if product:
        yield "    {"
        if stage.k_omega:
            yield "        const double square = rate_dps * rate_dps;"
        yield f"        rate_dps = rate_dps{product};"
        yield "    }"


def _inverse(names: tuple[str, ...]) -> Iterator[str]:
    """The inverse of rate·k_ω(rate), as `odd_inverse`."""
    slopes = tuple(f"{2 * i + 3}.0 * {name}" for i, name in enumerate(names))
    yield ""
    yield "/* The rate of which the gyro makes `target`: Newton's method, kept in a bracket. */"
    yield "static inline double gyro_inverse(double target)"
    yield "{"
    yield "    const double wanted = fabs(target);"
    yield f"    double low = wanted / {number(STEEPEST)};"
    yield f"    double high = fmin(wanted / {number(FLATTEST)}, GYRO_REACH_DPS);"
    yield "    double x = fmin(wanted, high);"
    yield "    double before = HUGE_VAL;"
    yield "    int step;"
    yield "    if (!(wanted <= GYRO_REACH_INDICATED_DPS)) {"
    yield "        return (double)NAN;"
    yield "    }"
    yield f"    for (step = 0; step < {STEPS}; ++step) {{"
    yield "        const double square = x * x;"
    yield f"        const double excess = x * (1.0 + {polynomial(names, 'square')}) - wanted;"
    yield f"        const double newton = x - excess / (1.0 + {polynomial(slopes, 'square')});"
    yield "        const double missed = fabs(excess);"
    yield "        double following;"
    yield "        if (excess > 0.0) {"
    yield "            high = x;"
    yield "        } else {"
    yield "            low = x;"
    yield "        }"
    yield "        following = newton >= low && newton <= high && 2.0 * missed <= before ? newton : 0.5 * (low + high);"
    yield "        before = missed;"
    yield f"        if (fabs(following - x) <= {number(CONVERGED)} * following) {{"
    yield "            x = following;"
    yield "            break;"
    yield "        }"
    yield "        x = following;"
    yield "    }"
    yield "    return target < 0.0 ? -x : x;"
    yield "}"


def _valid(compensation: Compensation) -> Iterator[str]:
    known = all(math.isfinite(end) for end in compensation.valid.temperature_c)
    yield ""
    yield "/* 1 where the coefficients were measured at such a rate and temperature, 0 where they only reach out. */"
    yield "static inline int gyro_rate_valid(double rate_dps, double celsius)"
    yield "{"
    if not known:
        yield "    (void)celsius; /* the temperature of their measurement is not recorded */"
    within = "rate_dps >= GYRO_VALID_RATE_MIN_DPS && rate_dps <= GYRO_VALID_RATE_MAX_DPS"
    if known:
        within += "\n        && celsius >= GYRO_VALID_TEMPERATURE_MIN_C && celsius <= GYRO_VALID_TEMPERATURE_MAX_C"
    yield f"    return {within};"
    yield "}"


def _self_test(compensation: Compensation) -> Iterator[str]:
    points = self_test_points(compensation)
    yield ""
    yield f"#define GYRO_SELF_TEST_POINTS {len(points)}"
    yield f"#define GYRO_SELF_TEST_TOLERANCE_DPS {number(tolerance_dps(compensation))}"
    yield ""
    yield "/* Outputs over the valid range, its corners among them, and the rates that they mean. */"
    yield "static const struct {"
    yield "    double volts;"
    yield "    double celsius;"
    yield "    double rate_dps;"
    yield "} gyro_self_test_points[GYRO_SELF_TEST_POINTS] = {"
    for point in points:
        yield f"    {{{number(point.volts)}, {number(point.celsius)}, {number(point.rate_dps)}}},"
    yield "};"
    yield ""
    yield "/* The number of points at which gyro_rate_dps() misses by more than the tolerance: 0 where all is well. */"
    yield "static inline int gyro_self_test(void)"
    yield "{"
    yield "    int missed = 0;"
    yield "    int i;"
    yield "    for (i = 0; i < GYRO_SELF_TEST_POINTS; ++i) {"
    yield "        const double rate_dps ="
    yield "            gyro_rate_dps(gyro_self_test_points[i].volts, gyro_self_test_points[i].celsius);"
    yield "        if (!(fabs(rate_dps - gyro_self_test_points[i].rate_dps) <= GYRO_SELF_TEST_TOLERANCE_DPS)) {"
    yield "            ++missed;"
    yield "        }"
    yield "    }"
    yield "    return missed;"
    yield "}"
