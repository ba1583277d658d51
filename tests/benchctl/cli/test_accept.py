"""`benchctl accept`, as QA runs it: verdicts, files, languages, and what cannot be judged."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import h5py
import pypdfium2
import pytest

from benchctl.bench import template
from benchctl.cli.app import run_verb
from benchctl.metrology.names import UNITS
from tests.benchctl.cli.processes import benchctl

Verb = Callable[..., tuple[int, str, str]]
FILES = {"report": "acceptance.html", "pdf": "acceptance.pdf", "junit": "acceptance.xml", "json": "acceptance.json"}

SHORT = """
from benchctl.plan import Sine, levels, procedure, rate_cycle

@procedure()
def short(top_dps: float = 100.0):
    '''Rates up and down.'''
    yield from rate_cycle(levels(top_dps, 3), at_least_s=5.0, zero_s=10.0)

"""
SWING = """
from benchctl.plan import Sine, procedure

@procedure()
def swing(hz: float = 1.0):
    '''No reading at all.'''
    yield Sine(amplitude_dps=50.0, frequency_hz=hz, cycles=5)
"""
SMALL = {
    "points": 3,
    "coldest_c": 0,
    "hottest_c": 40,
    "cycles": 3,
    "top_rate_dps": 170,
    "sweep_rates": 5,
    "rates": 2,
    "rate_dps": 68,
    "rest_s": 600,
    "warm_s": 600,
    "soak_s": 60,
    "off_s": 60,
    "run_s": 10,
    "zero_s": 20,
    "small_run_s": 20,
    "frequencies_hz": "0.5,1,2",
    "ramp_c_per_min": 1,
}
"""An acceptance of all tests that is recorded in seconds."""


def scale_factor(low: float, high: float) -> str:
    return f'[limits.scale_factor]\nlow = {low}\nhigh = {high}\nunit = "mV/(deg/s)"\n'


PASSES, FAILS = scale_factor(40, 60), scale_factor(60, 70)
OPEN = '[limits.bias_stability]\nhigh = 3\nunit = "deg/h"\n'


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording, a campaign, a bench that samples slowly, and procedures."""
    folder = tmp_path_factory.mktemp("made")
    bench = template().replace("sample_rate_hz = 500.0", "sample_rate_hz = 50.0")
    assert "sample_rate_hz = 50.0" in bench
    (folder / "bench.toml").write_text(bench, encoding="utf-8")
    (folder / "short.py").write_text(SHORT)
    (folder / "swing.py").write_text(SWING)
    common = ["--bench", str(folder / "bench.toml"), "--seed", "1", "--quiet"]
    assert run_verb(["simulate", str(folder / "short.py"), "-o", str(folder / "short.h5"), *common]) == 0
    assert run_verb(["simulate", str(folder / "swing.py"), "-o", str(folder / "swing.h5"), *common]) == 0
    assert run_verb(["run", str(folder / "short.py"), "--out", str(folder / "campaign"), *common]) == 0
    return folder


