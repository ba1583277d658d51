"""`benchctl apply`: write the compensated rate of a recording to a separate file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from benchctl.cli.output import JsonOption, QuietOption, RecordingArgument, path_next_to, result_of


def apply(
    recording: RecordingArgument,
    coefficients: Annotated[
        Path, typer.Option("--coefficients", metavar="FILE", help="The coefficients.json that benchctl fit wrote.")
    ],
    law: Annotated[
        Literal["joint", "stages"] | None, typer.Option("--law", help="Default: the joint fit, if there is one.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE.h5", help="Default: NAME_compensated.h5 in the same folder."),
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Compensate a recording: write a copy with the compensated rate in an additional channel, `compensated_dps`.

    A second channel, `compensated_valid`, is 1 where rate and temperature are in the range in which the coefficients
    were measured. Of a unit of three axes, the channels are `frame_compensated_x_dps`, `frame_compensated_y_dps`,
    `frame_compensated_z_dps` and `frame_compensated_valid`. The original recording is not changed.

    Example: `benchctl apply recording.h5 --coefficients coefficients.json`
    """
    from benchctl.app.compensate import compensate
    from benchctl.cli.terminal import working

    with result_of("apply", json_to, quiet) as result:
        target = output or path_next_to(recording, "_compensated.h5")
        with working(f"compensating {recording}", quiet):
            found = compensate(recording, coefficients, target, law=law)
        result.values |= found.values()
        result.say(str(found))
