"""`benchctl compare`: compare a recording with its simulations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.candidates import recordings
from benchctl.cli.output import JsonOption, QuietOption, out_option, result_of, toml_option


def compare(
    simulated: Annotated[
        Path,
        typer.Argument(
            metavar="SIMULATED",
            autocompletion=recordings,
            help="A simulated recording; or, if alone, a recording with its model.",
        ),
    ],
    real: Annotated[
        Path | None,
        typer.Argument(metavar="REAL", autocompletion=recordings, help="A recording of the same procedure."),
    ] = None,
    model: Annotated[
        Path | None, toml_option("--model", "A second model to compare with, for example from a diagnosis.")
    ] = None,
    out: Annotated[Path | None, out_option("For the report; default: by the recording.")] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Compare a recording with its simulations: differences per step, and over rate, temperature and time.

    Writes `comparison.html`; with --quiet and --json, without --out, only the JSON.

    Example: `benchctl compare recording.h5 --model recording.diagnosis/model.toml`
    """
    from benchctl.app import compare as app
    from benchctl.cli.output import report_folder
    from benchctl_instruments.errors import UsageError

    with result_of("compare", json_to, quiet) as result:
        folder = report_folder(real or simulated, out, json_to, quiet)
        if real is None:
            compared = app.compare_with_models(simulated, model)
        elif model is None:
            compared = app.compare_recordings(simulated, real)
        else:
            raise UsageError("compare takes two recordings, or one and --model FILE; name one of them")
        result.values |= app.values(compared)
        result.say(app.table(compared))
        if folder is not None:
            result.values["report"] = app.write_compared(compared, folder)
            result.say(f"report: {result.values['report']}")
