"""A chamber profile of a lab's own: found from bench.toml, kept in the recording, the same after a resume."""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from benchctl.bench import Bench, load_bench, template
from benchctl.campaign.differences import refuse_another
from benchctl.campaign.guard.keeper import guarded
from benchctl.campaign.opened import open_bench, simulated_bench
from benchctl.campaign.provenance import describe, recorded_bench
from benchctl.plan import Plan, Static
from benchctl.recordings.journal import journal_text
from benchctl_instruments.errors import UsageError
from benchctl_instruments.interfaces import Identity
from benchctl_instruments.simulated.clock import ScaledClock
from tests.instruments.chambers.lab_controllers import ACME

PLAN = Plan(procedure="mine", parameters={}, steps=(Static(duration_s=1.0),), calibrates=False, source="source")


def lab_in(folder: Path, model: str = "profiles/acme 9.toml", profile: str = ACME) -> str:
    """A bench.toml with a profile in a folder beside; its path."""
    (folder / "profiles").mkdir(parents=True, exist_ok=True)
    (folder / "profiles" / "acme 9.toml").write_text(profile, encoding="utf-8")
    path = folder / "bench.toml"
    path.write_text(template().replace('model = "watlow_f4t"', f"model = {json.dumps(model)}"), encoding="utf-8")
    return str(path)


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder beside the one that we are in."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "lab"


@pytest.mark.parametrize("named", [lambda path: path, lambda path: "../lab/bench.toml"])
def test_a_relative_path_begins_in_the_folder_of_bench_toml(elsewhere: Path, named: Callable[[str], str]) -> None:
    bench = load_bench(named(lab_in(elsewhere)))
    assert Path(bench.chamber.model).is_absolute()
    assert Path(bench.chamber.model).samefile(elsewhere / "profiles" / "acme 9.toml")
    assert bench.chamber_profile == ACME


def test_whole_paths_and_those_from_home_are_taken_as_they_are(
    elsewhere: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(elsewhere))
    monkeypatch.setenv("USERPROFILE", str(elsewhere))
    whole = str(elsewhere / "profiles" / "acme 9.toml")
    for model in (whole, "~/profiles/acme 9.toml"):
        lab_in(elsewhere)
        bench = load_bench(lab_in(tmp_path / "another", model))
        assert (bench.chamber.model, bench.chamber_profile) == (whole, ACME)


def test_a_bench_whose_chamber_has_a_driver_of_its_own_has_no_profile() -> None:
    assert load_bench("simulated").chamber_profile == ""


def test_a_profile_that_is_not_there_is_told_with_the_line_of_bench_toml(elsewhere: Path) -> None:
    path = lab_in(elsewhere, "profiles/acme-9.toml")
    line = template().partition('model = "watlow_f4t"')[0].count("\n") + 1
    with pytest.raises(UsageError) as caught:
        load_bench(path)
    assert str(caught.value).startswith(f"{path}, line {line}: chamber.model: there is no profile '{elsewhere}")
    assert str(caught.value).endswith("did you mean acme 9.toml?")


def test_a_profile_that_is_wrong_is_told_before_anything_is_opened(elsewhere: Path) -> None:
    path = lab_in(elsewhere, profile=ACME.replace("[air]", "[aire]"))
    with pytest.raises(UsageError, match=r"chamber profile .*/lab/profiles/acme 9\.toml, air: this field is needed"):
        load_bench(path)


@pytest.mark.parametrize("wires", [True, False])
def test_a_rehearsal_needs_the_file_no_longer_once_the_bench_is_read(elsewhere: Path, wires: bool) -> None:
    bench = load_bench(lab_in(elsewhere))
    shutil.rmtree(elsewhere)
    with open_bench(bench, wires=wires) as opened:
        opened.chamber.start()
        opened.chamber.go_to(31.0)
        assert opened.chamber.read().setpoint_c == 31.0
        if wires:
            assert opened.identities["chamber"] == Identity(manufacturer="Acme", model="9")


@pytest.mark.skipif(sys.platform == "win32", reason="signals between processes")
def test_the_guard_finds_its_chamber_when_the_profile_is_gone(elsewhere: Path, tmp_path: Path) -> None:
    bench = load_bench(lab_in(elsewhere))
    shutil.rmtree(elsewhere)
    with simulated_bench(bench, ScaledClock(50.0)) as servers:
        reached = {
            name: getattr(bench, name).model_copy(update={"address": servers.addresses[name]})
            for name in ("rate_table", "chamber")
        }
        real = bench.model_copy(update={"simulated": False, "time_factor": 50.0, **reached})
        servers.world.chamber.run(True)
        servers.world.chamber.set_setpoint(60.0)
        with guarded(real, tmp_path / "journal.jsonl") as guard:
            guard.arm(lambda kind, **data: None)
        deadline_s = time.monotonic() + 20.0
        while '"chamber_setpoint_c": 23.0' not in journal_text(tmp_path / "journal.jsonl"):
            assert time.monotonic() < deadline_s, journal_text(tmp_path / "journal.jsonl")
            time.sleep(0.02)
        assert servers.world.chamber.setpoint_c() == 23.0


