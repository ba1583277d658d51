"""The formats to which a recording can be exported."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from benchctl.recordings.export_csv import export_csv
from benchctl.recordings.export_mat import export_mat
from benchctl.recordings.export_open import export_open
from benchctl.recordings.reader import Recording
from benchctl.recordings.writer import write_recording


def export_netcdf(recording: Recording, path: Path) -> None:
    """Write a netCDF-4 file with a group a step: `xarray.open_dataset(path, group="steps/0001")`.

    Every recording of ours already is such a file; this makes one of anything that opens, under a name that tools for
    netCDF know.
    """
    write_recording(path, recording.meta, recording.steps())


EXPORTERS: Mapping[str, Callable[[Recording, Path], None]] = {
    "csv": export_csv,
    "mat": export_mat,
    "netcdf": export_netcdf,
    "open": export_open,
}
"""Format -> what writes it; `csv` and `open` make a folder, `mat` and `netcdf` a file."""
