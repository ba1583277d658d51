"""The file of limits: units, and every mistake in one line that names the file and the line."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from benchctl.metrology.limit_file import Limits, limits_of_text, limits_template, read_limits
from benchctl.metrology.names import PROCEDURES, UNITS
from benchctl.metrology.observations import Settings
from benchctl.metrology.result import Limit
from benchctl.units import factor_between
from benchctl_instruments.errors import UsageError

PATH = Path("lab/limits.toml")
ONE = '[limits.scale_factor]\nlow = 49.5\nunit = "mV/(deg/s)"\n'


def limits(text: str) -> Limits:
    return limits_of_text(text, PATH)


def test_every_test_has_a_unit_and_a_procedure() -> None:
    assert UNITS.keys() == PROCEDURES.keys()
    for unit in UNITS.values():
        assert factor_between(unit, unit) == 1.0


def test_a_file_is_read_with_its_limits_settings_and_papers(tmp_path: Path) -> None:
    path = tmp_path / "limits.toml"
    text = (
        'title = "Acceptance of VG910"\nnumber = "17-2026"\nrevision = "B"\n'
        'customer = "ACME"\nstage = "after shock"\nguard = 0.5\n'
        '[settings]\nlow_rate_dps = 30\n[limits.bias]\nlow = -5\nhigh = 5\nunit = "deg/h"\n'
    )
    path.write_text(text)
    found = read_limits(path)
    assert found.limits == {"bias": Limit(low=-5.0, high=5.0, unit="deg/h")}
    assert (found.guard, found.settings) == (0.5, Settings(low_rate_dps=30.0))
    assert (found.papers.number, found.papers.revision) == ("17-2026", "B")
    assert (found.papers.title, found.papers.customer, found.papers.stage) == (
        "Acceptance of VG910",
        "ACME",
        "after shock",
    )
    assert (found.text, found.sha256) == (text, hashlib.sha256(text.encode()).hexdigest())


def test_what_is_not_stated_is_as_the_standard_practice() -> None:
    found = limits(ONE)
    assert (found.guard, found.settings) == (1.0, Settings())
    assert found.limits["scale_factor"] == Limit(low=49.5, high=None, unit="mV/(deg/s)")


def test_a_limit_of_zero_and_one_value_only_are_limits() -> None:
    found = limits('[limits.bias]\nlow = 0\nhigh = 0\nunit = "deg/h"\n')
    assert found.limits["bias"] == Limit(low=0.0, high=0.0, unit="deg/h")


BIAS = '[limits.bias]\nhigh = 5\nunit = "deg/h"\n'


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        (
            f'{BIAS}[limits.scale_factr]\nhigh = 5\nunit = "mV/(deg/s)"\n',
            4,
            "there is no test 'scale_factr': did you mean scale_factor?",
        ),
        ('[limits.xyzzy]\nhigh = 5\nunit = "deg/h"\n', 1, "there is no test 'xyzzy': there are scale_factor, "),
        ('[limits.bias]\nhigh = 5\nunit = "deg"\n', 3, "limits.bias.unit: the unit 'deg' is none of what"),
        (f'{BIAS}\n[limits.delay]\nunit = "ms"\n', 5, "limits.delay: expected low, high or both"),
        (
            f'{BIAS}[limits.delay]\nunit = "ms"\nlow = 2\nhigh = 1\n',
            6,
            "limits.delay: low (2) must not be above high (1)",
        ),
        ("[limits.bias]\nhigh = 5\n", 1, "limits.bias.unit: this field is needed and is not there"),
        ('[limits.bias]\nhigh = 5\nunit = ""\n', 3, "limits.bias.unit: "),
        ('[limits.bias]\nhigh = "5"\nlow = "a"\nunit = "deg/h"\n', 3, "limits.bias.low: "),
        ('[limits.bias]\nhigh = nan\nunit = "deg/h"\n', 2, "limits.bias.high: "),
        ('[limits.bias]\nhigh = inf\nunit = "deg/h"\n', 2, "limits.bias.high: "),
        ('[limits.bias]\nhigh = 5\nmax = 5\nunit = "deg/h"\n', 3, "limits.bias.max: there is no such field"),
        (f"{BIAS}hihg = 5\n", 4, "limits.bias.hihg: there is no such field: did you mean high?"),
        (f'titel = "x"\n{BIAS}', 1, "titel: there is no such field: did you mean title?"),
        (f"guard = -1\n{BIAS}", 1, "guard: "),
        (f"{BIAS}[settings]\nlow_rate_dps = 0\n", 5, "settings.low_rate_dps: "),
        (f'{BIAS}[settings]\nmean_s = "10"\nrest_s = -1\n', 6, "settings.rest_s: "),
        (f"{BIAS}[settings]\nlow_rate = 40\n", 5, "settings.low_rate: there is no such field"),
        ('title = "no limits"\n', 1, "limits: this field is needed and is not there"),
        ("[limits]\n", 1, "limits: "),
        ('[limits."a\\nb"]\nhigh = 1\nunit = "s"\n', 1, r"there is no test 'a\nb'"),
    ],
)
def test_what_is_wrong_is_one_line_that_names_the_file_and_the_line(text: str, line: int, says: str) -> None:
    with pytest.raises(UsageError) as caught:
        limits(text)
    told = str(caught.value)
    assert told.startswith(f"{PATH}, line {line}: ")
    assert says in told
    assert "\n" not in told


def test_text_that_is_no_toml_is_refused_with_its_line() -> None:
    with pytest.raises(UsageError, match=r"lab/limits.toml.*line 2"):
        limits('title = "a"\n[limits.bias\n')


@pytest.mark.parametrize("content", [None, b"title = \xff\n", b"x = 1\n" * 2_000_000])
def test_a_file_that_cannot_be_one_is_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "limits.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UsageError, match="limits") as caught:
        read_limits(path)
    assert str(path) in str(caught.value)


def test_the_template_reads_and_states_what_is_assumed_anyway() -> None:
    found = limits(limits_template())
    assert found.limits.keys() <= UNITS.keys()
    assert found.guard == 1.0
    assert found.settings == Settings(linearity_percent=10.0)
    left_out = UNITS.keys() - found.limits.keys()
    assert left_out == {"quantisation", "bias_instability", "rate_random_walk", "rate_ramp", "warm_up_bias"}
