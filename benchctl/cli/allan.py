"""`benchctl allan`: compute the Allan deviation of a channel, or of a column of a text file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.candidates import recordings
from benchctl.cli.output import JsonOption, QuietOption, out_option, quantity_in, result_of


def allan(
    source: Annotated[
        Path,
        typer.Argument(metavar="SOURCE", autocompletion=recordings, help="A recording, or a text file with commas."),
    ],
    channel: Annotated[
        str | None,
        typer.Option("--channel", metavar="NAME", help="Channel or column; of a recording by default the gyro."),
    ] = None,
    rate_hz: Annotated[
        float | None,
        typer.Option(
            "--rate-hz",
            metavar="R",
            parser=quantity_in("rate_hz"),
            help="Sample rate of a text file without a time column: 100, or 0.1kHz.",
        ),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option("--step", metavar="NAME", help="Step, by name or number; default: the longest static one."),
    ] = None,
    scale_v_per_dps: Annotated[
        float | None,
        typer.Option(
            "--scale-v-per-dps",
            metavar="K0",
            parser=quantity_in("scale_v_per_dps"),
            help="Scale factor by which gyro_v of a recording is a rate: 0.05, or '50 mV/(deg/s)'.",
        ),
    ] = None,
    out: Annotated[Path | None, out_option("For report and table; default: by the source.")] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Compute the Allan deviation and the noise coefficients with confidence intervals.

    Writes `allan.html` and `allan.csv`; with --quiet and --json, without --out, only the JSON. Q, N, B, K and R are
    reported with 95 % intervals, or refused with a reason if the record does not show their slope.

    Example: `benchctl allan recording.h5`, `benchctl allan rates.csv --channel rate_dps --rate-hz 100`
    """
    from benchctl.app import allan as app
    from benchctl.cli.output import report_folder

    with result_of("allan", json_to, quiet) as result:
        folder = report_folder(source, out, json_to, quiet, kind="allan")
        found = app.allan(source, channel=channel, rate_hz=rate_hz, step=step, scale_v_per_dps=scale_v_per_dps)
        result.values |= found.values()
        result.say(str(found))
        if folder is not None:
            files = found.write(folder).files
            result.values |= files
            result.say(f"report: {files['report']}")
