from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest

from benchctl.limits import MOST_STEPS
from benchctl.plan import POSITIVE, ConstantRate, Range, Sine, Soak, Static, Step, ThermalRamp, procedure
from benchctl.plan.find import find_procedure, procedure_names
from benchctl.plan.steps import faults
from benchctl_instruments.errors import UsageError
from tests.benchctl.cli.processes import benchctl


@procedure(calibrates=True)
def example(
    rate_dps: Annotated[float, "rate, °/s"] = 10.0,
    points: int = 2,
    back: bool = False,
    list_hz: tuple[float, ...] = (1.0, 2.0),
) -> Iterator[Step]:
    """What it measures.

    And more.
    """
    yield Soak(setpoint_c=20.0, hold_s=float(points))
    if back:
        yield Static(duration_s=sum(list_hz))
    yield ConstantRate(rate_dps=rate_dps, duration_s=360 / rate_dps)


def test_parameters_are_read_off_the_signature() -> None:
    found = {parameter.name: (parameter.type, parameter.default, parameter.says) for parameter in example.parameters}
    assert found["rate_dps"] == (float, 10.0, "rate, °/s")
    assert found["list_hz"] == (tuple[float, ...], (1.0, 2.0), "")
    assert example.says == "What it measures."


def test_texts_become_values_of_the_parameters_types() -> None:
    plan = example.expand({"rate_dps": "-5e1", "points": "3", "back": "yes", "list_hz": "0.5,0.25"})
    assert plan.parameters == {"rate_dps": -50.0, "points": 3, "back": True, "list_hz": (0.5, 0.25)}
    assert plan.steps[1].streamed_s == 0.75
    assert plan.calibrates
    assert "def example(" in plan.source


def test_numbers_may_bring_a_unit_and_are_kept_in_the_one_that_the_name_states() -> None:
    plan = example.expand({"rate_dps": "1 rpm", "list_hz": "500mHz,0.25 Hz"})
    assert plan.parameters == {"rate_dps": 6.0, "points": 2, "back": False, "list_hz": (0.5, 0.25)}


def test_a_whole_number_may_bring_a_unit_where_it_stays_whole() -> None:
    @procedure()
    def whole(hold_s: int = 60) -> Iterator[Step]:
        yield Static(duration_s=hold_s)

    assert whole.expand({"hold_s": "1.5 min"}).parameters == {"hold_s": 90}
    with pytest.raises(UsageError, match=r"expected an integer, got '1.51 min'"):
        whole.expand({"hold_s": "1.51 min"})


@pytest.mark.parametrize(
    ("texts", "says"),
    [
        ({"rate_dsp": "1"}, "did you mean rate_dps?"),
        ({"xyz": "1"}, "it has rate_dps, points, back, list_hz"),
        ({"points": "2.5"}, "parameter points: expected an integer, got '2.5'; its default is 2"),
        ({"rate_dps": "nan"}, "expected a number in deg/s"),
        ({"rate_dps": "fast"}, "rad/s, deg/h or rpm), got 'fast'; its default is 10.0"),
        ({"rate_dps": "5 Hz"}, "parameter rate_dps: expected a number in deg/s"),
        ({"points": "5 s"}, "expected an integer, got '5 s'"),
        ({"list_hz": "1,2,3 kHz"}, "all bare or all have a unit, got '1,2,3 kHz'"),
        ({"back": "maybe"}, "expected yes or no"),
        ({"list_hz": "1;2"}, "numbers with commas between them"),
        ({"rate_dps": "0"}, "these parameters give no plan"),
    ],
)
def test_a_parameter_that_cannot_be_used_is_named_with_what_was_expected(texts: dict[str, str], says: str) -> None:
    with pytest.raises(UsageError, match=r"procedure example|parameter") as caught:
        example.expand(texts)
    assert says in str(caught.value)


@procedure()
def ranged(
    points: Annotated[int, "set points", Range(1, 100)] = 3,
    tops_dps: Annotated[tuple[float, ...], "rates", POSITIVE] = (1.0, 2.0),
    share_percent: Annotated[float, Range(0, 100, above=True), "share"] = 50.0,
    least_c: Annotated[float, Range(high=0.0)] = -1.0,
) -> Iterator[Step]:
    """What it measures."""
    yield from [Static(duration_s=share_percent)] * points


