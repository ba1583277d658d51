"""The pipelines of the handbook page on CI, taken out of it and run: what a CI engineer pastes works as it stands."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import yaml

from tests.third_party.environments import fresh_environment

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1200),
    pytest.mark.skipif(os.name == "nt", reason="the pipelines run on Linux"),
]

CHECKOUT = Path(__file__).parents[1]
FENCES = re.findall(
    r"^```yaml\n(.*?)^```", (CHECKOUT / "benchctl/handbook/ci.md").read_text(encoding="utf-8"), re.M | re.S
)

QUICK = '''
from benchctl.plan import Soak, procedure, rates_between_zeros


@procedure()
def quick():
    """Two rates."""
    yield Soak(setpoint_c=23.0, hold_s=1.0)
    yield from rates_between_zeros([20.0, 40.0, 60.0], at_least_s=6.0, zero_s=6.0)
'''
PYTEST = "#!{python}\nimport sys\n\nimport pytest\n\nsys.exit(pytest.console_main())\n"
LIMIT = '[limits.scale_factor]\nlow = {low}\nhigh = 60.0\nunit = "mV/(deg/s)"\n'


def documents() -> list[dict[str, Any]]:
    """Every YAML of the handbook page; one that does not parse fails here."""
    return [yaml.safe_load(text) for text in FENCES]


def github() -> dict[str, Any]:
    """The job of the one that is for GitHub."""
    (found,) = [one for one in documents() if "jobs" in one]
    (job,) = found["jobs"].values()
    assert isinstance(job, dict)
    return job


def gitlab() -> dict[str, Any]:
    """The job of the one that is for GitLab."""
    (found,) = [job for one in documents() for job in one.values() if isinstance(job, dict) and "script" in job]
    return found


def commands(platform: str) -> list[str]:
    """What a pipeline runs; where GitHub takes steps of others, nothing."""
    steps = [step.get("run") for step in github()["steps"]] if platform == "github" else gitlab()["script"]
    return [step for step in steps if step]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """What a clone of this checkout would hold."""
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=CHECKOUT, capture_output=True, text=True, check=True).stdout.splitlines()
    for name in names:
        if (CHECKOUT / name).is_file():
            (tmp_path / "source" / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(CHECKOUT / name, tmp_path / "source" / name)
    return tmp_path / "source"


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A fresh folder, as a laboratory's repository is checked out into."""
    folder = tmp_path / "repository"
    folder.mkdir()
    return folder


def run(platform: str, repository: Path, source: Path) -> list[int]:
    """The exit statuses of a pipeline's commands, up to the first that is not 0, as CI systems do.

    All that is put in its place is where benchctl comes from; what it needs is taken from this environment.
    """
    programs = fresh_environment(repository.parent / "venv", with_pip=True)
    # pip finds pytest installed and leaves no program of it; without one, that of another Python on the PATH would run.
    (programs / "pytest").write_text(PYTEST.format(python=programs / "python"), encoding="utf-8")
    (programs / "pytest").chmod(0o755)
    environment = os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "BENCHCTL": str(source)}
    statuses: list[int] = []
    for command in commands(platform):
        ran = subprocess.run(["bash", "-e", "-c", command], cwd=repository, env=environment, check=False)
        statuses.append(ran.returncode)
        if ran.returncode:
            break
    return statuses


def kept(platform: str) -> list[str]:
    """The files and folders that a pipeline publishes whatever happened."""
    if platform == "gitlab":
        artifacts = gitlab()["artifacts"]
        assert artifacts["when"] == "always"
        return [*artifacts["paths"], artifacts["reports"]["junit"]]
    (upload,) = [step for step in github()["steps"] if "upload-artifact" in step.get("uses", "")]
    assert upload["if"] == "always()"
    return str(upload["with"]["path"]).split()


def test_both_pipelines_are_in_the_readme_and_short() -> None:
    assert github()["runs-on"].startswith("ubuntu")
    assert gitlab()["image"].startswith("python:3")
    assert all("BENCHCTL" in (one.get("env") or one["variables"]) for one in documents())
    assert all(len(text.splitlines()) <= 25 for text in FENCES)


def test_the_acceptance_of_a_fresh_folder_passes_and_is_published(repository: Path, source: Path) -> None:
    assert set(run("github", repository, source)) == {0}
    for name in kept("github"):
        assert (repository / name).exists()
    cases = list(ET.parse(repository / "junit.xml").iter("testcase"))
    assert len(cases) > 20
    assert not [case.get("name") for case in cases if case.find("failure") is not None]
    assert list(repository.glob("*/acceptance/acceptance.html"))


@pytest.mark.parametrize(("low", "status"), [(40.0, 0), (55.0, 1)], ids=["kept", "broken"])
def test_a_limit_that_is_broken_fails_the_pipeline_which_publishes_all_the_same(
    low: float, status: int, repository: Path, source: Path
) -> None:
    (repository / "lab").mkdir()
    (repository / "lab" / "quick.py").write_text(QUICK, encoding="utf-8")
    (repository / "lab" / "limits.toml").write_text(LIMIT.format(low=low), encoding="utf-8")
    (repository / "lab" / "incoming.bench-test.toml").write_text(
        'procedure = "quick.py"\nlimits = "limits.toml"\n', "utf-8"
    )
    assert run("gitlab", repository, source)[-1] == status
    for name in kept("gitlab"):
        assert (repository / name).exists()
    failures = [case.find("failure") for case in ET.parse(repository / "junit.xml").iter("testcase")]
    assert sum(failure is not None for failure in failures) == status
