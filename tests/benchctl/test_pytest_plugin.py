"""The plugin as a CI engineer meets it: inner runs of pytest, real ones, with the simulated bench."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from xml.etree import ElementTree as ET

import pint
import pytest
import scipy.integrate
import scipy.interpolate
import scipy.ndimage
import scipy.optimize
import scipy.signal
import scipy.special
import scipy.stats
import tomli_w

import benchctl.pytest_plugin.files
import benchctl.pytest_plugin.fixtures
from benchctl.pytest_plugin.files import judged, read_bench_test
from benchctl.recordings.verify import verify

LOADED = (pint, scipy, benchctl)
"""Inner runs in this process forget what they import: extension modules can be imported but once, and what pint loads
where dask is installed (importlib_metadata) puts itself in the place of how packages are found."""

pytest_plugins = ("pytester",)

PLUGIN = ("-p", "benchctl.pytest_plugin")
BENCH = Path(benchctl.__file__).with_name("bench.toml")

QUICK = '''
from benchctl.plan import Soak, procedure, rates_between_zeros


@procedure()
def quick(top_dps: float = 60.0):
    """Three rates."""
    yield Soak(setpoint_c=23.0, hold_s=1.0)
    yield from rates_between_zeros([top_dps / 3, 2 * top_dps / 3, top_dps], at_least_s=6.0, zero_s=6.0)
'''
LIMITS = """
[limits.scale_factor]
low = 40.0
high = 60.0
unit = "mV/(deg/s)"
[limits.bias]
low = 3000.0
high = 4000.0
unit = "deg/h"
[limits.bandwidth]
low = 10.0
unit = "Hz"
"""
TEST = 'procedure = "quick.py"\nlimits = "limits.toml"\nseed = 3\n'


@pytest.fixture(autouse=True)
def _alone(monkeypatch: pytest.MonkeyPatch, pytester: pytest.Pytester) -> None:
    """Other plugins would only cost time; ours is named, so that it is there however this checkout was installed.

    Nor is what somebody left in a folder above, such as /tmp/pyproject.toml, to be taken for the configuration.
    """
    pytester.makeini("[pytest]")
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")


@pytest.fixture
def lab(pytester: pytest.Pytester) -> Path:
    """A folder with a campaign of 14 short steps and limits, of which it keeps one, breaks one and misses one."""
    folder = pytester.mkdir("lab")
    (folder / "quick.py").write_text(QUICK, encoding="utf-8")
    (folder / "limits.toml").write_text(LIMITS, encoding="utf-8")
    (folder / "incoming.bench-test.toml").write_text(TEST, encoding="utf-8")
    return folder


def test_each_limit_is_a_test_with_its_own_verdict_and_junit_has_them_with_their_figures(
    pytester: pytest.Pytester, lab: Path
) -> None:
    result = pytester.runpytest_inprocess(*PLUGIN, "-v", "--junitxml=junit.xml", "--benchctl-out=kept")
    result.stdout.fnmatch_lines(
        [
            "lab/incoming.bench-test.toml::campaign PASSED*",
            "lab/incoming.bench-test.toml::scale_factor PASSED*",
            "lab/incoming.bench-test.toml::bias FAILED*",
            "lab/incoming.bench-test.toml::bandwidth INCONCLUSIVE*",
            "*= INCONCLUSIVE =*",
            "lab/incoming.bench-test.toml::bandwidth: INCONCLUSIVE: *Run the procedure *",
            "benchctl: the campaigns and their reports are in kept",
        ]
    )
    said = result.stdout.str().replace("\u00a0", " ")
    assert re.search(r"^FAIL: \(\d+ ± \d+\) °/h, expected 3000 to 4000 °/h \(report: .*\.html\)$", said, re.M)
    result.assert_outcomes(passed=2, failed=1)
    assert result.parseoutcomes()["inconclusive"] == 1
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    cases = {case.get("name"): case for case in ET.parse(pytester.path / "junit.xml").iter("testcase")}
    failures = {name: case.find("failure") for name, case in cases.items()}
    assert [name for name, failure in failures.items() if failure is not None] == ["bias", "bandwidth"]
    assert failures["bias"].get("message").startswith("FAIL: ")
    assert failures["bandwidth"].get("message").startswith("INCONCLUSIVE: ")
    figures = {one.get("name"): one.get("value") for one in cases["scale_factor"].iter("property")}
    assert figures["verdict"] == "PASS"
    assert 40.0 < float(figures["value"]) < 60.0
    assert float(figures["uncertainty"]) < 1.0
    kept = pytester.path / "kept" / "incoming"
    assert {"acceptance.html", "acceptance.xml", "recording.h5", "manifest.json"} <= {
        one.name for one in kept.iterdir()
    }
    assert verify(kept) == []
    told = {one["name"]: one["verdict"] for one in json.loads((kept / "acceptance.json").read_text())["tests"]}
    assert {name: told[name] for name in ("scale_factor", "bias", "bandwidth")} == {
        "scale_factor": "PASS",
        "bias": "FAIL",
        "bandwidth": "INCONCLUSIVE",
    }


def test_one_limit_alone_runs_the_campaign_and_what_nobody_keeps_is_gone_afterwards(
    pytester: pytest.Pytester, lab: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(pytester.mkdir("temporary")))
    result = pytester.runpytest_inprocess(*PLUGIN, "lab/incoming.bench-test.toml::scale_factor")
    result.assert_outcomes(passed=1)
    assert list((pytester.path / "temporary").iterdir()) == []
    assert {one.name for one in lab.iterdir()} >= {"quick.py", "limits.toml"}
    assert not (lab / "recording.h5").exists()


@pytest.mark.slow
def test_workers_of_xdist_share_one_campaign(pytester: pytest.Pytester, lab: Path) -> None:
    assert lab.exists()
    result = pytester.runpytest_subprocess(*PLUGIN, "-p", "xdist", "-n", "2", "--benchctl-out=kept", timeout=60)
    assert result.parseoutcomes() == {"failed": 1, "inconclusive": 1, "passed": 2}
    assert [one.name for one in (pytester.path / "kept").iterdir()] == ["incoming"]


def test_a_campaign_is_judged_by_the_limits_that_were_collected(lab: Path, tmp_path: Path) -> None:
    path = lab / "incoming.bench-test.toml"
    collected = read_bench_test(path)
    (lab / "limits.toml").write_text(LIMITS.partition("[limits.bias]")[0], encoding="utf-8")
    assert set(judged(collected, path, tmp_path / "shared", None).tests) == {"scale_factor", "bias", "bandwidth"}


def test_a_campaign_that_ends_early_fails_and_none_of_its_limits_passes(pytester: pytest.Pytester, lab: Path) -> None:
    told = BENCH.read_text(encoding="utf-8") + '\n[[interlocks]]\nquantity = "rate_dps"\nabove = 30.0\n'
    (lab / "bench.toml").write_text(told, encoding="utf-8")
    (lab / "incoming.bench-test.toml").write_text(f'bench = "bench.toml"\n{TEST}', encoding="utf-8")
    result = pytester.runpytest_inprocess(*PLUGIN, "-v")
    result.assert_outcomes(failed=4)
    result.stdout.fnmatch_lines(["*aborted: *rate_dps*", "not judged, since the campaign is not complete: aborted: *"])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('procedure = "quicker.py"', "*procedure *quicker.py: there is no such file*"),
        ('procedure = "quick.py"\nlimit = "limits.toml"', "*incoming.bench-test.toml, line 2*limit*"),
        ('procedure = "quick.py"\nlimits = "limit.toml"', "*limit.toml*"),
        ('procedure = "quick.py"\nbench = "nowhere.toml"', "*nowhere.toml*"),
        ('procedure = "quick.py"\n[parameters]\ntop = 3', "*did you mean top_dps*"),
        ('procedure = "quick.py"\n[parameters]\ntop_dps = "fast"', "*incoming.bench-test.toml, line 3*top_dps*'fast'*"),
        ('procedure = "quick.py"\n[parameters]\ntop_dps = nan', "*parameter top_dps: expected a number in *'nan'*"),
        ("procedure = ", "*incoming.bench-test.toml*"),
    ],
)
def test_a_file_that_cannot_be_used_is_told_in_a_line_and_nothing_is_run(
    text: str, says: str, pytester: pytest.Pytester, lab: Path
) -> None:
    (lab / "incoming.bench-test.toml").write_text(text, encoding="utf-8")
    result = pytester.runpytest_inprocess(*PLUGIN)
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines([says])
    result.stdout.no_fnmatch_line("*Traceback*")
    assert result.ret == pytest.ExitCode.INTERRUPTED


def test_a_real_bench_is_moved_by_nobody_who_does_not_say_so(pytester: pytest.Pytester, lab: Path) -> None:
    document = tomllib.loads(BENCH.read_text(encoding="utf-8")) | {"simulated": False}
    for name in ("rate_table", "chamber", "digitizer"):
        document[name]["address"] = "tcp://127.0.0.1:1"
    (lab / "bench.toml").write_text(tomli_w.dumps(document), encoding="utf-8")
    (lab / "incoming.bench-test.toml").write_text('bench = "bench.toml"\nprocedure = "quick.py"\n', encoding="utf-8")
    result = pytester.runpytest_inprocess(*PLUGIN, "-rs")
    result.assert_outcomes(skipped=1)
    result.stdout.fnmatch_lines(["*is not a simulated bench: give --benchctl-hardware to let it move*"])
    result = pytester.runpytest_inprocess(*PLUGIN, "--benchctl-hardware")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*rate_table: *"])  # nobody answers there


FIXTURES = """
import numpy as np
import pytest

