"""The code blocks of the README and of the handbook, run page by page: what a reader pastes works as it stands.

Blocks in YAML are run by `test_pipelines.py`, the README's first two by `test_main_job.py` and `.ci/run`, the dialogue
at a terminal by `test_sim.py`. `test_handbook.py` holds every command against the command line, run or not.
"""

from __future__ import annotations

import ast
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from benchctl.model_file import Model, write_model
from tests.benchctl.receiver import receiving
from tests.documented import ROOT, blocks, handbook, run_block
from tests.third_party.environments import fresh_environment

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(os.name == "nt", reason="the blocks are written for a POSIX shell"),
]

MAP = """
[unit]
serial = "SN-17"
range_dps = 200
[time]
column = "t"
[channels.encoder_deg]
column = "angle"
unit = "deg"
[channels.gyro_v]
column = "volts"
unit = "V"
"""

BELIEVED = {
    "K0_v_per_dps": 0.05,
    "U0_v": 0.012,
    "T0_c": 20.0,
    "k_T": [],
    "k_omega": [],
    "noise_v_rms": 6e-4,
    "output_limit_v": 11.0,
}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short calibration of the unit SN-17, on the bench that `init` writes."""
    folder = tmp_path_factory.mktemp("calibrated")
    benchctl(folder, "init", "lab")
    bench = folder / "lab" / "bench.toml"
    bench.write_text(bench.read_text(encoding="utf-8").replace("SIM-0001", "SN-17"), encoding="utf-8")
    benchctl(folder, "run", "two_stage", "--bench", "lab/bench.toml", "-p", "points=4", "--out", "campaign")
    return folder / "campaign"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The folder in which a reader works, with an environment as the README makes it."""
    fresh_environment(tmp_path / ".venv")
    return tmp_path


def benchctl(folder: Path, *arguments: str) -> None:
    """What a reader did before."""
    subprocess.run([sys.executable, "-m", "benchctl", *arguments, "--quiet"], cwd=folder, check=True)


def run(folder: Path, page: str, *numbers: int) -> list[str]:
    """Run blocks of a page, all that are in shell or those of these numbers among them; what each said."""
    found = blocks(ROOT / "README.md") if page == "README" else handbook(page)
    shell = [one for one in found if one.language == "sh"]
    return [run_block(shell[number], folder, folder / ".venv" / "bin") for number in numbers or range(len(shell))]


def test_the_readme_and_acceptance_history_and_fleets(folder: Path, campaign: Path) -> None:
    _, _, quality, programs = run(folder, "README")
    assert "changed" in quality
    assert 0.0 < ast.literal_eval(programs.splitlines()[-1])["joint"] < 0.1
    for name in (
        "lab/bench.toml",
        "first/coefficients.json",
        "unit17/acceptance.pdf",
        "junit.xml",
    ):
        assert (folder / name).is_file(), name
    assert list(folder.glob("results/*/rerun.json"))

    for name in ("lab", "first", "results"):  # the page of the handbook begins in a fresh folder
        shutil.rmtree(folder / name)
    shutil.copytree(campaign, folder / "results" / "one")
    with zipfile.ZipFile(folder / "campaigns.zip", "w") as archive:
        for path in campaign.iterdir():
            archive.write(path, f"campaign/{path.name}")
    write_samples(folder, per_rate=300)
    for unit in ("SN-100", "SN-101"):  # short ones, since the fleet diagnoses them too
        benchctl(folder, "import", "log.csv", "--map", "map.toml", "-o", f"{unit}.h5")
    with zipfile.ZipFile(folder / "u.zip", "w") as archive:
        archive.write(folder / "SN-100.h5", "units/u1.h5")
    _, signed, by_ssh, _, _ = run(folder, "acceptance")
    assert "Anna Petrova (QA)" in signed
    assert 'Good "benchctl-acceptance" signature for anna@lab.example' in by_ssh
    for name in ("passport/acceptance.html", "results/history.html", "page/history.html", "fleet.html"):
        assert (folder / name).is_file(), name


def test_calibration(folder: Path, campaign: Path) -> None:
    shutil.copytree(campaign, folder / "campaign")
    for name in ("recording.h5", "coefficients.json"):
        shutil.copy(campaign / name, folder)
    shutil.copy(campaign / "recording.h5", folder / "hidden.h5")
    structure = {"kink_of_scale_over_gyro_temp": {"at": 27.7, "above": -1e-6}}
    (folder / "hidden.diagnosis").mkdir()  # as a diagnosis, which takes minutes, would leave it
    write_model(folder / "hidden.diagnosis" / "model.toml", Model(simulation=BELIEVED, effects=structure))
    noise = np.random.default_rng(7).normal(size=20_000)
    np.savetxt(folder / "rates.csv", noise, header="rate_dps", comments="")
    run(folder, "calibration")
    assert "gyro_rate_dps" in (folder / "gyro_compensation.h5").with_suffix(".h").read_text(encoding="utf-8")
    for name in ("campaign/allan.html", "allan.json", "recording_compensated.h5"):
        assert (folder / name).is_file(), name


def test_tests_of_ones_own_for_ci(folder: Path) -> None:
    (block,) = handbook("ci", "python")
    (folder / "test_own.py").write_text(f"import pytest\n\n{block.text}", encoding="utf-8")
    ran = subprocess.run([sys.executable, "-m", "pytest", "-q", "test_own.py"], cwd=folder, check=False)
    assert ran.returncode == 0


