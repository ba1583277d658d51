"""Each verb on fixed seeds gives the results that are stored here: numbers within a tolerance, everything else exactly.

A change of the code that is meant to change no result must pass this test as it is. Where results are meant to change,
`BENCHCTL_WRITE_GOLDEN=1 pytest tests/golden -m slow` writes them again, and the difference is reviewed.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from benchctl.bench import template
from benchctl.cli.app import run_verb
from tests.benchctl.cli.test_accept import SMALL
from tests.shared import SHARED, needs_shared

STORED = Path(__file__).parent / "results"
RELATIVE, ABSOLUTE = 1e-5, 1e-9
"""Other processors and libraries add in another order; a fit then ends elsewhere within its convergence criterion."""
LONGEST = 12
"""Longer lists of numbers are stored by their count, mean and root mean square."""
VOLATILE = re.compile(r"digest|sha256|version|wall|elapsed|utc|free|host|seconds|python|libraries|created|bytes")
LIMITS = """
[limits.scale_factor]
low = 49
high = 51
unit = "mV/(deg/s)"

[limits.bias_stability]
high = 3
unit = "deg/h"
"""
TWO_STAGE = ("points=3", "soak_s=600", "rates=3", "sweep_rates=5", "run_s=10", "zero_s=10")


def verb(folder: Path, *arguments: str) -> dict[str, Any]:
    """Run a verb in a folder; its JSON, with the exit code."""
    before = Path.cwd()
    (folder / "result.json").unlink(missing_ok=True)
    os.chdir(folder)
    try:
        code = run_verb([*arguments, "--json", "result.json", "--quiet"])
    finally:
        os.chdir(before)
    return {"exit_code": code, **json.loads((folder / "result.json").read_text())}


def stable(value: Any, folder: Path) -> Any:
    """A result without what differs from run to run: times of day, versions, digests, folders."""
    if isinstance(value, Mapping):
        kept = {str(key): one for key, one in value.items() if not VOLATILE.search(str(key))}
        if isinstance(kept.get("steps"), list):
            kept["steps"] = columns(kept["steps"])
        return {key: stable(one, folder) for key, one in kept.items()}
    if isinstance(value, list):
        numbers = [one for one in value if isinstance(one, float | int)]
        if len(value) > LONGEST and len(numbers) == len(value):
            mean, power = sum(numbers) / len(numbers), sum(one * one for one in numbers) / len(numbers)
            return {"count": len(numbers), "mean": mean, "rms": math.sqrt(power)}
        return [stable(one, folder) for one in value]
    return value.replace(f"{folder}/", "").replace(f"{SHARED}/", "") if isinstance(value, str) else value


def columns(steps: list[Any]) -> Any:
    """The numbers of many steps by their names; a list of anything else as it is."""
    if not all(isinstance(step, Mapping) for step in steps):
        return steps
    names = sorted({name for step in steps for name, one in step.items() if isinstance(one, float | int)})
    return {name: [step[name] for step in steps if isinstance(step.get(name), float | int)] for name in names}


def differences(stored: Any, now: Any, where: str = "") -> Iterator[str]:
    """Where two results differ, one line each."""
    if isinstance(stored, dict) and isinstance(now, dict):
        for key in sorted(stored.keys() | now.keys()):
            if key not in stored or key not in now:
                yield f"{where}/{key}: {'is new' if key in now else 'is gone'}"
            else:
                yield from differences(stored[key], now[key], f"{where}/{key}")
    elif isinstance(stored, list) and isinstance(now, list) and len(stored) == len(now):
        for i, (one, other) in enumerate(zip(stored, now, strict=True)):
            yield from differences(one, other, f"{where}/{i}")
    elif isinstance(stored, float) and isinstance(now, float | int):
        if not math.isclose(stored, now, rel_tol=RELATIVE, abs_tol=ABSOLUTE):
            yield f"{where}: {stored!r} is now {now!r}"
    elif stored != now:
        yield f"{where}: {stored!r} is now {now!r}"


def compare(name: str, result: Mapping[str, Any], folder: Path) -> None:
    """Fail where a result is not the stored one."""
    now, path = json.loads(json.dumps(stable(result, folder))), STORED / f"{name}.json"
    if os.environ.get("BENCHCTL_WRITE_GOLDEN"):
        STORED.mkdir(exist_ok=True)
        path.write_text(json.dumps(now, indent=1, ensure_ascii=False, sort_keys=True) + "\n", encoding="utf-8")
    found = list(differences(json.loads(path.read_text(encoding="utf-8")), now))
    assert not found, f"{name}: {len(found)} differences\n" + "\n".join(found[:20])


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with recordings of the simulated bench, each of a fixed seed."""
    folder = tmp_path_factory.mktemp("golden")
    small = [part for name, value in SMALL.items() for part in ("-p", f"{name}={value}")]
    calibration = [part for one in TWO_STAGE for part in ("-p", one)]
    (folder / "bench.toml").write_text(template().replace("sample_rate_hz = 500.0", "sample_rate_hz = 50.0"))
    (folder / "limits.toml").write_text(LIMITS)
    for name, seed, arguments in (
        ("two_stage", "7", ("two_stage", *calibration)),
        ("another_day", "8", ("two_stage", *calibration)),
        ("acceptance", "7", ("acceptance", *small, "--bench", "bench.toml")),
        ("static", "7", ("static", "-p", "duration_s=600", "-p", "soak_s=600")),
    ):
        assert verb(folder, "simulate", *arguments, "-o", f"{name}.h5", "--seed", seed)["exit_code"] == 0
    assert verb(folder, "fit", "two_stage.h5", "--out", "fitted")["exit_code"] == 0
    return folder


COMMANDS: Mapping[str, tuple[str, ...]] = {
    "check": ("check", "two_stage", "--bench", "simulated"),
    "fit": ("fit", "two_stage.h5", "--out", "fitted_again"),
    "apply": ("apply", "two_stage.h5", "--coefficients", "fitted/coefficients.json", "-o", "compensated.h5"),
    "compare": ("compare", "two_stage.h5", "another_day.h5", "--out", "compared"),
    "accept": ("accept", "acceptance.h5", "--limits", "limits.toml", "--out", "accepted"),
    "allan": ("allan", "static.h5", "--out", "allan"),
    "verify": ("verify", "two_stage.h5"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_a_verb_gives_the_stored_result(name: str, bench: Path) -> None:
    compare(name, verb(bench, *COMMANDS[name]), bench)


@pytest.mark.slow
@needs_shared("recordings")
@pytest.mark.parametrize(
    "recording",
    [f"opened/{one}" for one in ("bias_temperature", "null", "outliers", "saturation_and_cubic")]
    + [f"unnamed/{one}" for one in ("compressor", "kink", "slip")],
)
def test_the_diagnosis_of_a_shared_recording_is_the_stored_one(recording: str, tmp_path: Path) -> None:
    name = "diagnose_" + recording.replace("/", "_")
    compare(name, verb(tmp_path, "diagnose", str(SHARED / "recordings" / recording), "--out", "report"), tmp_path)
