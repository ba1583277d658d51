"""`benchctl history`: chart the results of units over time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.messages import tell
from benchctl.cli.output import JsonOption, QuietOption, out_option, result_of


def history(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="A folder with campaigns anywhere in it, or a .zip, .tar, .tar.gz.")
    ],
    unit: Annotated[str | None, typer.Option("--unit", metavar="SERIAL", help="Only this unit.")] = None,
    figure: Annotated[
        str | None, typer.Option("--figure", metavar="NAME", help="Only this figure, such as K0_v_per_dps.")
    ] = None,
    all_parameters: Annotated[
        bool, typer.Option("--all-parameters", help="Also compare runs of a procedure with different parameters.")
    ] = False,
    out: Annotated[Path | None, out_option("For the page; default: the folder.")] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Chart the calibration and acceptance results of each unit over time, and compare the units.

    Shows control limits, drift since the last calibration, and outlying units. Runs of one procedure are compared if
    they have the same parameters as the latest run. Writes `history.html`; with --quiet and --json, without --out,
    only the JSON. The results read are cached in `.benchctl-history.sqlite`, which is recreated if it is missing.

    Example: `benchctl history results`
    """
    from contextlib import nullcontext

    from benchctl.cli.output import report_folder
    from benchctl.history.archives import unpacked
    from benchctl.history.history import history_of
    from benchctl.recordings.campaign_manifest import add_to_manifest
    from benchctl.reports import history_page, history_report
    from benchctl_instruments.errors import UsageError

    def say(text: str) -> None:
        tell(f"benchctl: {text}", err=True)

    with result_of("history", json_to, quiet) as result:
        if not folder.exists():
            raise UsageError(f"{folder}: is not there; expected a folder of campaigns, .zip, .tar or .tar.gz")
        page_folder = report_folder(folder, out, json_to, quiet, kind="history")
        archived = not folder.is_dir()
        with unpacked(folder) if archived else nullcontext(folder) as place:
            found = history_of(place, str(folder), say, kept=not archived, all_parameters=all_parameters)
        units = history_report.chosen(found, unit, figure)
        result.values |= history_report.values(found, units)
        result.say(history_report.lines(found, units))
        if page_folder is not None:
            name = folder.resolve().name or str(folder.resolve())
            report = history_page.write_page_of(found, units, page_folder, name)
            add_to_manifest(page_folder, [report])  # if the folder is itself a campaign
            result.values["report"] = report
            result.say(f"report: {report}")