from benchctl import api
from benchctl.plan import Soak, Static, procedure


@procedure()
def rest(seconds: float = 2.0):
    yield Soak(setpoint_c=23.0, hold_s=60.0)
    yield Static(duration_s=seconds)


def test_a_bench_is_there_with_its_clock(benchctl_bench, benchctl_clock):
    assert benchctl_bench.clock is benchctl_clock
    benchctl_bench.table.enable()
    benchctl_bench.table.go_to_rate(20.0)
    benchctl_clock.sleep(5.0)
    assert benchctl_bench.table.read().rate_dps == pytest.approx(20.0, abs=0.05)


def test_two_runs_follow_one_another_on_one_bench(benchctl_run, benchctl_bench, benchctl_faults, tmp_path):
    first = benchctl_run(rest, seconds=1)
    second = benchctl_run(api.plan(rest))
    assert (first.status, second.status) == ("complete", "complete")
    assert first.recording.parent == tmp_path / "rest"
    assert second.recording.parent == tmp_path / "rest_2"
    starts = []
    for outcome in (first, second):
        with api.open(outcome.recording) as recording:
            starts.append(recording.step(2)["time_s"][0])
        assert 60.0 < starts[-1] < outcome.bench_time_s
    assert benchctl_bench.table.read().rate_dps == pytest.approx(0.0, abs=0.05)
    assert benchctl_faults.fired == ()


