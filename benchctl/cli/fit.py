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
    from benchctl.app.fit import fit_recordings
    from benchctl.recordings.campaign_manifest import add_to_manifest

    with result_of("fit", json_to, quiet) as result:
        fitted = fit_recordings(recordings, out, model)
        written = [fitted.values["coefficients"], fitted.values["report"]]
        add_to_manifest(written[0].parent, written)
        result.values |= fitted.values
        result.say(fitted.says)
