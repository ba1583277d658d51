from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from benchctl.campaign.guard.orders import Orders, Reached
from benchctl.campaign.guard.rescue import Rescued, act, rescue, words
from tests.benchctl.campaign.guard.test_rescue import in_motion


@pytest.mark.parametrize(
    ("rescued", "says"),
    [
        (
            Rescued(rate_dps=-0.0012, chamber_setpoint_c=23.0, problems=()),
            "table at rest (-0.001 deg/s) and chamber set to 23 °C, read back",
        ),
        (
            Rescued(rate_dps=None, chamber_setpoint_c=23.0, problems=("rate_table: no answer",)),
            "chamber set to 23 °C, read back; NOT CONFIRMED: rate_table: no answer; go and look",
        ),
        (
            Rescued(rate_dps=None, chamber_setpoint_c=None, problems=("rate_table: a", "chamber: b")),
            "NOT CONFIRMED: rate_table: a; chamber: b; go and look",
        ),
    ],
)
def test_what_was_read_back_and_what_was_not_is_said_in_a_line(rescued: Rescued, says: str) -> None:
    assert words(rescued) == says


def test_a_journal_that_is_gone_keeps_nothing_from_being_brought_to_rest_and_is_said(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with in_motion(tmp_path) as (servers, orders):
        moved = replace(orders, journal=tmp_path / "gone" / "journal.jsonl")
        assert act(moved, "the runner hangs (process 1), and was killed")
        assert abs(servers.world.table.motion().rate_dps) < 0.05
    errors = capfd.readouterr().err
    assert errors.startswith("benchctl guard: the runner hangs (process 1), and was killed; table at rest")
    assert "(not in the journal: " in errors
    assert errors.count("\n") == 1


def test_instruments_that_are_not_there_are_named(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchctl.campaign.guard.rescue.rescue", partial(rescue, give_up_s=0.1))
    orders = Orders(
        runner=1,
        journal=tmp_path / "journal.jsonl",
        time_factor=1.0,
        rest_within_s=5.0,
        safe_c=23.0,
        rate_table=_nowhere("acutrol3000", tmp_path),
        chamber=_nowhere("watlow_f4t", tmp_path),
    )
    assert not act(orders, "the runner ended")
    assert "NOT CONFIRMED: rate_table: rate table at tcp://127.0.0.1:9: " in capfd.readouterr().err
    assert '"reason": "the runner ended"' in (tmp_path / "journal.jsonl").read_text(encoding="utf-8")


def test_a_manual_table_is_an_alarm_and_the_chamber_goes_home(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with in_motion(tmp_path) as (servers, orders):
        assert not act(replace(orders, rate_table=Reached(model="manual", address="", options={}, locks=[])), "it died")
        assert servers.world.chamber.setpoint_c() == 23.0
        assert servers.world.table.motion().rate_dps == pytest.approx(120.0, abs=1.0)
    alarm, result = capfd.readouterr().err.splitlines()
    nobody = "rate_table: it is operated manually: only the operator can stop it"
    assert alarm == f"benchctl guard: it died; {nobody}: stop it NOW"
    assert result == f"benchctl guard: it died; chamber set to 23 °C, read back; NOT CONFIRMED: {nobody}; go and look"


def _nowhere(model: str, folder: Path) -> Reached:
    return Reached(
        model=model, address="tcp://127.0.0.1:9", options={"timeout_s": 0.1}, locks=[str(folder / f"{model}.lock")]
    )
