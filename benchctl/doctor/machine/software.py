"""Python, benchctl, and the packages that it needs, by what benchctl's own installation says of itself."""

from __future__ import annotations

import platform
import re
import sys
from collections.abc import Iterator
from importlib import metadata

import benchctl
from benchctl.doctor.finding import MACHINE, Finding, bad, look, ok

_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)\s*(?:\[[^\]]*\])?\s*([^;]*)(?:;\s*(.*))?")
_EXTRA = re.compile(r"""extra\s*==\s*["']([^"']+)["']""")
_CLAUSE = re.compile(r"(>=|<=|==|!=|<|>)\s*([0-9.]+)")
_FOR_DEVELOPERS = frozenset({"test", "fuzz"})


def software_findings() -> Iterator[Finding]:
    """Python and benchctl, the packages, the optional extras."""
    try:
        told = metadata.metadata("benchctl")
    except metadata.PackageNotFoundError:
        yield look(
            MACHINE,
            "benchctl",
            f"{benchctl.__version__} runs from a folder and is not installed, so that its procedures have no names",
            "in the checkout: python -m pip install .",
        )
        return
    python, needs = platform.python_version(), told["Requires-Python"] or ""
    where = f"{platform.python_implementation()} {python} at {sys.executable}"
    if satisfies(python, needs):
        yield ok(MACHINE, "Python", where)
    else:
        do = f"install a Python {needs} and benchctl in a virtual environment of it"
        yield bad(MACHINE, "Python", f"{where}; benchctl needs {needs}", do, unusable=True)
    yield ok(MACHINE, "benchctl", f"{benchctl.__version__} at {next(iter(benchctl.__path__))}")
    requirements = metadata.requires("benchctl") or []
    wrong = missing(requirements, "")
    if wrong:
        do = "in the checkout: python -m pip install --upgrade ."
        yield bad(MACHINE, "packages", f"benchctl cannot do without: {'; '.join(wrong)}", do, unusable=True)
    else:
        yield ok(MACHINE, "packages", "all that benchctl needs are there, in versions that it takes")
    for extra in told.get_all("Provides-Extra") or []:
        if extra not in _FOR_DEVELOPERS:
            yield _extra(extra, requirements)


def missing(requirements: list[str], extra: str) -> list[str]:
    """Those of an extra's requirements (of benchctl's own: the empty extra) that are not met, in words."""
    return [says for line in requirements if _extra_of(line) == extra for says in _unmet(line)]


def satisfies(version: str, wanted: str) -> bool:
    """Whether a version meets `>=3,<4` and the like; only the numbers of both are compared.

    >>> satisfies("3.16.2", "<3.17,>=3.16.1"), satisfies("3.17.0", "<3.17,>=3.16.1")
    (True, False)
    """
    have = _numbers(version)
    for operator, text in _CLAUSE.findall(wanted):
        want = _numbers(text)
        width = max(len(have), len(want))
        left, right = (numbers + (0,) * (width - len(numbers)) for numbers in (have, want))
        holds = {
            ">=": left >= right,
            "<=": left <= right,
            "==": left == right,
            "!=": left != right,
            "<": left < right,
            ">": left > right,
        }
        if not holds[operator]:
            return False
    return True


def _extra(extra: str, requirements: list[str]) -> Finding:
    wrong = missing(requirements, extra)
    if wrong:
        do = f'where it is wanted: python -m pip install ".[{extra}]" in the checkout'
        return ok(MACHINE, f"extra {extra}", f"not installed: {'; '.join(wrong)}", do)
    return ok(MACHINE, f"extra {extra}", "installed")


def _unmet(line: str) -> Iterator[str]:
    if (parts := _REQUIREMENT.match(line)) is None:
        return
    name, wanted = parts[1], parts[2].strip()
    if name == "benchctl":  # an extra that brings another extra
        return
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        yield f"{name} is not there"
        return
    if not satisfies(version, wanted):
        yield f"{name} {version} is there, {wanted} is wanted"


def _extra_of(line: str) -> str:
    found = _EXTRA.search(line)
    return found[1] if found else ""


def _numbers(version: str) -> tuple[int, ...]:
    found = re.match(r"\d+(?:\.\d+)*", version)
    return tuple(int(part) for part in found[0].split(".")) if found else ()
