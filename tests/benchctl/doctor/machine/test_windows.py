"""By the words of Microsoft's documents; nobody has tried it on Windows."""

from benchctl.doctor.machine.windows import clock_finding, idle_finding

POWERCFG = """\
Power Scheme GUID: 381b4222-f694-41f0-9685-ff5bb260df2e  (Balanced)
  Subgroup GUID: 238c9fa8-0aad-41ed-83f4-97be242c8f20  (Sleep)
    Power Setting GUID: 29f6c1db-86da-48c5-9fdb-f2b67b1f44da  (Sleep after)
      Minimum Possible Setting: 0x00000000
      Maximum Possible Setting: 0xffffffff
      Possible Settings increment: 0x00000001
      Possible Settings units: Seconds
    Current AC Power Setting Index: 0x{ac:08x}
    Current DC Power Setting Index: 0x{dc:08x}
"""


def test_the_time_after_which_windows_sleeps_is_told_and_how_to_change_it() -> None:
    finding = idle_finding("sleep", POWERCFG.format(ac=1800, dc=900))
    assert finding.verdict == "look"
    assert "on the mains after 30 min without keys, on battery after 15 min" in finding.says
    assert finding.do == "powercfg /change standby-timeout-ac 0"
    assert idle_finding("hibernation", POWERCFG.format(ac=0, dc=900)).verdict == "ok"


def test_a_powercfg_that_does_not_answer_is_no_proof() -> None:
    assert idle_finding("sleep", None).verdict == "look"
    assert "not tried" in idle_finding("sleep", "").says


def test_a_clock_without_a_stratum_is_not_synchronised() -> None:
    assert clock_finding("Leap Indicator: 0\nStratum: 3 (secondary reference)\n").verdict == "ok"
    assert clock_finding("Leap Indicator: 3\nStratum: 0 (unspecified)\n").verdict == "look"
    assert clock_finding(None).verdict == "look"