@pytest.fixture
def here(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it to work in."""
    shutil.copytree(made, tmp_path / "lab")
    monkeypatch.chdir(tmp_path / "lab")
    (tmp_path / "lab" / "limits.toml").write_text(PASSES)
    return tmp_path / "lab"


@pytest.fixture
def verb(capsys: pytest.CaptureFixture[str]) -> Verb:
    """Run a verb; returns its status, what it says, and its complaints."""

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        status = run_verb([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


def told(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text(encoding="utf-8")))


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_what_passes_ends_with_0_and_has_all_files(here: Path) -> None:
    ran = benchctl("accept", here / "short.h5", "--limits", here / "limits.toml", "--json", here / "a.json")
    assert (ran.returncode, ran.stderr) == (0, "")
    found = told(here / "a.json")
    assert (found["schema"], found["ok"], found["verdict"]) == ("benchctl-accept/1", True, "PASS")
    assert "error" not in found
    assert [test["name"] for test in found["tests"]] == list(UNITS)
    for test in found["tests"]:
        assert test.keys() >= {"name", "value", "unit", "uncertainty", "limit", "verdict"}
        assert (test["value"] is None) == bool(test["refused"])
    scale = found["tests"][0]
    assert (scale["unit"], scale["verdict"]) == ("mV/(deg/s)", "PASS")
    assert scale["limit"] == {"low": 40.0, "high": 60.0, "unit": "mV/(deg/s)"}
    assert 0.0 < scale["uncertainty"] < 0.1
    assert 48.0 < scale["value"] < 50.0
    assert all(step["digest"] for step in scale["steps"])
    folder = here / "short.acceptance"
    assert names(folder) == set(FILES.values())
    assert {kind: Path(found[kind]) for kind in FILES} == {kind: folder / name for kind, name in FILES.items()}
    assert "<html" in (folder / "acceptance.html").read_text(encoding="utf-8")
    assert (folder / "acceptance.pdf").read_bytes().startswith(b"%PDF-")
    assert told(folder / "acceptance.json")["tests"] == found["tests"]
    assert ran.stdout.splitlines()[0].startswith("Scale factor")
    assert f"report: {folder / 'acceptance.html'}" in ran.stdout


def test_what_fails_ends_with_1_and_says_which(here: Path, verb: Verb) -> None:
    (here / "limits.toml").write_text(FAILS + OPEN)
    status, out, err = verb("accept", "short.h5", "--limits", "limits.toml", "--json", "a.json")
    assert (status, err) == (1, "")
    found = told(here / "a.json")
    assert (found["ok"], found["verdict"], found["error"]) == (False, "FAIL", "fails scale_factor")
    assert "FAIL" in out
    assert names(here / "short.acceptance") == set(FILES.values())  # the report of a failure is wanted most
    suite = ElementTree.parse(here / "short.acceptance" / "acceptance.xml").getroot()
    failures = [case.get("name") for case in suite.iter("testcase") if case.find("failure") is not None]
    assert any("scale_factor" in str(name) for name in failures)


@pytest.mark.slow
def test_what_is_open_ends_with_1_and_says_what_would_close_it(here: Path, verb: Verb) -> None:
    (here / "limits.toml").write_text(PASSES + OPEN)
    status, out, _ = verb("accept", "short.h5", "--limits", "limits.toml", "--json", "a.json")
    assert status == 1
    found = told(here / "a.json")
    assert (found["ok"], found["verdict"], found["error"]) == (False, "INCONCLUSIVE", "inconclusive: bias_stability")
    (stability,) = (test for test in found["tests"] if test["name"] == "bias_stability")
    assert (stability["value"], stability["uncertainty"], stability["verdict"]) == (None, None, "INCONCLUSIVE")
    assert "stability" in stability["remedy"]
    assert "INCONCLUSIVE" in out


@pytest.mark.slow
def test_a_limit_inside_the_uncertainty_is_open(here: Path, verb: Verb) -> None:
    verb("accept", "short.h5", "--limits", "limits.toml", "--json", "a.json", "--quiet")
    value, uncertainty = (told(here / "a.json")["tests"][0][key] for key in ("value", "uncertainty"))
    (here / "limits.toml").write_text(scale_factor(value - 0.5 * uncertainty, 60))
    assert verb("accept", "short.h5", "--limits", "limits.toml", "--json", "b.json")[0] == 1
    scale = told(here / "b.json")["tests"][0]
    assert scale["verdict"] == "INCONCLUSIVE"
    assert scale["remedy"]
    (here / "limits.toml").write_text("guard = 0\n" + scale_factor(value - 0.5 * uncertainty, 60))
    assert verb("accept", "short.h5", "--limits", "limits.toml")[0] == 0  # without a guard band the value counts


@pytest.mark.slow
def test_the_limit_may_be_in_another_unit_and_the_result_then_is_too(here: Path, verb: Verb) -> None:
    (here / "limits.toml").write_text('[limits.scale_factor]\nlow = 0.04\nhigh = 0.06\nunit = "V/(deg/s)"\n')
    assert verb("accept", "short.h5", "--limits", "limits.toml", "--json", "a.json")[0] == 0
    scale = told(here / "a.json")["tests"][0]
    assert (scale["unit"], round(scale["value"], 3)) == ("V/(deg/s)", 0.049)


@pytest.mark.slow
def test_in_russian_the_words_are_and_the_json_is_as_ever(here: Path, verb: Verb) -> None:
    assert verb("accept", "short.h5", "--limits", "limits.toml", "--out", "en", "--quiet")[0] == 0
    status, out, _ = verb("accept", "short.h5", "--limits", "limits.toml", "--lang", "ru", "--out", "ru")
    assert status == 0
    assert out.startswith("Масштабный коэффициент")
    assert "Масштабный коэффициент" in (here / "ru" / "acceptance.html").read_text(encoding="utf-8")
    assert told(here / "ru" / "acceptance.json") == told(here / "en" / "acceptance.json")
    status, _, err = verb("accept", "short.h5", "--limits", "limits.toml", "--lang", "de")
    assert status == 2
    assert "de" in err


@pytest.mark.slow
def test_with_quiet_there_is_a_report_and_no_word(here: Path, verb: Verb) -> None:
    assert verb("accept", "short.h5", "--limits", "limits.toml", "--quiet") == (0, "", "")
    assert names(here / "short.acceptance") == set(FILES.values())


@pytest.mark.slow
def test_a_campaign_gets_its_files_and_stays_whole(here: Path, verb: Verb) -> None:
    before = names(here / "campaign")
    assert verb("accept", "campaign", "--limits", "limits.toml", "--json", "a.json")[0] == 0
    assert names(here / "campaign") == before | set(FILES.values())
    assert {Path(told(here / "a.json")[kind]) for kind in FILES} == {Path("campaign") / name for name in FILES.values()}
    assert verb("verify", "campaign")[0] == 0
    assert verb("accept", "campaign", "--limits", "limits.toml", "--lang", "ru")[0] == 0  # and again over its own files
    assert verb("verify", "campaign")[0] == 0
    (here / "campaign" / "acceptance.html").write_text("better so")
    status, out, err = verb("verify", "campaign")
    assert status != 0
    assert "acceptance.html" in out + err


@pytest.mark.slow
def test_history_sees_the_acceptance(here: Path, verb: Verb) -> None:
    (here / "limits.toml").write_text(FAILS)
    assert verb("accept", "campaign", "--limits", "limits.toml", "--quiet")[0] == 1
    status, out, _ = verb("history", "campaign", "--json", "h.json")
    assert status == 0
    assert "FAIL" in out
    (unit,) = told(here / "h.json")["units"]
    figures = {figure["name"]: figure for figure in unit["figures"]}
    assert figures["scale_factor"]["points"][0]["verdict"] == "FAIL"


@pytest.mark.slow
def test_an_open_recording_is_somebody_elses_and_is_left_as_it_is(here: Path, verb: Verb) -> None:
    assert verb("export", "short.h5", "--to", "open", "-o", "theirs", "--quiet")[0] == 0
    before = names(here / "theirs")
    status, _, err = verb("accept", "theirs", "--limits", "limits.toml", "--json", "a.json")
    assert (status, err) == (0, "")
    assert names(here / "theirs") == before
    found = told(here / "a.json")
    assert Path(found["report"]) == Path("theirs.acceptance/acceptance.html")
    assert len(found["anomalies"]) >= 1  # no digest of ours
    assert found["tests"][0]["verdict"] == "PASS"


@pytest.mark.slow
def test_out_names_another_place(here: Path, verb: Verb) -> None:
    assert verb("accept", "campaign", "--limits", "limits.toml", "--out", "filed/2026")[0] == 0
    assert names(here / "filed" / "2026") == set(FILES.values())
    assert not names(here / "campaign") & set(FILES.values())


def test_a_changed_recording_is_not_judged(here: Path, verb: Verb) -> None:
    with h5py.File(here / "short.h5", "r+") as file:
        step = next(iter(file["steps"].values()))
        step["gyro_v"][5] += 1e-6
    status, out, err = verb("accept", "short.h5", "--limits", "limits.toml")
    assert (status, out) == (2, "")
    assert "changed since it was written, and so not accepted" in err
    assert not (here / "short.acceptance").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["short.h5"], "--limits"),
        (["short.h5", "--limits", "none.toml"], "none.toml"),
        (["none.h5", "--limits", "limits.toml"], "none.h5"),
        (["short.h5", "--limits", "short.h5"], "limits short.h5"),
        (["swing.h5", "--limits", "limits.toml"], "swing.h5: has no complete step at rest or at a constant rate"),
        (["short.h5", "--limits", "limits.toml", "--out", "short.py"], "short.py"),
    ],
    ids=["unsaid", "no-limits", "no-recording", "no-text", "no-reading", "no-folder"],
)
def test_what_cannot_be_used_is_one_clear_line(arguments: list[str], says: str, here: Path, verb: Verb) -> None:
    before = names(here)
    status, out, err = verb("accept", *arguments)
    assert (status, out) == (2, "")
    assert says in err
    assert len(err.strip().splitlines()) == 1
    assert names(here) == before


def test_a_mistake_in_the_limits_is_found_before_any_work(here: Path, verb: Verb) -> None:
    (here / "limits.toml").write_text(PASSES + '[limits.bandwith]\nlow = 2\nunit = "Hz"\n')
    status, _, err = verb("accept", "none.h5", "--limits", "limits.toml", "--json", "a.json")
    assert status == 2
    assert "limits.toml, line 5: there is no test 'bandwith': did you mean bandwidth?" in err
    assert "bandwidth" in told(here / "a.json")["error"]


@pytest.mark.slow
def test_a_small_acceptance_holds_all_tests_and_is_judged_by_what_init_wrote(here: Path, verb: Verb) -> None:
    asked = [part for name, value in SMALL.items() for part in ("-p", f"{name}={value}")]
    simulated = ["simulate", "acceptance", "--bench", "bench.toml", *asked, "-o", "all.h5", "--seed", "2", "--quiet"]
    assert verb(*simulated)[0] == 0
    assert verb("init", "new")[0] == 0
    verb("accept", "all.h5", "--limits", "new/limits.toml", "--json", "a.json")
    tests = {test["name"]: test for test in told(here / "a.json")["tests"]}
    noises = {"quantisation", "bias_instability", "rate_random_walk", "rate_ramp"}
    lacking = {name for name, test in tests.items() if test["value"] is None}
    assert lacking <= noises | {"warm_up_time"}  # its gyro does not warm up, and ten minutes are short
    verdicts = {name: test["verdict"] for name, test in tests.items()}
    # only 2 Hz were tried, and 10 are asked for; and the rests are a sixtieth of what the limits expect
    assert (tests["bandwidth"]["bound"], verdicts["bandwidth"]) == ("at least", "INCONCLUSIVE")
    assert {name for name, verdict in verdicts.items() if verdict == "INCONCLUSIVE"} <= {"bandwidth", "warm_up_time"}
    assert "FAIL" not in verdicts.values()
    for language in ("en", "ru"):
        verb("accept", "all.h5", "--limits", "new/limits.toml", "--lang", language, "--out", language)
        with pypdfium2.PdfDocument(here / language / "acceptance.pdf") as pages:
            assert len(pages) <= 13