@pytest.mark.parametrize(
    ("texts", "says"),
    [
        ({"points": "0"}, "parameter points: expected 1 to 100, got 0; its default is 3"),
        ({"points": "-3"}, "parameter points: expected 1 to 100, got -3"),
        ({"points": "100000000"}, "parameter points: expected 1 to 100, got 100000000"),
        ({"tops_dps": "5,0,6"}, "parameter tops_dps: expected more than 0, got 0.0"),
        ({"share_percent": "0"}, "parameter share_percent: expected more than 0, at most 100, got 0.0"),
        ({"least_c": "1"}, "parameter least_c: expected at most 0, got 1.0"),
    ],
)
def test_a_number_out_of_its_declared_range_is_refused_before_the_procedure_begins(
    texts: dict[str, str], says: str
) -> None:
    assert len(ranged.expand({"points": "100", "share_percent": "100", "least_c": "0"}).steps) == 100
    with pytest.raises(UsageError) as caught:
        ranged.expand(texts)
    assert says in str(caught.value)


@pytest.mark.parametrize("name", procedure_names())
def test_every_number_of_our_procedures_but_a_temperature_has_a_range(name: str) -> None:
    open_ended = {
        one.name for one in find_procedure(name).parameters if one.type not in (bool, str) and not str(one.range)
    }
    assert {each for each in open_ended if not each.endswith("_c")} <= {"base_dps"}


def test_a_default_out_of_its_own_range_is_refused_when_the_procedure_is_made() -> None:
    with pytest.raises(UsageError, match="procedure wrong: the default of points: expected 1 to 9, got 10"):

        @procedure()
        def wrong(points: Annotated[int, Range(1, 9)] = 10) -> Iterator[Step]:
            yield Static(duration_s=float(points))


def test_a_procedure_that_goes_on_and_on_is_ended_at_the_most_steps_of_a_plan() -> None:
    begun = []

    @procedure()
    def endless(steps: int = 10**9) -> Iterator[Step]:
        for number in range(steps):
            begun.append(number)
            yield Static(duration_s=1.0)

    assert len(endless.expand({"steps": str(MOST_STEPS)}).steps) == MOST_STEPS
    begun.clear()
    with pytest.raises(UsageError, match=f"these parameters give more than {MOST_STEPS} steps"):
        endless.expand()
    assert len(begun) == MOST_STEPS + 1


LAWLESS = """from benchctl.plan import Static, procedure

@procedure()
def lawless(number: int = 1):
    {}
    yield Static(duration_s=1.0)
"""


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("raise GeneratorExit", "GeneratorExit"),
        ("raise type('Own', (BaseException,), {})('own')", "Own: own"),
    ],
)
def test_a_procedure_that_raises_anything_is_one_line_with_its_own(tmp_path: Path, body: str, says: str) -> None:
    file = tmp_path / "lawless.py"
    file.write_text(LAWLESS.format(body))
    refused = benchctl("check", file, "--bench", "simulated", "--offline")
    assert refused.returncode == 2
    (line,) = refused.stderr.splitlines()
    assert f"{file}, line 5: {says}" in line


def test_a_name_longer_than_a_file_may_have_is_no_procedure() -> None:
    for name in ("x" * 5000, "x" * 5000 + ".py"):
        refused = benchctl("check", name, "--bench", "simulated")
        assert refused.returncode == 2
        (line,) = refused.stderr.splitlines()
        assert "there is no such" in line or "there is no procedure" in line
        assert len(line) < 700


@pytest.mark.parametrize(
    ("parameters", "says"),
    [
        (("static", "soak_s=1e15"), "hold_s is 1e+15, expected at most 31622400, a year"),
        (("temperature_sweep", "return_c_per_min=1e-300"), "streams for 6e+303 s, expected at most 31622400, a year"),
    ],
)
def test_a_step_of_more_than_a_year_is_refused(parameters: tuple[str, str], says: str) -> None:
    refused = benchctl("run", parameters[0], "--bench", "simulated", "--dry-run", "-p", parameters[1])
    assert refused.returncode == 2
    (line,) = refused.stderr.splitlines()
    assert says in line


def test_the_numbers_of_a_step_may_be_of_any_library() -> None:
    step = Sine(amplitude_dps=Fraction(1, 2), frequency_hz=np.float32(0.5), cycles=np.int64(3))
    assert step == Sine(amplitude_dps=0.5, frequency_hz=0.5, cycles=3)
    assert step.label == "sine 0.5 at 0.5 Hz"


def test_a_parameter_without_a_default_is_refused_when_the_procedure_is_made() -> None:
    with pytest.raises(UsageError, match="needs a default"):

        @procedure()
        def wrong(rate_dps: float) -> Iterator[Step]:
            yield Static(duration_s=rate_dps)


def test_every_procedure_of_ours_is_found_by_name_and_plans_steps_without_a_fault() -> None:
    assert {"rate_sweep", "sine_sweep", "static", "temperature_sweep", "two_stage"} <= set(procedure_names())
    for name in procedure_names():
        plan = find_procedure(name).expand()
        assert plan.procedure == name
        assert [fault for step in plan.steps for fault in faults(step)] == []


