"""A fleet compared: spreads, who stands apart, which physics recurs, tests."""

from __future__ import annotations

import json
import statistics
from dataclasses import replace
from pathlib import Path

from benchctl.reports.fleet_facts import (
    Fleet,
    diagnosed,
    fleet_values,
    judged,
    lines,
    recurring,
    spreads,
    write_fleet_file,
)
from benchctl.reports.fleet_page import write_fleet_page
from benchctl.reports.fleet_stated import Stated
from tests.benchctl.reports.made_fleet import ODD, effect, fleet
from tests.benchctl.reports.page import Page


def test_each_figure_is_spread_over_the_units_and_bounds_are_left_out() -> None:
    found = {spread.name: spread for spread in spreads(fleet(24))}
    assert list(found) == ["K0_v_per_dps", "U0_v", "error_percent.joint", "bias"]
    K0 = found["K0_v_per_dps"]
    values = [figure.value for _, figure in K0.values]
    assert (len(values), K0.unit, K0.model, K0.verb) == (24, "V/(deg/s)", "VG910Q", "fit")
    assert K0.median == statistics.median(values)
    member, figure, z = K0.apart[0]
    assert member.name == f"SN-{ODD:02d}"
    mad = statistics.median(abs(value - K0.median) for value in values)
    assert z == 0.6745 * (figure.value - K0.median) / mad
    assert abs(z) > 3.5 + 8 / 21


def test_of_fewer_than_five_units_none_stands_apart() -> None:
    assert all(not spread.apart for spread in spreads(fleet(4)))


def test_effects_come_by_how_often_they_are_found() -> None:
    found = recurring(fleet(24))
    assert [(one.effect, len(one.found)) for one in found] == [
        ("thermal_lag", 12),
        ("dropouts", 1),
        ("scale_asymmetry", 1),
    ]
    assert len(diagnosed(fleet(24))) == 24
    assert found[1].sizes == []
    assert found[2].sizes == [-0.7]


def test_an_effect_that_is_found_twice_in_a_recording_counts_once(tmp_path: Path) -> None:
    harmonics = tuple(effect("encoder_eccentricity", "amplitude_deg", size, "deg") for size in (0.2, -0.01))
    members = fleet(3).members
    stated = {**members[1].stated, "diagnose": Stated(verdict="missing-physics", effects=harmonics)}
    made = Fleet(verb="diagnose", members=(members[0], replace(members[1], stated=stated), members[2]), left=0)
    found = {one.effect: one for one in recurring(made)}
    assert (found["encoder_eccentricity"].count, found["encoder_eccentricity"].sizes) == (1, [0.2, -0.01])
    assert "  encoder_eccentricity in 1 of 3" in lines(made)
    assert [one["found"] for one in fleet_values(made)["effects"]] == [2, 1]
    page = Page(write_fleet_page(made, tmp_path).read_text(encoding="utf-8"))
    assert "encoder_eccentricity 1/3" in page.words


def test_tests_that_fail_come_first() -> None:
    found = judged(fleet(24))
    assert list(found) == ["bias", "delay", "threshold"]
    assert [one.name for one in found["bias"]["FAIL"]] == [f"SN-{ODD:02d}"]
    assert {verdict: len(members) for verdict, members in found["delay"].items()} == {
        "PASS": 19,
        "FAIL": 0,
        "INCONCLUSIVE": 5,
    }


def test_the_file_has_what_json_says_and_is_json(tmp_path: Path) -> None:
    made = fleet(24, failed=("broken",), left=2)
    write_fleet_file(tmp_path / "fleet.json", made)
    content = json.loads((tmp_path / "fleet.json").read_text())
    assert content == {"schema": "benchctl-fleet/1", **json.loads(json.dumps(fleet_values(made)))}
    assert content["recordings"] == {"total": 27, "done": 23, "kept": 1, "failed": 1, "left": 2}
    assert content["failures"] == [{"recording": "/lab/broken.h5", "says": "/lab/broken.h5: is no <HDF5> file"}]
    (lag, dropouts, _) = content["effects"]
    assert (lag["found"], lag["of"], lag["parameter"], lag["unit"]) == (12, 24, "tau_s", "s")
    assert lag["low"] <= lag["median"] <= lag["high"]
    assert (dropouts["parameter"], dropouts["median"]) == (None, None)
    K0 = content["figures"][0]
    assert K0["apart"][0]["recording"] == f"/lab/SN-{ODD:02d}.h5"


def test_a_terminal_is_told_the_same_in_a_few_lines() -> None:
    told = list(lines(fleet(24, failed=tuple(f"bad{number}" for number in range(30)), left=2)))
    assert told[0] == "fit of 56 recordings: 23 done, 1 unchanged since they were done, 30 failed, 2 left"
    assert told[1] == "failed: /lab/bad0.h5: is no <HDF5> file"
    assert told[21] == "and 10 more such; the report has all"
    assert any(line.startswith(f"apart: K0_v_per_dps of SN-{ODD:02d}: 0.0505") for line in told)
    assert "  thermal_lag in 12 of 24" in told
    assert "acceptances: 23 PASS, 1 FAIL" in told
    assert "  bias: 1 FAIL, 0 INCONCLUSIVE, 23 PASS" in told


def test_only_an_acceptance_rejects() -> None:
    assert fleet(24).rejected == []
    assert [member.name for member in fleet(24, verb="accept").rejected] == [f"SN-{ODD:02d}"]
