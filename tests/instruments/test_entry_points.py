"""Packages that add to benchctl: taken where they are sound, left out in one line where they are not."""

import itertools
from pathlib import Path

import pytest

from benchctl.plan.find import find_procedure, installed_procedures, procedure_names
from benchctl_instruments.catalog import driver, models, twin
from benchctl_instruments.entry_points import offers
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effects.registry import effect, effects
from benchctl_instruments.physics.effects.saturation import Saturation
from tests.third_party.packages import install, site

__all__ = ["site"]

PROCEDURE = '''
from benchctl.plan import Static, procedure


@procedure()
def {name}(s: float = 1.0):
    """Theirs."""
    yield Static(duration_s=s)
'''
NUMBERS = itertools.count()
"""For modules: Python imports each but once."""
DRIVER = "class Theirs:\n    def __init__(self, address, *, clock): pass\n"
EFFECT = '''
from dataclasses import dataclass
from typing import ClassVar

from benchctl_instruments.physics.effects.rate_squared import RateSquared


@dataclass(frozen=True, slots=True, kw_only=True)
class Theirs(RateSquared):
    """Theirs."""

    identifier: ClassVar[str] = "{identifier}"
    {more}
'''


def said(caplog: pytest.LogCaptureFixture) -> list[str]:
    assert all("\n" not in record.getMessage() for record in caplog.records)
    return [record.getMessage() for record in caplog.records]


def test_a_procedure_a_driver_a_twin_and_an_effect_of_another_package_are_taken(site: Path) -> None:
    points = {
        "benchctl.procedures": {"theirs_all": "theirs_a:theirs_all"},
        "benchctl.instruments": {"chamber.acme_9000": "theirs_b:Theirs"},
        "benchctl.simulated": {"chamber.acme_9000": "theirs_b:Theirs"},
        "benchctl.effects": {"gremlins": "theirs_c:Theirs"},
    }
    modules = {
        "theirs_a": PROCEDURE.format(name="theirs_all"),
        "theirs_b": DRIVER,
        "theirs_c": EFFECT.format(identifier="gremlins", more=""),
    }
    install(site, "acme-lab", points, modules)
    assert "theirs_all" in procedure_names()
    assert find_procedure("theirs_all").expand().procedure == "theirs_all"
    assert "acme_9000" in models("chamber")
    assert driver("chamber", "acme_9000") is twin("chamber", "acme_9000")
    assert effect("gremlins").identifier == "gremlins"
    assert list(effects()) == sorted(effects())


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("import nothing_of_that_name", "ModuleNotFoundError: No module named 'nothing_of_that_name'"),
        ("raise RuntimeError('two\\nlines')", "RuntimeError: two lines"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("def broken(:", "SyntaxError: .*"),
        ("", "AttributeError: .*thing"),
    ],
    ids=["missing", "raises", "exits", "no Python", "empty"],
)
def test_a_package_that_cannot_be_loaded_is_named_in_a_line_and_takes_nothing_else_down(
    text: str, reason: str, site: Path, caplog: pytest.LogCaptureFixture
) -> None:
    module = f"broken_{next(NUMBERS)}"
    points = {group: {name: f"{module}:thing"} for group, name in BROKEN.items()}
    install(site, "broken-lab", points, {module: text})
    calls = {
        "benchctl.procedures": lambda: find_procedure("sick"),
        "benchctl.instruments": lambda: driver("chamber", "sick"),
        "benchctl.simulated": lambda: twin("chamber", "sick"),
        "benchctl.effects": lambda: effect("sick"),
    }
    for group, call in calls.items():
        with pytest.raises(
            UsageError, match=f"package broken-lab adds {group}, .*{reason}.*; mend or uninstall"
        ) as err:
            call()
        assert "\n" not in str(err.value)
    assert effect("saturation") is Saturation
    assert "sick" not in effects()
    assert driver("chamber", "watlow_f4").__name__ == "WatlowF4"
    names = [name for name, _ in installed_procedures()]
    assert "static" in names
    assert "sick" not in names
    lines = said(caplog)
    assert len(lines) == 2  # an effect and a procedure were left out of what was listed
    assert all(line.startswith("benchctl: warning: package broken-lab adds benchctl.") for line in lines)
    assert all(": left out: cannot be loaded" in line for line in lines)


BROKEN = {
    "benchctl.procedures": "sick",
    "benchctl.instruments": "chamber.sick",
    "benchctl.simulated": "chamber.sick",
    "benchctl.effects": "sick",
}


