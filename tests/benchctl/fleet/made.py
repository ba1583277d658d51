"""Small recordings for a fleet: tables of static points, imported; each is fitted in a moment."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchctl.campaign.stop import StopRequest
from benchctl.fleet.cluster import Settings, run_fleet
from benchctl.fleet.job import Job, Options
from benchctl.fleet.located import located
from benchctl.fleet.places import place_of
from benchctl.recordings.importing import import_recording
from benchctl.reports.fleet_facts import Fleet


def points(path: Path, seed: int, K0: float = 0.05) -> Path:
    """A recording of static points by the sine law; the parent folder is made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    rate = np.linspace(-200.0, 200.0, 33)
    volts = K0 * np.sin(0.0043 * rate) / 0.0043 + 0.01 + 1e-4 * rng.normal(size=rate.size)
    table = path.with_suffix(".csv")
    rows = [f"{one},{two},1e-4" for one, two in zip(rate, volts, strict=True)]
    table.write_text("\n".join(["rate_dps,gyro_v_mean,gyro_v_std", *rows]) + "\n", encoding="utf-8")
    path.unlink(missing_ok=True)
    import_recording(table, None, path)
    table.unlink()
    return path


def job_of(path: Path | str, *, out: Path | None = None, run: str = "run", again: bool = False) -> Job:
    """The job of fitting one recording."""
    ((recording,), _) = located([str(path)])
    place = place_of(recording, "fit", None if out is None else str(out))
    return Job(verb="fit", recording=recording, place=place, options=Options(), run=run, again=again)


def fitted(folder: Path, scheduler: str, *, again: bool = False) -> Fleet:
    """All recordings of a folder, fitted on a cluster."""
    settings = Settings(scheduler=scheduler, again=again)
    return run_fleet(
        "fit",
        located([f"{folder}/*.h5"])[0],
        Options(),
        settings,
        on_outcome=lambda job, outcome: None,
        say=lambda text: None,
        stop=StopRequest(),
    )
