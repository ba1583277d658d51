"""`benchctl export`: export a recording, or the compensation of its unit, for other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.candidates import recordings
from benchctl.cli.output import JsonOption, QuietOption, path_next_to, result_of


class Format(StrEnum):
    """Export formats of a recording, or of the coefficients fitted to it."""

    csv = "csv"
    mat = "mat"
    netcdf = "netcdf"
    open = "open"
    c_header = "c-header"
    json = "json"


_ENDINGS = {
    Format.csv: "_csv",
    Format.mat: ".mat",
    Format.netcdf: ".nc",
    Format.open: "_open",
    Format.c_header: "_compensation.h",
    Format.json: "_compensation.json",
}
_FOLDERS = (Format.csv, Format.open)
_OF_COEFFICIENTS = (Format.c_header, Format.json)


def export(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING",
            autocompletion=recordings,
            help="A recording, a campaign's folder, or an open recording's; for c-header and json also coefficients.",
        ),
    ],
    to: Annotated[
        Format,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="csv and open make a folder, the others a file; c-header and json: compensation.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="PATH", help="Output; default: the recording's name with another ending."
        ),
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Export a recording: one CSV per step, a MAT file, netCDF-4, or an open recording; or the unit's compensation.

    c-header and json export the coefficients that benchctl fit wrote next to the recording: as a C99 header for
    firmware, with a self-test, or as JSON.

    Example: `benchctl export recording.h5 --to open -o for_the_other_lab`,
    `benchctl export coefficients.json --to c-header -o gyro_compensation.h`
    """
    from benchctl.atomic import refuse_existing, refuse_folder
    from benchctl.cli.terminal import working
    from benchctl.recordings.campaign_manifest import add_to_manifest

    with result_of("export", json_to, quiet) as result:
        target = output or path_next_to(source, _ENDINGS[to])
        if to not in _FOLDERS:
            refuse_folder(target)
        if to in _OF_COEFFICIENTS:
            refuse_existing(target)
            _export_compensation(source, to, target)
        else:
            with working(f"exporting {source}", quiet):
                _export_recording(source, to, target)
        add_to_manifest(target.parent, target.rglob("*") if target.is_dir() else [target])
        result.values["output"] = target
        result.say(f"wrote {target}")


def _export_recording(source: Path, to: Format, target: Path) -> None:
    from benchctl.recordings.exporting import EXPORTERS
    from benchctl.recordings.reader import open_recording

    with open_recording(source) as opened:
        EXPORTERS[to.value](opened, target)


def _export_compensation(source: Path, to: Format, target: Path) -> None:
    from benchctl.app.compensate import own_compensation
    from benchctl.calibration.c_header import export_c_header
    from benchctl.calibration.compensating import export_json

    write = export_c_header if to is Format.c_header else export_json
    write(own_compensation(source), target)
