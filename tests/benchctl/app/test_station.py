"""The procedures that a lab releases: what a bench.toml may state, and what the command line makes of a unit's name."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchctl.app.station import Station
from benchctl.bench import load_bench, template
from benchctl.campaign.provenance import recorded_bench
from benchctl.plan.find import find_procedure
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.cli.processes import without_a_process

OWN = """
from benchctl.plan import Static, procedure

@procedure()
def own(rests: int = 2, rest_s: float = 10.0, slow: bool = False):
    '''Rests.'''
    for _ in range(rests):
        yield Static(duration_s=rest_s)
"""


def station(folder: Path, tables: str, bench: str = "") -> Station:
    """A station of the simulated bench with these tables."""
    (folder / "own.py").write_text(OWN)
    (folder / "bench.toml").write_text(f"{bench or template()}\n{tables}", encoding="utf-8")
    return Station(folder / "bench.toml", folder)


def test_released_procedures_have_their_parameters_and_their_duration_on_the_bench(tmp_path: Path) -> None:
    tables = """
[released.rests]
title = "Three rests"
procedure = "own.py"
parameters = { rests = 3, rest_s = "1 min", slow = true }
[released.usual]
procedure = "own.py"
[released.hot]
procedure = "static"
parameters = { at_c = 150.0 }
"""
    rests, usual, hot = station(tmp_path, tables).procedures.values()
    assert (rests.title, rests.says, rests.steps, rests.questions) == ("Three rests", "Rests.", 3, 0)
    assert (usual.title, usual.steps, hot.bench_time_s) == ("usual", 2, None)
    assert rests.bench_time_s is not None
    assert usual.bench_time_s is not None
    assert rests.bench_time_s - 3 * usual.bench_time_s / 2 == pytest.approx(3 * 50.0)
    plan = find_procedure(rests.command[0]).expand(
        dict(one.removeprefix("--parameter=").split("=") for one in rests.command[1:])
    )
    assert plan.parameters == {"rests": 3, "rest_s": 60.0, "slow": True}


@pytest.mark.parametrize(
    ("tables", "says"),
    [
        ("", "bench.toml: releases no procedure; add [released.NAME] with procedure = …"),
        (
            '[released.x]\nprocedure = "twostage"',
            "released.x: there is no procedure 'twostage': did you mean two_stage",
        ),
        ('[released.x]\nprocedure = "gone.py"', "there is no such file"),
        ('[released.x]\nprocedure = "own.py"\nparameters = { rest = 1 }', "has no parameter 'rest'"),
        ('[released.x]\nprocedure = "own.py"\nparameters = { rests = "many" }', "parameter rests: "),
        ('[released.x]\ntitle = "x"', "released.x.procedure: "),
        ('[released.x]\nprocedure = "own.py"\npoints = 3', "released.x.points: "),
    ],
)
def test_what_cannot_be_released_is_said_in_a_line(tmp_path: Path, tables: str, says: str) -> None:
    with pytest.raises(UsageError) as caught:
        station(tmp_path, tables)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_bench_that_is_turned_by_hand_releases_nothing(tmp_path: Path) -> None:
    bench = template().replace('model = "acutrol3000"', 'model = "manual"')
    with pytest.raises(UsageError, match="turned by hand"):
        station(tmp_path, '[released.x]\nprocedure = "own.py"', bench)


def test_a_run_of_a_named_unit_is_of_that_unit_and_is_repeated_on_it(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    run = ("run", "own.py", "--bench", "simulated", "--unit", "SN-99", "--page", "A. Ohm", "--out", "first", "-q")
    ran = without_a_process(*run, folder=tmp_path)
    assert (ran.returncode, ran.stderr) == (0, "")
    with open_recording(tmp_path / "first") as recording:
        assert recording.meta.unit.serial == "SN-99"
        assert recording.meta.provenance["operator"] == "A. Ohm"
        assert recorded_bench(recording.meta, "it").unit.serial == "SN-99"
        assert load_bench("simulated").unit.serial != "SN-99"
    again = without_a_process("run", "own.py", *run[2:], "--resume", "first", folder=tmp_path)
    assert again.stderr.startswith("benchctl: --out first: a campaign that is resumed stays in its folder")
    other = without_a_process(
        *("run", "own.py", "--bench", "simulated", "--unit", "SN-1", "--resume", "first"), folder=tmp_path
    )
    assert "unit.serial was SN-99, is SN-1" in other.stderr


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--bench", "simulated", "--unit", " "), "unit: expected a serial number, got an empty text"),
        (("--unit", "SN-1"), "--unit SN-1: names the unit on a bench; name the bench with --bench, too"),
        (("--bench", "simulated", "--page", "A", "--answers", "a.toml"), "--page A: the answers come from a.toml"),
    ],
)
def test_names_that_contradict_are_said_in_a_line(tmp_path: Path, arguments: tuple[str, ...], says: str) -> None:
    ran = without_a_process("run", "static", *arguments, folder=tmp_path)
    assert (ran.returncode, ran.stderr.count("\n")) == (2, 1)
    assert says in ran.stderr
