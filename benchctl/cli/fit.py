"""`benchctl fit`: fit the calibration of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from benchctl.cli.output import JsonOption, QuietOption, RecordingsArgument, out_option, result_of, toml_option


def fit(
    recordings: RecordingsArgument,
    model: Annotated[
        Path | None,
        toml_option("--model", "The model.toml of a diagnosis: its structures are compensated, too."),
    ] = None,
    out: Annotated[Path | None, out_option("Output folder; default: the folder of the first recording.")] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Fit the two-stage and the joint calibration; write `coefficients.json` and `report.html`.

    Example: `benchctl fit results/20261120-180000_two_stage_SIM-0001`,
    `benchctl fit recording.h5 --model diagnosis/model.toml`
    """
    from benchctl.app import fit as app

    with result_of("fit", json_to, quiet) as result:
        folder = out or (recordings[0] if recordings[0].is_dir() else recordings[0].parent)
        fitted = app.fit(recordings, out=folder, model=model)
        result.values |= {**fitted.files, **fitted.values}
        result.say(fitted.says)
        result.say_files(fitted.files)
