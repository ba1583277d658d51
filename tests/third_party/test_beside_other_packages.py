"""What is installed beside InstrumentKit and PyMeasure: nobody's package is overwritten, and all can be imported."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = {"benchctl", "benchctl_instruments", "benchctl_procedures"}

SIDE_BY_SIDE = """
import importlib.metadata, pathlib
import benchctl, benchctl_instruments, benchctl_procedures, instruments, pymeasure
from instruments.newport import NewportESP301
from pymeasure.instruments.newport import ESP300
theirs = importlib.metadata.distribution("instrumentkit").locate_file("instruments/__init__.py")
assert pathlib.Path(instruments.__file__).samefile(theirs), instruments.__file__
"""


def run(arguments: list[str], folder: Path) -> str:
    """What Python prints, run away from the checkout; it must succeed and warn of nothing."""
    ran = subprocess.run([sys.executable, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    return ran.stdout


def installed_as() -> set[str]:
    """The top-level packages of the wheel, by pyproject.toml."""
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"][
        "wheel"
    ]
    assert wheel.keys() == {"only-include", "sources"}
    return {wheel["sources"].get(folder, folder) for folder in wheel["only-include"]}


def test_instrumentkit_and_pymeasure_are_imported_beside_benchctl(tmp_path: Path) -> None:
    for package in ("instruments.newport", "pymeasure"):
        pytest.importorskip(
            package, reason=f"{package} is not installed: pip install pymeasure 'instrumentkit>=1.0.0b2'"
        )
    run(["-c", SIDE_BY_SIDE], tmp_path)
    assert run(["-m", "benchctl", "--version"], tmp_path).startswith("benchctl ")


def test_no_other_installed_package_has_a_name_of_ours() -> None:
    assert installed_as() == PACKAGES
    providers = importlib.metadata.packages_distributions()
    assert {name: providers[name] for name in PACKAGES & providers.keys() if set(providers[name]) != {"benchctl"}} == {}


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_wheel_holds_three_packages_and_their_metadata(tmp_path: Path) -> None:
    if importlib.util.find_spec("hatchling") is None:
        pytest.skip("hatchling is not installed, and nothing is downloaded: pip install hatchling")
    build = ["-m", "pip", "wheel", "--quiet", "--no-deps", "--no-index", "--no-build-isolation", "-w", str(tmp_path)]
    run([*build, str(ROOT)], tmp_path)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        tops = {name.partition("/")[0] for name in archive.namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == PACKAGES
