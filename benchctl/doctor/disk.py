"""Check the results folder: write permission, free space, file system, locks, HDF5 reading during writing."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import psutil

from benchctl.atomic import free_bytes
from benchctl.bench import Bench
from benchctl.campaign.reserved import lock_folder, make_lock_folder
from benchctl.campaign.timing import disk_bytes
from benchctl.doctor.finding import Finding, bad, look, ok
from benchctl.locks import Lock, is_held
from benchctl.plan.find import find_procedure
from benchctl_instruments.errors import UsageError

RESULTS = "results"
_LONGEST_PROCEDURE = "acceptance"
_LITTLE_BYTES = 10**9
_READER_LIMIT_S = 30.0
_SAMPLES = 1000
_NETWORK = frozenset(
    {"9p", "afs", "beegfs", "ceph", "cifs", "davfs", "glusterfs", "lustre", "ncpfs", "nfs", "nfs4", "smb3", "smbfs"}
)
_NETWORK_HELPERS = ("fuse.sshfs", "fuse.glusterfs", "fuse.ceph", "fuse.davfs", "fuse.rclone", "fuse.s3fs", "fuse.smb")
_MEMORY = frozenset({"tmpfs", "ramfs"})
_READER = """
import sys
from pathlib import Path
from benchctl.recordings.opening import open_growing
with open_growing(Path(sys.argv[1])) as file:
    print(len(file["samples"]))
"""


def disk_findings(folder: Path, bench: Bench) -> Iterator[Finding]:
    """Check a results folder, which need not exist yet; trial files are removed again."""
    yield from _of_campaigns(folder, bench)
    yield _instrument_locks()


def _of_campaigns(folder: Path, bench: Bench) -> Iterator[Finding]:
    place = _existing_parent(folder)
    made = "" if place == folder.absolute() else f" (created in {place} with the first campaign)"
    try:
        trial = tempfile.TemporaryDirectory(prefix=".benchctl-doctor-", dir=place)
    except OSError as err:
        yield bad(
            RESULTS,
            "folder",
            f"{folder.absolute()}{made}: cannot be written: {err.strerror or err}",
            f"take the folder over (sudo chown -R $USER {place}) or name another one with --out DIR",
            unusable=True,
        )
        return
    with trial as name:
        yield ok(RESULTS, "folder", f"{folder.absolute()}{made}: writable")
        yield room_finding(place, bench)
        yield file_system_finding(place)
        yield locks_finding(Path(name))
        yield growing_file_finding(Path(name))


def room_finding(place: Path, bench: Bench) -> Finding:
    """Compare the free space with what the longest procedure records."""
    free = free_bytes(place)
    try:
        needs = disk_bytes(find_procedure(_LONGEST_PROCEDURE).expand({}), bench.recorded_hz)
    except UsageError:  # benchctl runs from a folder and is not installed, so that procedures have no names
        needs = _LITTLE_BYTES
    message = f"{free / 1e9:.1f} GB are free; {_LONGEST_PROCEDURE}, the longest procedure, records {needs / 1e9:.1f} GB"
    if free == 0:
        return bad(RESULTS, "room", f"the disk of {place} is full", "make room, or use another disk", unusable=True)
    if free < needs:
        return look(
            RESULTS, "room", message, "make room, or record less: benchctl check PROCEDURE shows how much it takes"
        )
    return ok(RESULTS, "room", message)


def locks_finding(folder: Path) -> Finding:
    """Check that a lock in that folder excludes others."""
    path = folder / "trial.lock"
    lock = Lock(path, "the trial")
    do = "name a folder on a local disk with --out DIR: without locks two programs may write one campaign"
    try:
        lock.acquire("benchctl doctor")
    except UsageError as err:
        return bad(RESULTS, "locks", str(err), do, unusable=True)
    try:
        if is_held(path):
            return ok(RESULTS, "locks", "a trial lock excludes others")
        return bad(RESULTS, "locks", "a trial lock does not exclude others", do, unusable=True)
    finally:
        lock.release()


def growing_file_finding(folder: Path) -> Finding:
    """Check that another process reads an HDF5 file (SWMR) while it is written, as the live page does."""
    import numpy as np

    from benchctl.recordings.opening import create_hdf5  # a broken h5py must not hide the other findings

    path = folder / "trial.h5"
    do = "name a folder on a local disk with --out DIR"
    try:
        with create_hdf5(path, growing=True) as file:
            samples = file.create_dataset("samples", (0,), maxshape=(None,), dtype="f8", chunks=(_SAMPLES,))
            file.swmr_mode = True
            samples.resize((_SAMPLES,))
            samples[:] = np.arange(_SAMPLES)
            samples.flush()
            reader = subprocess.run(  # noqa: S603 - this Python, and the lines above
                [sys.executable, "-c", _READER, str(path)],
                capture_output=True,
                text=True,
                timeout=_READER_LIMIT_S,
            )
    except (OSError, RuntimeError, subprocess.TimeoutExpired) as err:
        message = f"an HDF5 file cannot be written and read at once: {' '.join(str(err).split())}"
        return bad(RESULTS, "HDF5", message, do, unusable=True)
    if reader.stdout.strip() == str(_SAMPLES):
        return ok(RESULTS, "HDF5", "another process reads a file while it is written (SWMR)")
    reason = (reader.stderr.strip().splitlines() or [f"{reader.stdout.strip() or 0} samples of {_SAMPLES}"])[-1]
    return bad(RESULTS, "HDF5", f"a file that is being written cannot be read (SWMR): {reason}", do, unusable=True)


def file_system_finding(place: Path, mounted: Iterable[tuple[str, str, str]] | None = None) -> Finding:
    """Warn of file systems that lose data or locks; `mounted` is (device, mount point, kind), from psutil if None."""
    if mounted is None:
        mounted = [(each.device, each.mountpoint, each.fstype) for each in psutil.disk_partitions(all=True)]
    real = Path(os.path.realpath(place))
    # Of two mounts at the same point, the later one is effective.
    found = max(
        (
            (len(point), at, kind, device)
            for at, (device, point, kind) in enumerate(mounted)
            if real.is_relative_to(point)
        ),
        default=None,
    )
    if found is None:
        return ok(RESULTS, "file system", "the system does not report its kind")
    *_, kind, device = found
    message = f"{kind} on {device}"
    if kind in _NETWORK or kind.startswith(_NETWORK_HELPERS):
        return look(
            RESULTS,
            "file system",
            f"{message}: on the network, where locks and growing files are not reliable",
            "record to a local disk with --out DIR, and copy the campaign when it is complete",
        )
    if kind in _MEMORY:
        return look(
            RESULTS,
            "file system",
            f"{message}: in memory, lost when this machine or container ends",
            "record to a disk with --out DIR",
        )
    return ok(RESULTS, "file system", message)


def _instrument_locks() -> Finding:
    try:
        folder = make_lock_folder()
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, UsageError) as err:
        message = f"{lock_folder()}: cannot be written: {err}"
        return bad(RESULTS, "locks of instruments", message, "remove it: benchctl creates it again", unusable=True)
    return ok(RESULTS, "locks of instruments", f"in {folder}: valid on this machine only")


def _existing_parent(folder: Path) -> Path:
    place = folder.absolute()
    while place != place.parent:
        try:
            place.stat()
            break
        except FileNotFoundError:
            place = place.parent
        except OSError:  # the attempt to write reports the reason
            break
    return place