VOLTS = {}


@pytest.mark.parametrize("time", [1, 2])
def test_a_bench_is_fresh_and_drawn_by_its_seed(time, benchctl_run):
    with api.open(benchctl_run(rest).recording) as recording:
        VOLTS[time] = recording.step(2)["gyro_v"]
    if time == 2:
        assert np.array_equal(VOLTS[1], VOLTS[2])


@pytest.mark.benchctl_bench(seed=99)
def test_another_seed_draws_another(benchctl_run):
    with api.open(benchctl_run(rest).recording) as recording:
        assert not np.array_equal(VOLTS[1], recording.step(2)["gyro_v"])


@pytest.mark.benchctl_bench(
    limits={"rate_dps": 50.0}, chamber={"model": "espec_p300"}, unit={"serial": "X-1"}, time_factor=30.0
)
def test_tables_of_bench_toml_can_be_changed(benchctl_bench, benchctl_run):
    assert benchctl_bench.identities["chamber"].manufacturer == "ESPEC"
    assert benchctl_bench.bench.unit.serial == "X-1"
    assert benchctl_bench.bench.unit.range_dps == 175.0
    with pytest.raises(api.UsageError, match="the bench's limit is 50 deg/s"):
        benchctl_run("rate_sweep")


@pytest.mark.benchctl_fault(on="chamber", kind="silence", from_s=60.0, times=2)
@pytest.mark.benchctl_fault(on="rate_table", kind="silence", nth=3)
def test_faults_are_switched_on_at_their_time(benchctl_run, benchctl_faults):
    assert benchctl_run(rest, seconds=100).status == "complete"
    assert sorted(fault.where for fault in benchctl_faults.fired) == ["chamber", "chamber", "rate_table"]
    assert all(fault.bench_s >= 60.0 for fault in benchctl_faults.fired if fault.where == "chamber")


@pytest.mark.benchctl_bench(interlocks=[{"quantity": "rate_dps", "below": 1.0}])
def test_what_ends_a_run_is_raised_or_told(benchctl_run):
    with pytest.raises(api.SafetyError, match="rate_dps"):
        benchctl_run(rest)
    outcome = benchctl_run(rest, check=False)
    assert outcome.status == "aborted"
    assert outcome.safe.confirmed