def test_a_name_of_ours_stays_ours_and_that_is_said_once(site: Path, caplog: pytest.LogCaptureFixture) -> None:
    points = {
        "benchctl.procedures": {"static": "impostor:static"},
        "benchctl.instruments": {"chamber.watlow_f4": "impostor:Theirs"},
        "benchctl.simulated": {"chamber.watlow_f4": "impostor:Theirs"},
        "benchctl.effects": {"saturation": "impostor:Theirs", "coulomb_friction": "impostor:Theirs"},
    }
    install(site, "impostor-lab", points, {"impostor": "raise RuntimeError('nobody loads it')"})
    for _ in range(2):
        assert find_procedure("static").says.startswith("Bias")
        assert driver("chamber", "watlow_f4").__name__ == "WatlowF4"
        assert twin("chamber", "watlow_f4").__module__ == "benchctl_instruments.simulated.watlow_f4"
        assert effect("saturation") is Saturation
        assert "coulomb_friction" not in effects()
    lines = said(caplog)
    assert len(lines) == 5
    assert all("package impostor-lab adds" in line and "benchctl has one of that name" in line for line in lines)


def test_of_a_name_that_two_packages_add_neither_is_taken(site: Path, caplog: pytest.LogCaptureFixture) -> None:
    for lab in ("first-lab", "second-lab"):
        install(site, lab, {"benchctl.procedures": {"both": "both:both"}}, {"both": PROCEDURE.format(name="both")})
    with pytest.raises(UsageError, match="there is no procedure 'both'"):
        find_procedure("both")
    first, second = sorted(said(caplog))
    assert "package first-lab adds benchctl.procedures, both" in first
    assert "second-lab adds one of that name too; uninstall one of them" in first
    assert "package second-lab adds" in second


@pytest.mark.parametrize(
    ("more", "fault"),
    [
        ('coordinate: ClassVar[str] = "colour"', "its coordinate is 'colour', expected one or two"),
        ('stage: ClassVar[str] = "sensor"', "its stage is 'sensor', expected one of motion"),
        ('words: ClassVar[str] = "Short"', "its words must be one or two sentences, got 'Short'"),
        ("parameters: ClassVar[dict] = {}", "its parameters must be a mapping"),
        ("extra: float = 1.0", None),
        ("needed: float", "its field needed is no parameter, and has no default"),
    ],
)
def test_an_effect_that_does_not_describe_itself_is_left_out_with_what_is_wrong(
    more: str, fault: str | None, site: Path, caplog: pytest.LogCaptureFixture
) -> None:
    module = f"vague_{next(NUMBERS)}"
    text = EFFECT.format(identifier="gremlins", more=more)
    install(site, "vague-lab", {"benchctl.effects": {"gremlins": f"{module}:Theirs"}}, {module: text})
    assert ("gremlins" in effects()) == (fault is None)
    lines = said(caplog)
    assert len(lines) == (fault is not None)
    if fault is not None:
        assert f"package vague-lab adds benchctl.effects, gremlins = {module}:Theirs: left out: {fault}" in lines[0]
        with pytest.raises(UsageError, match=f"package vague-lab adds .*: {fault}"):
            effect("gremlins")


def test_an_effect_s_entry_point_has_its_identifier(site: Path, caplog: pytest.LogCaptureFixture) -> None:
    text = EFFECT.format(identifier="gremlins", more="")
    install(site, "other-lab", {"benchctl.effects": {"goblins": "goblins_m:Theirs"}}, {"goblins_m": text})
    assert "goblins" not in effects()
    assert "its identifier is 'gremlins', expected 'goblins'" in said(caplog)[0]


@pytest.mark.parametrize("value", ["os:sep", "os:path"])
def test_what_is_no_class_is_refused(value: str, site: Path) -> None:
    points = {
        "benchctl.effects": {"thing": value},
        "benchctl.procedures": {"thing": value},
        "benchctl.instruments": {"chamber.thing": value},
    }
    install(site, "odd-lab", points, {})
    with pytest.raises(UsageError, match=r"odd-lab .*expected a class of effects"):
        effect("thing")
    with pytest.raises(UsageError, match=r"odd-lab .*expected a function with @procedure"):
        find_procedure("thing")
    with pytest.raises(UsageError, match=r"odd-lab .*expected a class"):
        driver("chamber", "thing")


def test_a_driver_without_a_twin_is_told_so(site: Path) -> None:
    install(site, "real-lab", {"benchctl.instruments": {"chamber.real": "real_m:Theirs"}}, {"real_m": DRIVER})
    assert driver("chamber", "real").__name__ == "Theirs"
    says = "no simulated twin of 'real': package real-lab adds its driver and no benchctl.simulated"
    with pytest.raises(UsageError, match=says):
        twin("chamber", "real")


def test_what_is_ours_is_offered_by_us() -> None:
    ours = offers("benchctl.procedures")
    assert {ours[name].package for name in ("static", "two_stage")} == {"benchctl"}
