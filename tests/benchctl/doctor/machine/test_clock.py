from datetime import UTC, datetime, timedelta

import pytest

from benchctl.doctor.machine.clock import clock_findings, synchronised_finding, year_finding

INSTALLED = datetime(2026, 11, 20, 12, tzinfo=UTC)
CHRONY = """\
Reference ID    : A29FC87B (162.159.200.123)
Stratum         : 4
System time     : 0.000018421 seconds slow of NTP time
Leap status     : {}
"""


@pytest.mark.parametrize(
    ("now", "verdict"),
    [
        (INSTALLED + timedelta(days=3), "ok"),
        (INSTALLED - timedelta(hours=13), "ok"),
        (datetime(1970, 1, 1, tzinfo=UTC), "bad"),
        (INSTALLED - timedelta(days=2), "bad"),
        (datetime(2106, 2, 7, tzinfo=UTC), "bad"),
    ],
)
def test_a_clock_that_cannot_be_true_is_bad(now: datetime, verdict: str) -> None:
    finding = year_finding(now, INSTALLED)
    assert finding.verdict == verdict
    assert finding.unusable == (verdict == "bad")


@pytest.mark.parametrize(
    ("timedatectl", "chronyc", "kernel", "verdict", "says"),
    [
        ("NTP=yes\nNTPSynchronized=yes", None, False, "ok", "by NTP, as timedatectl says; its service is on"),
        (
            "NTP=no\nNTPSynchronized=no",
            None,
            True,
            "look",
            "not synchronised, as timedatectl says; no service keeps it",
        ),
        (None, CHRONY.format("Normal"), None, "ok", "chrony: normal, 0.000018421 seconds slow"),
        ("NTPSynchronized=yes", CHRONY.format("Not synchronised"), True, "look", "chrony: not synchronised"),
        (None, None, True, "ok", "as the kernel says"),
        (None, None, False, "look", "not synchronised, as the kernel says"),
        ("", "506 Cannot talk to daemon", None, "look", "cannot be told"),
    ],
)
def test_synchronisation_is_told_by_whoever_knows(
    timedatectl: str | None, chronyc: str | None, kernel: bool | None, verdict: str, says: str
) -> None:
    finding = synchronised_finding(timedatectl, chronyc, kernel)
    assert finding.verdict == verdict
    assert says in finding.says
    assert bool(finding.do) == (verdict != "ok")


def test_the_clock_of_this_machine_is_looked_at() -> None:
    year, synchronised = clock_findings()
    assert (year.what, synchronised.what) == ("clock", "synchronised")
