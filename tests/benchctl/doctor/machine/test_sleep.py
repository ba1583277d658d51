import sys
from pathlib import Path

import pytest

from benchctl.doctor.machine.sleep import (
    desktop_findings,
    is_laptop,
    login_settings,
    sleep_finding,
    sleep_findings,
    update_finding,
)

needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="files of Linux")


@pytest.mark.parametrize(
    ("enabled", "login", "laptop", "verdict", "says"),
    [
        ("masked\nmasked\nmasked\nmasked", {"IdleAction": "suspend"}, True, "ok", "masked"),
        ("static\nstatic\nstatic\nstatic", {"IdleAction": "ignore"}, False, "ok", "does nothing when nobody types"),
        ("masked\nstatic\nmasked\nmasked", {"IdleAction": "suspend"}, False, "look", "logind does suspend"),
        ("static", {}, True, "look", "closing the lid does suspend"),
        ("static", {"HandleLidSwitch": "ignore"}, True, "ok", "does nothing"),
        (
            None,
            {"IdleAction": "hibernate", "HandleLidSwitch": "poweroff"},
            True,
            "look",
            "closing the lid does poweroff",
        ),
    ],
)
def test_what_systemd_would_do_by_itself_is_told(
    enabled: str | None, login: dict[str, str], laptop: bool, verdict: str, says: str
) -> None:
    finding = sleep_finding(enabled, login, laptop)
    assert (finding.verdict, says in finding.says) == (verdict, True)
    if verdict == "look":
        assert "sudo systemctl mask sleep.target suspend.target" in finding.do


def test_the_settings_of_logind_come_from_itself_or_from_its_files(tmp_path: Path) -> None:
    folder = tmp_path / "etc/systemd/logind.conf.d"
    folder.mkdir(parents=True)
    (folder.parent / "logind.conf").write_text("[Login]\n#IdleAction=suspend\nHandleLidSwitch=suspend\n")
    (folder / "10-lab.conf").write_text("[Login]\nHandleLidSwitch=ignore\n")
    assert login_settings(tmp_path, None) == {"HandleLidSwitch": "ignore"}
    assert login_settings(tmp_path, "IdleAction=suspend\nKillUserProcesses=no")["IdleAction"] == "suspend"
    assert login_settings(tmp_path / "absent", "") == {}


@pytest.mark.parametrize(
    ("timers", "periodic", "reboot", "verdict", "says"),
    [
        ("inactive\ninactive\ninactive\ninactive", None, None, "ok", "none come by themselves"),
        ("active\ninactive", 'APT::Periodic::Unattended-Upgrade "1";', "", "look", "restart services"),
        ("active", 'APT::Periodic::Unattended-Upgrade "0";', "", "ok", "none"),
        ("inactive\nactive", None, None, "look", "restart services"),
        (None, None, 'Unattended-Upgrade::Automatic-Reboot "true";', "look", "restart this machine"),
    ],
)
def test_updates_that_come_by_themselves_are_told(
    timers: str | None, periodic: str | None, reboot: str | None, verdict: str, says: str
) -> None:
    finding = update_finding(timers, periodic, reboot)
    assert (finding.verdict, says in finding.says) == (verdict, True)


def test_gnome_that_suspends_is_told() -> None:
    (finding,) = desktop_findings("'suspend'\n")
    assert finding.verdict == "look"
    assert "sleep-inactive-ac-type nothing" in finding.do
    assert [finding.verdict for finding in desktop_findings("'nothing'")] == ["ok"]
    assert list(desktop_findings(None)) == []


@needs_linux
def test_a_laptop_on_its_battery_is_told(tmp_path: Path) -> None:
    assert not is_laptop(tmp_path)
    (tmp_path / "sys/class/dmi/id").mkdir(parents=True)
    (tmp_path / "sys/class/dmi/id/chassis_type").write_text("10\n")
    assert is_laptop(tmp_path)
    battery = tmp_path / "sys/class/power_supply/BAT0"
    battery.mkdir(parents=True)
    (battery / "status").write_text("Discharging\n")
    found = {finding.what: finding for finding in sleep_findings(tmp_path)}
    assert (found["battery"].verdict, found["battery"].do) == ("look", "plug in the mains adapter")
    (battery / "status").write_text("Full\n")
    assert {finding.what: finding.verdict for finding in sleep_findings(tmp_path)}["battery"] == "ok"
