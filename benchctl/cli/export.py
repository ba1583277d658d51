"""`benchctl export`: a recording for other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.output import JsonOption, QuietOption, result_of


class Format(StrEnum):
    """What a recording can be exported to."""

    csv = "csv"
    mat = "mat"
    netcdf = "netcdf"
    open = "open"


_ENDINGS = {Format.csv: "_csv", Format.mat: ".mat", Format.netcdf: ".nc", Format.open: "_open"}


def export(
    recording: Annotated[Path, typer.Argument(help="A recording, a campaign's folder, or an open recording's.")],
    to: Annotated[Format, typer.Option("--to", help="csv and open make a folder, mat and netcdf a file.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Where to; default: beside the recording, with an ending.")
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Export a recording: a CSV a step, a MAT file, netCDF-4, or an open recording.

    Example: `benchctl export recording.h5 --to open -o for_the_other_lab`
    """
    from benchctl.recordings.exporting import EXPORTERS
    from benchctl.recordings.reader import open_recording

    with result_of("export", json_to, quiet) as result:
        target = output or recording.with_name(recording.stem + _ENDINGS[to])
        with open_recording(recording) as opened:
            EXPORTERS[to.value](opened, target)
        result.values["output"] = target
        result.say(f"wrote {target}")
