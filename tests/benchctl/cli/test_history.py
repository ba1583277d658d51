"""`benchctl history`, as its users run it."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path
from typing import Any

import pytest

from benchctl.cli.app import run_verb
from benchctl.history.index import NAME
from tests.benchctl.cli.processes import benchctl, without_a_process
from tests.benchctl.history.made_history import accepted, campaign, digest_in, one_test, recorded, started
from tests.benchctl.reports.page import Page


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two units; the second one jumps, and fails its last acceptance."""
    for number in range(9):
        campaign(tmp_path / "all", "SN-1", number, 0.05 + 1e-6 * (number % 2), 1e-5)
    for number in range(3):
        place = campaign(tmp_path / "all", "SN-2", number, 0.05 + (0.001 if number == 2 else 0.0), 1e-5)
        verdict = "FAIL" if number == 2 else "PASS"
        limit = {"low": -1.5, "high": 1.5, "unit": "deg/h"}
        test = one_test(value=1.0 + number, limit=limit, verdict=verdict)
        (place / "acceptance.json").write_text(accepted([test], digest_in(place), verdict))
    return tmp_path / "all"


def test_a_table_a_page_an_index_and_json(folder: Path) -> None:
    ran = benchctl("history", folder, "--json", folder.parent / "h.json")
    assert ran.returncode == 0, ran.stderr
    rows = ran.stdout.splitlines()
    assert rows[1].split() == ["SN-1", "VG910Q", "9", "2026-01-09", "08:00"]
    assert rows[2].split() == ["SN-2", "VG910Q", "3", "2026-01-03", "08:00", "FAIL"]
    assert rows[3].startswith("  bias: the latest value fails its limit; drifted since the last calibration, ")
    assert rows[4].startswith("  K0_v_per_dps: drifted since the last calibration, 2026-01-02 (E_n = 71)")
    assert rows[-1] == f"report: {folder / 'history.html'}"
    told = json.loads((folder.parent / "h.json").read_text())
    assert (told["schema"], told["ok"], told["problems"]) == ("benchctl-history/1", True, [])
    assert told["index"] == str(folder / NAME)
    assert Path(told["index"]).exists()
    first, second = told["units"]
    assert (first["serial"], first["model"], len(first["campaigns"])) == ("SN-1", "VG910Q", 9)
    (K0,) = first["figures"]
    assert (K0["name"], K0["unit"], len(K0["points"]), K0["flags"]) == ("K0_v_per_dps", "V", 9, [])
    assert K0["control"]["centre"] == pytest.approx(0.05 + 4e-6 / 9)
    assert K0["control"]["high"] - K0["control"]["centre"] == pytest.approx(3e-6 / 1.128)
    point = K0["points"][0]
    assert {key: point[key] for key in ("started_utc", "value", "uncertainty", "campaign", "verdict")} == {
        "started_utc": started(0),
        "value": 0.05,
        "uncertainty": 1e-5,
        "campaign": "000_SN-1/recording.h5",
        "verdict": None,
    }
    bias, K0 = second["figures"]
    assert K0["control"] is None
    assert K0["drift"]["difference"] == pytest.approx(0.001)
    assert K0["drift"]["uncertainty"] == pytest.approx(2**0.5 * 1e-5)
    assert K0["drift"]["e_n"] == pytest.approx(100 / 2**0.5)
    assert K0["drift"]["since"] == {"started_utc": started(1), "campaign": "001_SN-2/recording.h5"}
    assert [flag["kind"] for flag in bias["flags"]] == ["fails", "drift", "drift"]
    assert bias["points"][-1]["limit"] == {"low": -1.5, "high": 1.5}


def test_the_page_has_a_section_a_unit_a_chart_a_figure_and_needs_nothing_else(folder: Path) -> None:
    assert run_verb(["history", str(folder), "--quiet"]) == 0
    page = Page((folder / "history.html").read_text(encoding="utf-8"))
    assert page.refers_elsewhere() == []
    assert len(page.figures) == 3 + 1  # of units, and the K0 of both beside each other
    assert {"unit-1", "unit-2"} <= set(page.ids)
    assert "Units against each other" in page.words
    assert "The latest value fails its limit" in page.words
    assert "3 of 8 points for control limits" in page.words