@pytest.mark.benchctl_bench(time_factor=200.0)
def test_other_programs_reach_the_servers(benchctl_server):
    import socket

    host, port = benchctl_server.addresses["rate_table"].removeprefix("tcp://").split(":")
    with socket.create_connection((host, int(port)), timeout=5.0):
        pass
    bench = api.load_bench(str(benchctl_server.bench_file))
    assert not bench.simulated
    assert bench.chamber.address == benchctl_server.addresses["chamber"]
    from benchctl.campaign.opened import open_bench

    with open_bench(bench) as opened:
        assert opened.identities["chamber"].model
"""


@pytest.mark.slow
def test_the_fixtures_do_what_they_say(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(FIXTURES)
    result = pytester.runpytest_subprocess(*PLUGIN, "--strict-markers", "-W", "error", timeout=60)
    result.assert_outcomes(passed=9)


WRONG = """
import pytest


@pytest.mark.benchctl_fault(on="chamber", kind="silence", evry=3)
def test_fault(benchctl_bench): ...


@pytest.mark.benchctl_fault("chamber")
def test_unnamed(benchctl_bench): ...


@pytest.mark.benchctl_bench(limits={"rate": 50.0})
def test_field(benchctl_run): ...


@pytest.mark.benchctl_bench("nowhere.toml")
def test_file(benchctl_server): ...


@pytest.mark.benchctl_bench(simulated=False, rate_table={"address": "tcp://127.0.0.1:1"},
    chamber={"address": "tcp://127.0.0.1:1"}, digitizer={"address": "tcp://127.0.0.1:1"})
def test_real(benchctl_run): ...


@pytest.mark.benchctl_fault(on="chamber", kind="bad_checksum")
def test_impossible(benchctl_bench): ...
"""


def test_a_bench_that_cannot_be_had_is_told_in_a_line(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(WRONG)
    result = pytester.runpytest_inprocess(*PLUGIN)
    result.assert_outcomes(errors=6)
    result.stdout.fnmatch_lines(
        [
            "benchctl: *faults*evry*",
            "benchctl: benchctl_fault('chamber',): expected its fields by name*",
            "benchctl: *limits*rate*",
            "benchctl: *nowhere.toml*",
            "benchctl: benchctl_bench simulated: expected a bench with simulated = true; *",
            "benchctl: faults: bad_checksum cannot happen to the chamber that was chosen: *",
        ]
    )
    result.stdout.no_fnmatch_line("*Traceback*")


def test_it_loads_nothing_of_benchctl_until_it_is_used() -> None:
    code = "import sys, pytest; had = set(sys.modules); import benchctl.pytest_plugin; print(*set(sys.modules) - had)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    ours = sorted(name for name in ran.stdout.split() if name.startswith(("benchctl", "instruments", "procedures")))
    assert ours == ["benchctl", "benchctl.pytest_plugin", "benchctl.pytest_plugin.fixtures"]
    assert not {"numpy", "h5py", "pydantic", "scipy"} & set(ran.stdout.split())


def test_a_session_that_does_not_use_it_runs_as_it_would_without(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_nothing(): ...")
    pytester.makefile(".toml", test_of_somebody="anything = 1")
    result = pytester.runpytest_subprocess(*PLUGIN, "-W", "error", timeout=60)
    result.assert_outcomes(passed=1)
    result.stdout.no_fnmatch_line("*benchctl*")


def test_its_options_and_fixtures_are_listed(pytester: pytest.Pytester) -> None:
    helped = pytester.runpytest_inprocess(*PLUGIN, "--help")
    helped.stdout.fnmatch_lines(["*--benchctl-out=DIR*", "*--benchctl-hardware*"])
    listed = pytester.runpytest_inprocess(*PLUGIN, "--fixtures")
    for name in ("bench", "clock", "faults", "run", "server"):
        listed.stdout.fnmatch_lines([f"benchctl_{name} *"])
    marked = pytester.runpytest_inprocess(*PLUGIN, "--markers")
    marked.stdout.fnmatch_lines(["@pytest.mark.benchctl_bench(*", "@pytest.mark.benchctl_fault(*"])


def test_it_is_there_wherever_benchctl_is_installed(tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "PYTEST_DISABLE_PLUGIN_AUTOLOAD"}
    command = [sys.executable, "-m", "pytest", "--fixtures", "-p", "no:schemathesis"]
    ran = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert "benchctl_run " in ran.stdout, ran.stderr
