"""`benchctl allan`: compute the Allan deviation of a channel, or of a column of a text file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.candidates import recordings
from benchctl.cli.output import JsonOption, QuietOption, out_option, quantity_in, result_of

_TEXTS = (".csv", ".txt", ".dat", ".gz")


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
    import math

    from benchctl.cli.output import report_folder
    from benchctl.metrology.series import series_of_step, series_of_text
    from benchctl.recordings.campaign_manifest import add_to_manifest
    from benchctl.recordings.reader import open_recording
    from benchctl.reports.results import name_of
    from benchctl_instruments.errors import UsageError

    with result_of("allan", json_to, quiet) as result:
        if rate_hz is not None and not 0.0 < rate_hz < math.inf:
            raise UsageError(f"--rate-hz {rate_hz:g}: expected samples a second, a positive number")
        if scale_v_per_dps is not None and not 0.0 < abs(scale_v_per_dps) < math.inf:
            raise UsageError(f"--scale-v-per-dps {scale_v_per_dps:g}: expected volts for a degree a second, not 0")
        folder = report_folder(source, out, json_to, quiet, kind="allan")
        if source.suffix.lower() in _TEXTS:
            if step is not None or scale_v_per_dps is not None:
                raise UsageError(
                    "--step and --scale-v-per-dps are for recordings, a text file has neither; leave them out"
                )
            series = series_of_text(source, channel, rate_hz)
        elif rate_hz is not None:
            raise UsageError("--rate-hz is for text files, a recording knows when each sample was taken; leave it out")
        else:
            with open_recording(source) as recording:
                series = series_of_step(recording, channel, step, scale_v_per_dps)
        # Imported only now, so that unusable input is refused without delay.
        from benchctl.metrology.allan import analysed
        from benchctl.reports import allan_report

        found = analysed(series)
        result.values |= allan_report.values(found)
        result.say(allan_report.lines(found))
        if folder is not None:
            report, table = allan_report.write_report(found, folder, name_of(source))
            add_to_manifest(folder, [report, table])
            result.values |= {"report": report, "table": table}
            result.say(f"report: {report}")