def test_a_recording_keeps_the_profile_and_its_bench_can_be_had_again_without_the_file(elsewhere: Path) -> None:
    bench = load_bench(lab_in(elsewhere))
    with open_bench(bench, wires=False) as opened:
        meta = describe(opened, PLAN, "running")
    assert meta.provenance["chamber_profile"] == ACME
    shutil.rmtree(elsewhere)
    again = recorded_bench(meta, "the recording")
    assert (again.chamber_profile, again.text, again.physics) == (ACME, bench.text, bench.physics)
    with open_bench(again) as opened:
        assert opened.identities["chamber"].manufacturer == "Acme"


def _changed(bench: Bench, before: str, after: str) -> Bench:
    assert before in bench.chamber_profile
    return bench.read_from(bench.text, bench.chamber_profile.replace(before, after))


@pytest.mark.parametrize(
    ("before", "after", "says"),
    [
        ("address = 512\nkind", "address = 514\nkind", "chamber_profile.air.address was 512, is 514"),
        ("also = [530]", "also = [531]", "chamber_profile.setpoint.also was [530], is [531]"),
        ('3 = "door open"', '4 = "door open"', "chamber_profile.alarms.0.bits.3 was door open, is not there; "),
        ('word_order = "low_first"', "", "chamber_profile.transport.word_order was low_first, is high_first"),
    ],
)
def test_a_campaign_does_not_go_on_with_another_profile(elsewhere: Path, before: str, after: str, says: str) -> None:
    bench = load_bench(lab_in(elsewhere))
    with open_bench(bench, wires=False) as opened:
        meta = describe(opened, PLAN, "running")
    with pytest.raises(UsageError, match=r"^--resume: this is not the campaign that was begun: ") as caught:
        refuse_another(meta, {}, PLAN, _changed(bench, before, after))
    assert says in str(caught.value)


def test_a_campaign_goes_on_with_the_same_profile_elsewhere_in_other_words_or_reached_in_another_way(
    elsewhere: Path, tmp_path: Path
) -> None:
    bench = load_bench(lab_in(elsewhere))
    with open_bench(bench, wires=False) as opened:
        meta = describe(opened, PLAN, "running")
    moved = load_bench(lab_in(tmp_path / "moved", str(tmp_path / "moved" / "profiles" / "acme 9.toml")))
    for same in (
        moved,
        _changed(bench, "[transport]", "# our own\n[transport]"),
        _changed(bench, "baud = 38400", "baud = 9600\ntimeout_s = 3.0"),
        _changed(bench, "interface manual, edition 2", "manual, third edition"),
    ):
        refuse_another(meta, {}, PLAN, same)


def test_a_profile_in_place_of_a_driver_is_another_chamber(elsewhere: Path) -> None:
    with open_bench(load_bench("simulated"), wires=False) as opened:
        meta = describe(opened, PLAN, "running")
    with pytest.raises(UsageError, match=r"chamber\.model was watlow_f4t, is a profile; .*\(and \d+ more\)"):
        refuse_another(meta, {}, PLAN, load_bench(lab_in(elsewhere)))


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("bench_toml", "a = " + "[" * 100_000, "the bench.toml of the campaign: nested too deep"),
        (
            "bench_toml",
            "",
            "the bench.toml of the campaign, line 1: name, unit, limits, rate_table, chamber, digitizer: these",
        ),
        ("bench_physics", "[" * 100_000, "bench_physics of the campaign: nested too deep"),
        ("bench_effects", "7", "bench_effects of the campaign: expected a table (a JSON object), got 7"),
        ("parameters", "{", "parameters of the campaign, line 1: not JSON"),
        ("parameters", '{"a": ' + "9" * 5000 + "}", "parameters of the campaign: holds a number with too many digits"),
        ("chamber_profile", "a = " + "[" * 100_000, "chamber profile of the campaign: not TOML"),
    ],
)
def test_a_recording_whose_provenance_is_hostile_is_refused_in_one_line(
    elsewhere: Path, name: str, text: str, says: str
) -> None:
    bench = load_bench(lab_in(elsewhere))
    with open_bench(bench, wires=False) as opened:
        meta = describe(opened, PLAN, "running")
    hostile = replace(meta, provenance={**meta.provenance, name: text})
    with pytest.raises(UsageError) as caught:
        refuse_another(hostile, {}, PLAN, bench)
    assert says in str(caught.value)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 1000
