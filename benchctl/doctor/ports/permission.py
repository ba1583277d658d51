"""Whether this user may read and write a port; and if not, the very command that lets him."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from benchctl.doctor.finding import Finding, bad

_ROOT_GROUP = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Owner:
    """Whose a device is: its group by number and name, and whether that group may read and write it."""

    gid: int
    group: str
    group_may: bool


def permission_finding(role: str, device: str) -> Finding | None:
    """What keeps this user from a port; None where nothing does."""
    if os.access(device, os.R_OK | os.W_OK) or sys.platform == "win32":
        return None
    import grp
    import pwd

    status = os.stat(device)
    try:
        group = grp.getgrgid(status.st_gid).gr_name
    except KeyError:
        group = str(status.st_gid)
    try:
        user = pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        user = str(os.geteuid())
    may = bool(status.st_mode & stat.S_IRGRP and status.st_mode & stat.S_IWGRP)
    owner = Owner(gid=status.st_gid, group=group, group_may=may)
    try:
        entered = user in grp.getgrgid(status.st_gid).gr_mem
    except KeyError:
        entered = False
    return refused_finding(role, device, owner, user, os.getgroups(), entered=entered)


def refused_finding(
    role: str, device: str, owner: Owner, user: str, groups: Sequence[int], *, entered: bool
) -> Finding:
    """The finding on a port that a user may not use.

    `groups` are those of the session; `entered`: by the system's files the user is in the port's.
    """
    says = f"{user} may not read and write {device}, which is of group {owner.group}"
    if not owner.group_may or owner.gid == _ROOT_GROUP:
        do = (
            f'a udev rule, SUBSYSTEM=="tty", KERNEL=="{os.path.basename(device)}", GROUP="dialout", MODE="0660", and: '
            f"sudo usermod -a -G dialout {user}, then log in anew"
        )
        return bad(role, "permission", f"{says}, and that group is not for users", do)
    if entered and owner.gid not in groups:
        do = f"log out and in again (in this terminal only: newgrp {owner.group})"
        return bad(role, "permission", f"{says}; {user} is in it, but this session began before that", do)
    do = f"sudo usermod -a -G {owner.group} {user}, then log out and in again"
    return bad(role, "permission", says, do)
