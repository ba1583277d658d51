"""`benchctl fleet`: fit, diagnose or accept many recordings, on a cluster or on this machine's cores."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from benchctl.cli.accept import LanguageOption
from benchctl.cli.candidates import recordings
from benchctl.cli.messages import tell
from benchctl.cli.output import JsonOption, QuietOption, Result, out_option, result_of, toml_option

if TYPE_CHECKING:
    from benchctl.diagnosis.result import Part
    from benchctl.fleet.job import Job, JobOutcome, Options
    from benchctl.reports.fleet_facts import Fleet
    from benchctl.reports.fleet_stated import FleetVerb

_STOPPED = 130


_GlobsArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="GLOB",
        autocompletion=recordings,
        help="Paths of recordings, patterns in quotes such as 'results/**', or URLs such as s3://lab/SN-*.h5.",
    ),
]
_SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler", metavar="ADDRESS", help="A Dask scheduler's, tcp://host:8786; default: this machine's cores."
    ),
]
_WorkersOption = Annotated[
    int | None, typer.Option("--workers", metavar="N", min=1, help="Processes on this machine; default: its cores.")
]
_OutOption = Annotated[str | None, out_option("Folder or URL of all results; default: the folder of each recording.")]
_ReportOption = Annotated[
    Path | None, typer.Option("--report", metavar="DIR", help="For fleet.html and fleet.json; default: --out, or here.")
]
_AgainOption = Annotated[bool, typer.Option("--again", help="Also process what is done already and has not changed.")]


def fleet() -> None:
    """Fit, diagnose or accept many recordings, on a Dask cluster or on this machine's cores, and compare the units.

    Results are written where the single verb writes them: into the campaign's folder, or for any other recording into
    NAME.fit, NAME.diagnosis or NAME.acceptance next to it. A recording that fails is reported and does not stop the
    others. Repeating the command processes only recordings whose result is missing or out of date. If a worker is
    killed, its recording is processed again; Ctrl-C keeps the completed results. Writes `fleet.html` and `fleet.json`:
    the distribution of each figure over the units, outliers, recurring physics, and failed tests. Exit status 0 if all
    were processed (and, for accept, all pass), 1 if some do not pass, 2 if some could not be processed, 130 if
    stopped. Needs `pip install 'benchctl[cluster]'`.

    Example: `benchctl fleet fit 'results/**'`,
    `benchctl fleet accept results/* --limits lab/limits.toml --scheduler tcp://lab-server:8786`
    """


def fit(
    globs: _GlobsArgument,
    scheduler: _SchedulerOption = None,
    workers: _WorkersOption = None,
    out: _OutOption = None,
    report: _ReportOption = None,
    again: _AgainOption = False,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Fit the calibration of many recordings, and compare the units.

    Example: `benchctl fleet fit 'results/**'`
    """
    with result_of("fleet", json_to, quiet) as result:
        _run(result, "fit", globs, _options(), scheduler, workers, out, report, again)


