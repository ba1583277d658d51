"""The folder in which campaigns land: may it be written to, has it room, locks, and HDF5 that can be read meanwhile."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchctl.atomic import free_bytes
from benchctl.bench import Bench
from benchctl.campaign.reserved import lock_folder, make_lock_folder
from benchctl.campaign.timing import disk_bytes
from benchctl.doctor.finding import Finding, bad, look, ok
from benchctl.doctor.machine.file_systems import file_system_of, keeps_nothing, on_the_network
from benchctl.locks import Lock, is_held
from benchctl.plan.find import find_procedure
from benchctl_instruments.errors import UsageError

RESULTS = "results"
_LONGEST_PROCEDURE = "acceptance"
_LITTLE_BYTES = 10**9
_READER_LIMIT_S = 30.0
_SAMPLES = 1000
_READER = """
import sys
from pathlib import Path
from benchctl.recordings.opening import open_growing
with open_growing(Path(sys.argv[1])) as file:
    print(len(file["samples"]))
"""


def folder_findings(folder: Path, bench: Bench) -> Iterator[Finding]:
    """All of a results folder, which need not be there yet; what is tried is removed again."""
    yield from _of_campaigns(folder, bench)
    yield _instrument_locks()


def _of_campaigns(folder: Path, bench: Bench) -> Iterator[Finding]:
    place = _that_is_there(folder)
    made = "" if place == folder.absolute() else f" (made in {place} when the first campaign begins)"
    try:
        trial = tempfile.TemporaryDirectory(prefix=".benchctl-doctor-", dir=place)
    except OSError as err:
        yield bad(
            RESULTS,
            "folder",
            f"{folder.absolute()}{made}: may not be written to: {err.strerror or err}",
            f"take the folder over (sudo chown -R $USER {place}) or name another one with --out DIR",
            unusable=True,
        )
        return
    with trial as name:
        yield ok(RESULTS, "folder", f"{folder.absolute()}{made}: may be written to")
        yield room_finding(place, bench)
        yield _file_system(place)
        yield locks_finding(Path(name))
        yield growing_file_finding(Path(name))


def room_finding(place: Path, bench: Bench) -> Finding:
    """Whether the longest campaign has room."""
    free = free_bytes(place)
    try:
        needs = disk_bytes(find_procedure(_LONGEST_PROCEDURE).expand({}), bench.recorded_hz)
    except UsageError:  # not installed, so that it has no name: the software's findings say so
        needs = _LITTLE_BYTES
    says = f"{free / 1e9:.1f} GB are free; {_LONGEST_PROCEDURE}, the longest procedure, records {needs / 1e9:.1f} GB"
    if free == 0:
        return bad(RESULTS, "room", f"the disk of {place} is full", "make room, or use another disk", unusable=True)
    if free < needs:
        return look(RESULTS, "room", says, "make room, or record less: benchctl check PROCEDURE says how much it takes")
    return ok(RESULTS, "room", says)


def locks_finding(folder: Path) -> Finding:
    """Whether a lock in that folder keeps others out."""
    path = folder / "trial.lock"
    lock = Lock(path, "the trial")
    do = "name a folder on a local disk with --out DIR: without locks two programs may write one campaign"
    try:
        lock.acquire("benchctl doctor")
    except UsageError as err:
        return bad(RESULTS, "locks", str(err), do, unusable=True)
    try:
        if is_held(path):
            return ok(RESULTS, "locks", "a lock was tried, and keeps others out")
        return bad(RESULTS, "locks", "a lock was taken here and keeps nobody out", do, unusable=True)
    finally:
        lock.release()


def growing_file_finding(folder: Path) -> Finding:
    """Whether another process reads an HDF5 file (SWMR) while it is being written, as whoever watches a run does."""
    import numpy as np

    from benchctl.recordings.opening import create_hdf5  # where h5py is broken, the other findings are still told

    path = folder / "trial.h5"
    do = "name a folder on a local disk with --out DIR"
    try:
        with create_hdf5(path, growing=True) as file:
            samples = file.create_dataset("samples", (0,), maxshape=(None,), dtype="f8", chunks=(_SAMPLES,))
            file.swmr_mode = True
            samples.resize((_SAMPLES,))
            samples[:] = np.arange(_SAMPLES)
            samples.flush()
            seen = subprocess.run(  # noqa: S603 - this Python, and the lines above
                [sys.executable, "-c", _READER, str(path)],
                capture_output=True,
                text=True,
                timeout=_READER_LIMIT_S,
            )
    except (OSError, RuntimeError, subprocess.TimeoutExpired) as err:
        says = f"an HDF5 file cannot be written and read at once: {' '.join(str(err).split())}"
        return bad(RESULTS, "HDF5", says, do, unusable=True)
    if seen.stdout.strip() == str(_SAMPLES):
        return ok(RESULTS, "HDF5", "a file was read by another process while it was written (SWMR)")
    told = (seen.stderr.strip().splitlines() or [f"{seen.stdout.strip() or 0} samples of {_SAMPLES}"])[-1]
    return bad(RESULTS, "HDF5", f"a file that is being written cannot be read (SWMR): {told}", do, unusable=True)


def _file_system(place: Path) -> Finding:
    kind, device = file_system_of(place)
    if not kind:
        return ok(RESULTS, "file system", "this system does not say what it is")
    says = f"{kind} on {device}"
    if on_the_network(kind):
        return look(
            RESULTS,
            "file system",
            f"{says}: over a network, where locks and files that grow cannot be relied on",
            "record to a local disk with --out DIR, and copy the campaign when it is complete",
        )
    if keeps_nothing(kind):
        return look(
            RESULTS,
            "file system",
            f"{says}: in memory, gone when this machine or container ends",
            "record to a disk with --out DIR",
        )
    return ok(RESULTS, "file system", says)


def _instrument_locks() -> Finding:
    try:
        folder = make_lock_folder()
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, UsageError) as err:
        says = f"{lock_folder()}: cannot be written: {err}"
        return bad(RESULTS, "locks of instruments", says, "remove it: benchctl makes it again", unusable=True)
    return ok(RESULTS, "locks of instruments", f"in {folder}: known to all programs on this machine, to none on others")


def _that_is_there(folder: Path) -> Path:
    place = folder.absolute()
    while place != place.parent:
        try:
            place.stat()
            break
        except FileNotFoundError:
            place = place.parent
        except OSError:  # who may not even look gets the system's word when he writes
            break
    return place
