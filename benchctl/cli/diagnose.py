"""`benchctl diagnose`: find the physics that is missing from the model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from benchctl.cli.output import (
    JsonOption,
    QuietOption,
    RecordingsArgument,
    bench_option,
    out_option,
    result_of,
    toml_option,
)
from benchctl_instruments.errors import UsageError

if TYPE_CHECKING:
    from benchctl.diagnosis.result import Diagnosis


def diagnose(
    recordings: RecordingsArgument,
    model: Annotated[
        Path | None, toml_option("--model", "The lab's model of the part; default: the recording's own.")
    ] = None,
    out: Annotated[
        Path | None, out_option("For the report and the corrected model; default: by the recording.")
    ] = None,
    following: Annotated[
        Path | None, typer.Option("--next", metavar="FILE.py", help="Write the next experiment, for benchctl run.")
    ] = None,
    effect_file: Annotated[
        Path | None,
        typer.Option(
            "--write-effect",
            metavar="FILE.py",
            help="Write a structure without a name as an effect, named after the file; complete its description.",
        ),
    ] = None,
    settle: Annotated[
        bool,
        typer.Option("--settle", help="Run the next experiment on the simulated bench, and diagnose both jointly."),
    ] = False,
    bench: Annotated[
        str | None,
        bench_option("For --settle; default: the recording's own."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="With --settle: show the run and its duration; execute nothing.")
    ] = False,
    part: Annotated[
        Literal["gyro", "drive", "chamber"] | None,
        typer.Option(
            help="The part of the bench: gyro; drive, of angle and torque or current; chamber, of heat and air."
            " Default: gyro if the recording has one."
        ),
    ] = None,
    seed: Annotated[
        int,
        typer.Option("--seed", metavar="N", min=0, help="Seed of the simulated recordings without missing physics."),
    ] = 0,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Find where the recording deviates from the model, which physics is missing, how certain, and what to run next.

    Writes `diagnosis.html`, and `model.toml` for `benchctl simulate --model`; with --quiet and --json, without --out,
    only the JSON.

    Example: `benchctl diagnose results/20261120-180000_diagnostic_SIM-0001`,
    `benchctl diagnose recording.h5 --settle --dry-run`
    """
    from benchctl.app import diagnose as app
    from benchctl.cli.output import report_folder
    from benchctl.cli.terminal import search_progress
    from benchctl.reports.diagnosis_tables import lines
    from benchctl_instruments.errors import UsageError

    with result_of("diagnose", json_to, quiet) as result:
        if following is not None or settle:  # the modules that run campaigns are loaded only if needed
            from benchctl.cli.next_run import bench_of, preview_next, refuse_other_files, run_next, write_next
        if following is not None:
            refuse_other_files(following)
        if effect_file is not None:
            refuse_other_effect_files(effect_file)
        if dry_run and not settle:
            raise UsageError("--dry-run: without --settle nothing is run; leave it out, or say --settle, too")
        folder = report_folder(recordings[0], out, json_to, quiet)
        settling = bench_of(recordings, bench) if settle else None

        def search(paths: list[Path]) -> app.Diagnosed:
            with search_progress(quiet) as progress:
                return app.diagnose(paths, model=model, part=part, seed=seed, progress=progress)

        found = search(recordings)
        if settling is not None and dry_run and found.diagnosis.next_experiment.procedure:
            preview_next(found.diagnosis.next_experiment, settling, result)
        elif settling is not None and found.diagnosis.next_experiment.procedure:
            ran = run_next(found.diagnosis.next_experiment, settling, quiet=quiet)
            result.say(f"next experiment run: {ran}")
            found = search([*recordings, ran])
        elif settle:
            result.say("nothing is left open: no experiment was run")
        result.values |= found.diagnosis.as_json()
        for line in lines(found.diagnosis, found.unit):
            result.say(line)
        if following is not None:
            result.say(write_next(following, found.diagnosis))
        if effect_file is not None:
            result.say(write_effect(effect_file, found.diagnosis))
        if folder is not None:
            result.say_files(found.write(folder).files)


def refuse_other_effect_files(path: Path) -> None:
    """Raise `UsageError` if the file name is no valid effect name, or the effect or the file already exists."""
    from benchctl_instruments.physics.effects.registry import effects

    if path.suffix != ".py" or not path.stem.isidentifier():
        raise UsageError(
            f"--write-effect {path}: the effect is named after the file; expected a name such as mode_hop.py"
        )
    if path.stem in effects():
        raise UsageError(f"--write-effect {path}: there is an effect {path.stem} already; choose another name")
    if path.exists():
        raise UsageError(f"--write-effect {path}: the file exists; choose another name, or remove it")


def write_effect(path: Path, diagnosis: Diagnosis) -> str:
    """Write the largest modelled structure as an effect; return one line that states what to do with the file."""
    from benchctl.atomic import whole_file
    from benchctl.diagnosis.structures.effect_file import WRITTEN, effect_source

    models = [one for one in diagnosis.unexplained.models if one.stage in WRITTEN]
    if not models:
        return f"no structure without a name was modelled that an effect can stand for: {path} is not written"
    with whole_file(path) as temporary:
        temporary.write_text(effect_source(path.stem, models[0]), encoding="utf-8")
    return f"effect {path.stem}: {path}; complete its words and add it to the entry points benchctl.effects"
