import pytest

from benchctl.doctor.ports.permission import Owner, refused_finding

DIALOUT = Owner(gid=20, group="dialout", group_may=True)


@pytest.mark.parametrize(
    ("owner", "groups", "entered", "do"),
    [
        (DIALOUT, [1000], False, "sudo usermod -a -G dialout ann, then log out and in again"),
        (Owner(gid=986, group="uucp", group_may=True), [1000], False, "sudo usermod -a -G uucp ann, then log"),
        (DIALOUT, [1000], True, "log out and in again (in this terminal only: newgrp dialout)"),
        (Owner(gid=0, group="root", group_may=True), [1000], False, 'a udev rule, SUBSYSTEM=="tty", KERNEL=="ttyUSB0"'),
        (Owner(gid=5, group="tty", group_may=False), [5], True, "a udev rule"),
    ],
)
def test_who_may_not_use_a_port_is_told_what_to_do(owner: Owner, groups: list[int], entered: bool, do: str) -> None:
    finding = refused_finding("chamber", "/dev/ttyUSB0", owner, "ann", groups, entered=entered)
    assert finding.verdict == "bad"
    assert finding.do.startswith(do)
    assert finding.says.startswith(f"ann may not read and write /dev/ttyUSB0, which is of group {owner.group}")