def diagnose(
    globs: _GlobsArgument,
    model: Annotated[
        Path | None, toml_option("--model", "The lab's model of the part; default: each recording's own.")
    ] = None,
    part: Annotated[
        Literal["gyro", "drive", "chamber"] | None,
        typer.Option(help="The part of the bench; default: that of each recording."),
    ] = None,
    seed: Annotated[
        int,
        typer.Option("--seed", metavar="N", min=0, help="Seed of the simulated recordings without missing physics."),
    ] = 0,
    scheduler: _SchedulerOption = None,
    workers: _WorkersOption = None,
    out: _OutOption = None,
    report: _ReportOption = None,
    again: _AgainOption = False,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Diagnose many recordings, and list the physics that recurs.

    Example: `benchctl fleet diagnose 'results/**' --workers 2`
    """
    with result_of("fleet", json_to, quiet) as result:
        options = _options(model=model, part=part, seed=seed)
        _run(result, "diagnose", globs, options, scheduler, workers, out, report, again)


def accept(
    globs: _GlobsArgument,
    limits: Annotated[Path, toml_option("--limits", "The limits, as TOML; `benchctl init` writes an example.")],
    lang: LanguageOption = "en",
    scheduler: _SchedulerOption = None,
    workers: _WorkersOption = None,
    out: _OutOption = None,
    report: _ReportOption = None,
    again: _AgainOption = False,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Judge the tests of many gyros by limits, and list those that do not pass.

    Example: `benchctl fleet accept results/* --limits lab/limits.toml --scheduler tcp://lab-server:8786`
    """
    with result_of("fleet", json_to, quiet) as result:
        _run(result, "accept", globs, _options(limits, lang), scheduler, workers, out, report, again)


COMMANDS = (fit, diagnose, accept)


def _run(
    result: Result,
    verb: FleetVerb,
    globs: list[str],
    options: Options,
    scheduler: str | None,
    workers: int | None,
    out: str | None,
    report: Path | None,
    again: bool,
) -> None:
    from benchctl.campaign.stop import stop_on_signals
    from benchctl.fleet.cluster import Settings, run_fleet
    from benchctl.fleet.located import located
    from benchctl.reports.fleet_facts import fleet_values, lines, write_fleet_file
    from benchctl.reports.fleet_page import write_fleet_page
    from benchctl.reports.results import make_folder
    from benchctl_instruments.errors import UsageError

    def say(text: str) -> None:
        tell(f"benchctl: {text}", err=True)

    if scheduler is not None and workers is not None:
        raise UsageError("--workers: is for this machine; the workers at --scheduler are started there")
    place = _folder(out)
    folder = report or (Path(place) if place and "://" not in place else Path())
    make_folder(folder)  # before any work
    found, others = located(globs)
    if others:
        result.say(f"no recordings, left out: {_some(others)}")
    settings = Settings(scheduler=scheduler, workers=workers, out=place, again=again)
    with stop_on_signals() as stop, _progress(verb, len(found), result.quiet) as on_outcome:
        ended = run_fleet(verb, found, options, settings, on_outcome, say, stop)
    written = {"report": write_fleet_page(ended, folder), "summary": folder / "fleet.json"}
    write_fleet_file(written["summary"], ended)
    result.values |= {**fleet_values(ended), **written}
    for line in lines(ended):
        result.say(line)
    result.say_files(written)
    _judge(ended, bool(stop.reason), result)


def _options(
    limits: Path | None = None,
    language: str = "en",
    model: Path | None = None,
    part: Part | None = None,
    seed: int = 0,
) -> Options:
    """Return the options of a verb; raise `UsageError` for unusable files."""
    from benchctl.fleet.job import Options
    from benchctl.metrology.limit_file import read_limits
    from benchctl.model_file import read_model

    if model is not None:
        read_model(model)  # an unusable model is refused here, not once per recording
    return Options(
        limits=None if limits is None else read_limits(limits),
        language=language,
        model=None if model is None else (model.name, model.read_text(encoding="utf-8")),
        part=part,
        seed=seed,
    )


def _folder(out: str | None) -> str | None:
    """Return `--out` as an absolute path, since workers have another working directory; create a local folder."""
    from benchctl.fleet.located import is_url
    from benchctl.reports.results import make_folder

    if out is None or is_url(out):
        return out
    make_folder(Path(out))
    return str(Path(out).absolute())


def _some(names: list[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def _judge(ended: Fleet, stopped: bool, result: Result) -> None:
    """Raise the error or exit status unless all recordings were processed and pass.

    Recordings remain if the command was stopped or the scheduler is gone.
    """
    from benchctl_instruments.errors import UsageError

    failed, rejected = ended.ended("failed"), len(ended.rejected)
    if ended.left:
        why = "stopped" if stopped else "the scheduler is gone,"
        result.ok, result.error = False, f"{why} with {ended.left} left; the same command goes on"
        raise typer.Exit(_STOPPED if stopped else UsageError.exit_status)
    of_all = f"of {len(ended.members)} recordings"
    if failed:
        raise UsageError(f"{of_all} {len(failed)} could not be done, the first: {failed[0].reason}")
    if rejected:
        result.fail(f"{of_all} {rejected} do not pass")


@contextmanager
def _progress(verb: str, total: int, quiet: bool) -> Iterator[Callable[[Job, JobOutcome], None]]:
    """Show a progress bar at a terminal: number done, failed and remaining, and the remaining time."""
    import time

    from benchctl.cli.messages import duration
    from benchctl.cli.terminal import progress_bar

    counts = {"done": 0, "kept": 0, "failed": 0}
    with progress_bar(f"fleet {verb}", quiet) as draw:
        begun_s = time.monotonic()

        def tell_of(_: Job, outcome: JobOutcome) -> None:
            counts[outcome.state] += 1
            if draw is None:
                return
            left = total - sum(counts.values())
            worked = counts["done"] + counts["failed"]
            rest_s = (time.monotonic() - begun_s) * left / worked if worked else 0.0
            rest = f", {duration(rest_s)} to go" if worked and left else ""
            remark = f"{counts['done'] + counts['kept']} done, {counts['failed']} failed, {left} left{rest}"
            draw(f"fleet {verb}", 1.0 - left / total, remark)

        yield tell_of