def test_the_two_stage_procedure_has_the_papers_twenty_set_points_and_keeps_runs_aside() -> None:
    steps = find_procedure("two_stage").expand().steps
    assert sum(step.kind == "soak" for step in steps) == 21
    assert {getattr(step, "role", "none") for step in steps} == {"none", "fit", "verify"}
    assert max(step.peak_rate_dps for step in steps) >= 150.0


def test_a_name_that_is_nearly_right_gets_a_hint() -> None:
    with pytest.raises(UsageError, match="did you mean two_stage"):
        find_procedure("two_stages")


def test_a_file_is_a_procedure_too(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from benchctl.plan import Static, procedure\n\n@procedure()\ndef mine(t_s: float = 3.0):\n"
        "    '''Rest.'''\n    yield Static(duration_s=t_s)\n"
    )
    assert find_procedure(str(path)).expand().steps == (Static(duration_s=3.0),)


PLAN = "from benchctl.plan import Range, Static, procedure"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("import nothing_of_that_name", "cannot be loaded: mine.py, line 1: ModuleNotFoundError"),
        ("x = 1", "expected one function with @procedure, found 0"),
        ("def (", "cannot be loaded: SyntaxError"),
        ("raise SystemExit(0)", "cannot be loaded: mine.py, line 1: SystemExit: 0"),
        (
            f"{PLAN}\n@procedure()\ndef mine(t_s): yield",
            "cannot be loaded: mine.py, line 2: procedure mine: parameter t_s",
        ),
    ],
)
def test_a_file_that_holds_no_procedure_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(text)
    with pytest.raises(UsageError, match=says.replace("(", r"\(")):
        find_procedure("mine.py")
    with pytest.raises(UsageError, match="no such file"):
        find_procedure(str(tmp_path / "absent.py"))


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("raise KeyError('x')\n    yield", "mine.py, line 5: KeyError: 'x'; they are {}"),
        ("return None", "these parameters give no plan: TypeError: "),
        ("yield 'soak'", "step 1 is 'soak', expected a step of benchctl.plan"),
        ("yield Soak(setpoint_c='20', hold_s=1.0)", "Soak: setpoint_c is '20', expected a number"),
        ("yield Static(duration_s=1.0, role='both')", "Static: role is 'both', expected one of"),
        ("yield Static(duration_s=10**400)", "Static: duration_s is 1000"),
        (
            "yield Static(speed=3)",
            "mine.py, line 5: TypeError: Static.__init__() got an unexpected keyword argument 'speed'",
        ),
        ("yield Static()", "missing 1 required keyword-only argument: 'duration_s'"),
    ],
)
def test_whatever_goes_wrong_in_a_procedure_is_one_line(tmp_path: Path, body: str, says: str) -> None:
    path = tmp_path / "mine.py"
    path.write_text(f"from benchctl.plan import Soak, Static, procedure\n\n@procedure()\ndef mine():\n    {body}\n")
    with pytest.raises(UsageError) as caught:
        find_procedure(str(path)).expand()
    assert says in str(caught.value)
    assert str(caught.value).startswith("procedure mine: ")


def test_the_source_of_a_file_is_all_of_it_and_the_file_may_hold_dataclasses(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from __future__ import annotations\n\nfrom dataclasses import dataclass\n\n"
        "from benchctl.plan import Static, procedure\n\n\n@dataclass\nclass Times:\n    rest_s: float = 3.0\n\n\n"
        "@procedure()\ndef mine():\n    yield Static(duration_s=Times().rest_s)\n"
    )
    plan = find_procedure(str(path)).expand()
    assert plan.steps == (Static(duration_s=3.0),)
    assert plan.source == path.read_text()


def test_a_single_set_point_has_nothing_to_ramp_back_from() -> None:
    plan = find_procedure("temperature_sweep").expand({"points": "1", "return_c_per_min": "1"})
    ramp = plan.steps[-1]
    assert isinstance(ramp, ThermalRamp)
    assert ramp.from_c == ramp.to_c == -40.0


def test_steps_name_their_faults() -> None:
    assert list(faults(Sine(amplitude_dps=-5.0, frequency_hz=1.0, cycles=2))) == [
        "amplitude_dps is -5, expected more than 0"
    ]
    assert list(faults(Static(duration_s=np.float32("nan")))) == ["duration_s is nan, expected a finite number"]
    assert list(faults(Static(duration_s=0.0))) == ["duration_s is 0, expected more than 0"]
    assert list(faults(Static(duration_s=1.0, settle_s=-1.0))) == ["settle_s is -1, expected 0 or more"]
    assert list(faults(ConstantRate(rate_dps=float("inf"), duration_s=1.0))) == [
        "rate_dps is inf, expected a finite number"
    ]
