"""`benchctl instrument`: what a device is, in lines for bench.toml; the start of a driver that works at once."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchctl.bench import template
from benchctl.campaign.reserved import lock_files, make_lock_folder
from benchctl.locks import held
from benchctl_instruments.catalog import twin
from benchctl_instruments.simulated.clock import ScaledClock
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World
from tests.benchctl.cli.processes import benchctl, without_a_process
from tests.benchctl.doctor.benches import server
from tests.third_party.environments import fresh_environment
from tests.third_party.packages import forget, site

__all__ = ["site"]

QUICK = ("--timeout", "0.1")


@contextmanager
def chamber(model: str) -> Iterator[str]:
    """A simulated chamber at a TCP port; its address."""
    with twin("chamber", model)(World(ScaledClock(1.0), WorldSettings()).chamber, over_tcp=True) as running:
        yield running.address


def bench_with(lines: str) -> str:
    """The template of a bench whose chamber is described by these lines, the other instruments simulated."""
    return template().replace('[chamber]\nmodel = "watlow_f4t"', lines)


def test_a_device_that_is_recognised_is_told_with_its_lines_for_bench_toml(tmp_path: Path) -> None:
    with chamber("espec_p300") as address:
        ran = benchctl("instrument", "probe", address, *QUICK, "--json", tmp_path / "probe.json")
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.startswith(f"{address}\n  listen for 0.1 s ")
    assert f"  {'TYPE?':<40}  'T,P300,180.0': ESPEC P300\n" in ran.stdout
    assert "> 'TYPE?\\r\\n'\n" in ran.stdout
    lines = f'[chamber]\n  model = "espec_p300"\n  address = "{address}"\n'
    assert ran.stdout.endswith(f"\nespec_p300 (chamber), likely: ESPEC P300\n  {lines}")
    told = json.loads((tmp_path / "probe.json").read_text(encoding="utf-8"))
    (match,) = told["matches"]
    assert tomllib.loads(match["bench_toml"]) == {"chamber": {"model": "espec_p300", "address": address}}
    identity = next(each for each in told["exchanges"] if each["question"] == "*IDN?")
    assert bytes.fromhex(identity["received"]) == b"NA:CMD ERR\r\n"
    assert told["ok"] is True


def test_an_answer_that_no_driver_knows_is_exit_2_and_shown() -> None:
    with server(b"moo\r\n") as address:
        ran = without_a_process("instrument", "probe", address, *QUICK)
    assert ran.returncode == 2
    assert "'moo', not understood" in ran.stdout
    (line,) = ran.stderr.splitlines()
    assert line.startswith(f"benchctl: {address}: a device answers, and no driver recognises it; ")


def test_silence_is_exit_3_with_what_to_check(tmp_path: Path) -> None:
    with server(b"") as address:
        ran = without_a_process("instrument", "probe", address, *QUICK, "--quiet", "--json", tmp_path / "p.json")
    assert (ran.returncode, ran.stdout) == (3, "")
    asked = re.search(rf"{re.escape(address)}: no answer to (\d+) questions; check power, wiring", ran.stderr)
    assert asked
    told = json.loads((tmp_path / "p.json").read_text(encoding="utf-8"))
    assert (told["ok"], told["matches"], len(told["exchanges"])) == (False, [], int(asked[1]))


def test_a_device_that_a_run_has_is_sent_nothing() -> None:
    with chamber("espec_p300") as address:
        make_lock_folder()
        with held(lock_files(address), "the chamber", "benchctl run"):
            ran = without_a_process("instrument", "probe", address, *QUICK)
    assert (ran.returncode, ran.stdout) == (3, "")
    assert "benchctl run" in ran.stderr


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("probe", "/dev/ttyUSB0"), "no scheme; expected tcp://HOST:PORT"),
        (("probe", "tcp://a:1", "tcp://b:1"), "instrument probe: Got unexpected extra argument(s) (tcp://b:1)"),
        (("probe", "tcp://127.0.0.1:4", "-o", "x"), "instrument probe: there is no option -o"),
        (("new", "chamber"), "instrument new: NAME is needed"),
        (("new", "gyro", "acme"), "new gyro: expected chamber, there are no templates of other kinds"),
        (("new", "chamber", "Acme-9"), "expected a name of small letters, digits and _"),
        (("new", "chamber", "lambda"), "expected a name of small letters, digits and _"),
        (("new", "chamber", "watlow_f4"), "a model or package of that name is installed"),
        (("new", "chamber", "pytest"), "a model or package of that name is installed"),
        (("new", "chamber", "acme", "--unit", "3"), "instrument new: there is no option --unit"),
        (("new", "chamber", "acme", "-o", "taken"), "taken: cannot be created, it is there already and not empty"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_writes_nothing(
    arguments: tuple[str, ...], says: str, tmp_path: Path
) -> None:
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "notes.txt").write_text("mine", encoding="utf-8")
    ran = without_a_process("instrument", *arguments, folder=tmp_path)
    assert (ran.returncode, ran.stdout) == (2, "")
    (line,) = ran.stderr.splitlines()
    assert says in line
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["notes.txt", "taken"]


def passes(package: Path, *command: str) -> str:
    """Run pytest in a package, with its warnings as errors; return what it says."""
    environment = os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    arguments = [*(command or (sys.executable,)), "-m", "pytest", "-q", "-W", "error", "-p", "no:cacheprovider"]
    ran = subprocess.run(arguments, cwd=package, env=environment, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return ran.stdout


@pytest.mark.parametrize(("protocol", "tests"), [("modbus", 3), ("lines", 4)])
def test_the_package_that_is_written_passes_its_own_tests_as_it_stands(
    protocol: str, tests: int, tmp_path: Path
) -> None:
    ran = without_a_process("instrument", "new", "chamber", "acme_9000", "--protocol", protocol, folder=tmp_path)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert "wrote acme_9000: fill in acme_9000/acme_9000/" in ran.stdout
    assert f"{tests} passed" in passes(tmp_path / "acme_9000")


@pytest.mark.parametrize("protocol", ["modbus", "lines"])
def test_its_chamber_is_found_by_its_name_checked_in_a_bench_and_recognised(
    protocol: str, site: Path, tmp_path: Path
) -> None:
    name = f"frost_{protocol}"
    without_a_process("instrument", "new", "chamber", name, "--protocol", protocol, "-o", tmp_path / "written")
    put_on_the_path(tmp_path / "written", site)
    forget()
    (tmp_path / "bench.toml").write_text(bench_with(f'[chamber]\nmodel = "{name}"'), encoding="utf-8")
    checked = without_a_process("check", "static", "--bench", tmp_path / "bench.toml", "-p", "duration_s=5")
    assert checked.returncode == 0, checked.stderr
    with chamber(name) as address:
        probed = without_a_process("instrument", "probe", address, *QUICK)
    assert probed.returncode == 0, probed.stderr
    assert f"{name} (chamber), {'possible' if protocol == 'modbus' else 'likely'}: Frost" in probed.stdout


def put_on_the_path(package: Path, site: Path) -> None:
    """What pip leaves of a package: its modules, and its entry points in its metadata."""
    project = tomllib.loads((package / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    shutil.copytree(package / project["name"], site / project["name"])
    info = site / f"{project['name']}-0.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: 0.1.0\n")
    with (info / "entry_points.txt").open("w", encoding="utf-8") as file:
        for group, points in project["entry-points"].items():
            file.write("\n".join([f"[{group}]", *(f"{key} = {value}" for key, value in points.items()), ""]))


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_it_installs_editable_and_a_campaign_runs_on_it(tmp_path: Path) -> None:
    package = tmp_path / "acme_9000"  # as by default, where Python also sees it as a package without a file
    assert benchctl("instrument", "new", "chamber", "acme_9000", "-o", package).returncode == 0
    python = str(fresh_environment(tmp_path / "venv") / f"python{sysconfig.get_config_var('EXE') or ''}")
    install = [sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-index", "--no-deps"]
    ran = subprocess.run([*install, "--no-build-isolation", "-e", str(package)], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    passes(package, python)
    (tmp_path / "bench.toml").write_text(bench_with('[chamber]\nmodel = "acme_9000"'), encoding="utf-8")
    command = [python, "-m", "benchctl", "run", "static", "--bench", "bench.toml", "-p", "duration_s=5", "--out", "run"]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert "complete: " in ran.stdout
