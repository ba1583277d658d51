"""`benchctl accept`: judge the tests of a gyro by limits."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from benchctl.cli.output import JsonOption, QuietOption, RecordingArgument, out_option, result_of, toml_option

LanguageOption = Annotated[Literal["en", "ru"], typer.Option("--lang", help="Language of the report.")]


def accept(
    recording: RecordingArgument,
    limits: Annotated[Path, toml_option("--limits", "The limits, as TOML; `benchctl init` writes an example.")],
    out: Annotated[Path | None, out_option("For the report; default: in the campaign's folder.")] = None,
    lang: LanguageOption = "en",
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Measure the gyro's characteristics from the recording, judge them by limits, and write the report.

    Each verdict is PASS, FAIL or INCONCLUSIVE, with expanded uncertainty (95.45 %) and guard band. Writes
    `acceptance.html`, `.pdf`, `.xml` (JUnit) and `.json`. Exit status 1 unless every test with a limit passes.

    Example: `benchctl accept results/20261120-180000_acceptance_SIM-0001 --limits lab/limits.toml`
    """
    from benchctl.app import accept as app
    from benchctl.cli.output import report_folder

    with result_of("accept", json_to, quiet) as result:
        folder = report_folder(recording, out, json_to, quiet=False, kind="acceptance")  # QA always needs the report
        found = app.accept(recording, limits, language=lang)
        result.values |= found.values()
        result.say(str(found))
        if folder is not None:
            files = found.write(folder).files
            result.values |= files
            result.say_files(files)
        if found.fails:
            result.ok, result.error = False, found.fails
            raise typer.Exit(1)