def test_one_unit_and_one_figure_may_be_asked_for(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["history", str(folder), "--unit", "SN-2", "--figure", "bias", "--json", "-", "--quiet"]
    assert run_verb(arguments) == 0
    (unit,) = json.loads(capsys.readouterr().out)["units"]
    assert (unit["serial"], [one["name"] for one in unit["figures"]]) == ("SN-2", ["bias"])
    assert not (folder / "history.html").exists()


def test_an_archive_is_read_without_an_index_and_its_page_lies_beside_it(folder: Path) -> None:
    path = folder.parent / "all.tar.gz"
    with tarfile.open(path, "w:gz") as archive:
        for one in ("000_SN-1", "000_SN-2"):
            archive.add(folder / one, arcname=f"all/{one}")
    ran = without_a_process("history", path, "--out", folder.parent / "page", "--json", folder.parent / "h.json")
    assert ran.returncode == 0, ran.stderr
    told: dict[str, Any] = json.loads((folder.parent / "h.json").read_text())
    assert told["index"] is None
    assert told["units"][1]["campaigns"][0]["path"] == "all/000_SN-2/recording.h5"
    assert (folder.parent / "page" / "history.html").exists()


def test_names_from_files_neither_reach_the_terminal_nor_the_page_as_they_are(tmp_path: Path) -> None:
    serial = "<script>alert(1)</script>\x1b[2J$\\frac{$"
    place = tmp_path / "all" / "one"
    digest = recorded(place / "recording.h5", serial)
    tests = [one_test("</svg>\x07", unit="<b>", limit={"low": 0.0, "high": 2.0, "unit": "<b>"})]
    (place / "acceptance.json").write_text(accepted(tests, digest, "\x1b[31mPASS"))
    recorded(tmp_path / "all" / "two.h5", "<i>")
    ran = without_a_process("history", tmp_path / "all")
    assert ran.returncode == 0, ran.stderr
    assert "\x1b" not in ran.stdout
    text = (tmp_path / "all" / "history.html").read_text(encoding="utf-8")
    Page(text)
    assert "<script>" not in text
    assert "<b>" not in text.replace("<b>How to read the charts.</b>", "")
    assert "\x1b" not in text


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["none"], "none: is not there; expected a folder of campaigns, .zip, .tar or .tar.gz"),
        (["empty"], "empty: holds no campaign: expected recordings (*.h5) in it or below"),
        (["text.zip"], "text.zip: is no folder and no archive"),
        (["all", "--unit", "SN-3"], "--unit SN-3: there is no such unit; there are SN-1, SN-2"),
        (["all", "--figure", "K1"], "--figure K1: there is no such figure; there are K0_v_per_dps, bias"),
        (["all", "--out", "text.zip"], "text.zip: may not be written to"),
    ],
)
def test_what_cannot_be_used_is_one_clear_line(
    arguments: list[str], says: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder.parent)
    Path("empty").mkdir()
    Path("text.zip").write_text("no archive")
    assert run_verb(["history", *arguments]) == 2
    told = capsys.readouterr()
    assert told.err == f"benchctl: {told.err.splitlines()[0].removeprefix('benchctl: ')}\n"
    assert says in told.err
    assert not Path("all", "history.html").exists()
    assert list(Path("empty").iterdir()) == []


def test_a_damaged_index_is_one_line_on_stderr_and_no_failure(folder: Path) -> None:
    (folder / NAME).write_bytes(b"SQLite format 3\0" + bytes(5000))
    ran = without_a_process("history", folder, "--quiet")
    assert ran.returncode == 0
    assert ran.stderr.count("\n") == 1
    assert "made anew from the recordings" in ran.stderr


@pytest.mark.slow
def test_a_real_campaign_of_the_simulated_bench_is_in_its_history(tmp_path: Path) -> None:
    made = benchctl("simulate", "static", "-p", "duration_s=5", "-o", tmp_path / "static.h5", "--seed", "1")
    assert made.returncode == 0, made.stderr
    ran = benchctl("history", tmp_path, "--json", "-", "--quiet")
    assert ran.returncode == 0, ran.stderr
    (unit,) = json.loads(ran.stdout)["units"]
    (one,) = unit["campaigns"]
    assert (one["path"], one["procedure"], one["status"]) == ("static.h5", "static", "complete")


def test_the_history_of_a_single_campaign_leaves_it_verifiable(tmp_path: Path) -> None:
    one = tmp_path / "one"
    ran = without_a_process("run", "static", "--bench", "simulated", "-p", "duration_s=2", "--out", one, "--quiet")
    assert ran.returncode == 0, ran.stderr
    assert without_a_process("history", one, "--quiet").returncode == 0
    assert (one / "history.html").is_file()
    verified = without_a_process("verify", one)
    assert verified.returncode == 0, verified.stdout