def test_diagnosis(folder: Path) -> None:
    run(folder, "diagnosis", 0)  # the commands of the other block take hours together
    found = json.loads((folder / "hidden.diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
    assert "thermal_lag" in [one["effect"] for one in found["findings"]]
    assert (folder / "corrected.h5").is_file()


def test_simulated_instruments_for_other_programs(folder: Path) -> None:
    run(folder, "first_campaign", 1)  # the first one is the main job


def test_the_live_page(folder: Path) -> None:
    (folder / "results").mkdir()
    told = run(folder, "live_page")
    assert [set(json.loads(said.splitlines()[-1])) for said in told] == [
        {"url", "token", "view_token", "release_token"}
    ] * 2


def test_python(folder: Path) -> None:
    api, procedure = handbook("python", "python")
    write_samples(folder, per_rate=600)
    benchctl(folder, "import", "log.csv", "--map", "map.toml", "-o", "short.h5")
    whole, short = "api.diagnose(outcome)", 'api.diagnose("short.h5")'  # of the whole campaign it takes many minutes
    assert whole in api.text
    shows = "\nprint(fitted.error_percent, found.verdict, volts.size)"
    ran = subprocess.run(
        [sys.executable, "-c", api.text.replace(whole, short) + shows],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    (folder / "my_sweep.py").write_text(procedure.text, encoding="utf-8")
    benchctl(folder, "run", "my_sweep.py", "--bench", "simulated", "-p", "top_dps=150")


def test_recordings(folder: Path, campaign: Path) -> None:
    shutil.copy(campaign / "recording.h5", folder)
    benchctl(folder, "export", "recording.h5", "--to", "open", "-o", "from_the_other_lab")
    write_samples(folder)
    (opened,) = handbook("recordings", "python")
    shows = "\nprint(sorted(step.variables))"
    told = subprocess.run(
        [sys.executable, "-c", opened.text + shows], cwd=folder, capture_output=True, text=True, check=True
    ).stdout
    for name in ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c"):
        assert name in told
    run(folder, "recordings")
    fitted = json.loads((folder / "coefficients.json").read_text(encoding="utf-8"))  # of the last one, the table
    assert fitted["K0_v_per_dps"] == pytest.approx(0.05, rel=1e-3)
    for name in ("bench.h5", "points.h5", "their_log.diagnosis/diagnosis.html"):
        assert (folder / name).is_file(), name


def write_samples(folder: Path, per_rate: int = 6000) -> None:
    """What another lab measured at nine constant rates, as text and in SQLite, and the means of it."""
    rates_dps = np.linspace(-160.0, 160.0, 9)
    rate_dps = np.repeat(rates_dps, per_rate)
    times_s = np.arange(rate_dps.size) / 100.0
    angles_deg = np.cumsum(rate_dps) / 100.0
    volts = 0.012 + 0.05 * rate_dps + np.random.default_rng(7).normal(0.0, 0.0006, rate_dps.size)
    rows = np.column_stack([times_s, angles_deg, volts])
    for name in ("log.csv", "their_log.csv"):
        np.savetxt(folder / name, rows, delimiter=",", header="t,angle,volts", comments="", fmt="%.9g")
    with sqlite3.connect(folder / "bench.db") as database:
        database.execute("CREATE TABLE samples (t REAL, angle REAL, volts REAL)")
        database.executemany("INSERT INTO samples VALUES (?, ?, ?)", rows.tolist())
    database.close()
    means = np.column_stack([rates_dps, 0.012 + 0.05 * rates_dps])
    np.savetxt(folder / "points.csv", means, delimiter=",", header="rate_dps,gyro_v_mean", comments="")
    (folder / "map.toml").write_text(MAP, encoding="utf-8")


def test_a_bench_of_ones_own(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(folder, "your_bench", 0)
    assert (folder / "plan.svg").is_file()
    crashed = folder / "results" / "20261120-180000_two_stage_SN-17"
    crash(folder, crashed)
    run(folder, "your_bench", 2)
    assert (crashed / "coefficients.json").is_file()
    (notify,) = (block for block in handbook("your_bench", "toml") if block.text.startswith("[notify]"))
    bench = folder / "lab" / "bench.toml"
    with receiving() as (port, received):
        monkeypatch.setenv("BENCH_CHAT", f"json://127.0.0.1:{port}")
        text = notify.text.replace("mailto://user:password@example.org", f"json://127.0.0.1:{port}")
        bench.write_text(f"{bench.read_text(encoding='utf-8')}\n{text}", encoding="utf-8")
        run(folder, "your_bench", 1)
    assert len(received) == 2


def crash(folder: Path, campaign: Path) -> None:
    """Kill a run in its third step."""
    command = [
        sys.executable,
        "-m",
        "benchctl",
        "run",
        "two_stage",
        "--bench",
        "lab/bench.toml",
        "--out",
        str(campaign),
    ]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        ends_s = time.monotonic() + 120
        while not list(campaign.glob("steps/0003*")) and time.monotonic() < ends_s:
            assert process.poll() is None
            time.sleep(0.02)
        process.kill()
