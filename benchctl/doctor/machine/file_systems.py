"""Which file system a folder lies on, as Linux tells it in `/proc/self/mountinfo`."""

from __future__ import annotations

import os
import re
from pathlib import Path

MOUNTS = Path("/proc/self/mountinfo")

_NETWORK = frozenset(
    {"9p", "afs", "beegfs", "ceph", "cifs", "davfs", "glusterfs", "lustre", "ncpfs", "nfs", "nfs4", "smb3", "smbfs"}
)
_NETWORK_HELPERS = ("fuse.sshfs", "fuse.glusterfs", "fuse.ceph", "fuse.davfs", "fuse.rclone", "fuse.s3fs", "fuse.smb")
_MEMORY = frozenset({"tmpfs", "ramfs"})
_OCTAL = re.compile(r"\\([0-7]{3})")


def file_system_of(folder: Path, mounts: Path = MOUNTS) -> tuple[str, str]:
    """Kind and device of the file system that holds a folder; empty where the system does not say."""
    try:
        lines = mounts.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return "", ""
    place = os.path.realpath(folder)
    found: tuple[int, str, str] = (-1, "", "")
    for line in lines:
        before, dash, after = line.partition(" - ")
        fields, kinds = before.split(), after.split()
        if not dash or len(fields) < 5 or len(kinds) < 2:
            continue
        point = _OCTAL.sub(lambda code: chr(int(code[1], 8)), fields[4])
        beneath = place == point or place.startswith(point.rstrip("/") + "/")
        if beneath and len(point) >= found[0]:  # of two mounts in one place the later one is seen
            found = (len(point), kinds[0], kinds[1])
    return found[1], found[2]


def on_the_network(kind: str) -> bool:
    """Whether it keeps its files on another machine."""
    return kind in _NETWORK or kind.startswith(_NETWORK_HELPERS)


def keeps_nothing(kind: str) -> bool:
    """Whether its files are in memory only."""
    return kind in _MEMORY
