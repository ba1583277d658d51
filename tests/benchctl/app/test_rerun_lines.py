"""What a terminal is told of two runs, whatever their recordings hold."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchctl.app.rerun import FirstRun, Rerun, lines
from benchctl.campaign.differences import Differences
from benchctl.metrology.names import UNITS
from benchctl.metrology.rerun import compared
from benchctl.metrology.result import Judged, Measured, Uncertainty, message
from benchctl.recordings.model import BenchFacts, Meta, Unit

HOSTILE = "\x1b[31mred\x07\n\u202eover" + "x" * 500
SAME = Differences(procedure=(), parameters=(), bench=(), instruments=(), software=(), operator=())


def _judged(name: str, value: float | None, expanded: float) -> Judged:
    agrees = message("gum_agrees", difference_percent=0.0)
    known = Uncertainty(standard=expanded / 2, expanded=expanded, monte_carlo=expanded, contributors=(), says=agrees)
    measured = Measured(name=name, unit=UNITS[name], value=value, uncertainty=None if value is None else known)
    return Judged(measured=measured, limit=None, verdict=None)


def _rerun(first: tuple[Judged, ...], again: tuple[Judged, ...], *, serial: str = "G1") -> Rerun:
    meta = Meta(
        status="complete",
        unit=Unit(serial=serial, range_dps=100.0),
        bench=BenchFacts(sample_rate_hz=100.0),
        provenance={"procedure": "static", "started_utc": "2026-11-20T18:00:00+00:00"},
    )
    run = FirstRun(path=Path("first.h5"), meta=meta, digest="d", limits=None, stated=None, judged=first)
    return Rerun(
        first=run,
        again=Path("second/recording.h5"),
        again_digest="e",
        seeds=(None, None),
        differences=SAME,
        tests=compared(first, again),
        accepted=None,
    )


def test_every_group_says_that_it_is_the_same() -> None:
    told = lines(_rerun((_judged("bias", 1.0, 0.1),), (_judged("bias", 1.05, 0.1),))).splitlines()
    assert told[0] == "first        first.h5: static, 2026-11-20T18:00:00+00:00, complete, unit G1"
    groups = ("procedure", "parameters", "bench.toml", "instruments", "software", "operator")
    assert told[1:7] == [f"{group:13}the same" for group in groups]
    assert told[7] == "acceptance   there is none next to the first run"


def test_a_test_is_a_line_and_what_differs_is_named_again() -> None:
    first = _judged("bias", 1.0, 0.03), _judged("threshold", 2.0, 0.1), _judged("dead_zone", None, 0.1)
    again = _judged("bias", 1.1, 0.04), _judged("threshold", 2.01, 0.1), _judged("dead_zone", None, 0.1)
    told = lines(_rerun(first, again)).splitlines()
    assert " ".join(told[10].split()) == "bias 2 differs (1.000 ± 0.030) °/h 1.100 ± 0.040 0.100 ± 0.050"
    assert told[11].split()[:3] == ["threshold", "0.07", "(2.00"]
    assert told[12] == "differ: bias"
    assert not any("dead_zone" in line for line in told)


def test_every_test_at_its_widest_fits_a_terminal_with_its_whole_name() -> None:
    first = tuple(_judged(name, -12345.678, 0.0012) for name in UNITS)
    again = tuple(_judged(name, 12345.678, 0.0012) for name in UNITS)
    told = lines(_rerun(first, again)).splitlines()
    rows = {line.split()[0]: line for line in told[10 : 10 + len(UNITS)]}
    assert set(rows) == set(UNITS)
    assert all("  differs  " in row for row in rows.values())
    assert max(map(len, told)) <= 120
    assert all(name in "".join(told[10 + len(UNITS) :]) for name in UNITS)


@pytest.mark.parametrize("group", ["procedure", "parameters", "bench", "instruments", "software", "operator"])
def test_no_text_of_a_recording_reaches_the_terminal_as_a_command(group: str) -> None:
    rerun = _rerun((_judged("bias", 1.0, 0.1),), (_judged("bias", 1.0, 0.1),), serial=HOSTILE)
    told = lines(replace(rerun, differences=replace(SAME, **{group: (HOSTILE,)})))
    assert all(line.isprintable() and len(line) <= 120 for line in told.splitlines())
