"""`benchctl import`: convert a foreign recording into a recording of benchctl."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.output import JsonOption, QuietOption, result_of, toml_option


def further_help() -> str:
    """Return an example map file for each kind of source."""
    from benchctl.recordings.map_examples import MAP_EXAMPLES

    return "\n\n".join(f"A map for {title}:\n\n```toml\n{text}```" for title, text in MAP_EXAMPLES.items())


def import_(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", help="An open recording's folder; text, MAT, JSON or SQLite.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.h5", help="The recording to write.")],
    map_file: Annotated[
        Path | None, toml_option("--map", "A TOML file that assigns the columns, explained below.")
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Convert a recording from another bench into a benchctl recording; an incomplete file is never left behind.

    No map is needed for an open recording (`recording.json` and `samples.csv.gz`), nor for a CSV of static points with
    the columns `rate_dps` and `gyro_v_mean`.

    Example: `benchctl import from_the_other_lab -o theirs.h5`, `benchctl import log.csv --map map.toml -o theirs.h5`
    """
    from benchctl.atomic import refuse_existing
    from benchctl.recordings.importing import import_recording

    with result_of("import", json_to, quiet) as result:
        refuse_existing(output)
        made = import_recording(source, map_file, output)
        result.values |= {
            "recording": made.output,
            "steps": made.steps,
            "samples": made.samples,
            "treatment": made.treatment,
        }
        result.say(f"{made.output}: {made.steps} step{'' if made.steps == 1 else 's'}, {made.samples:,} samples")
        if made.treatment:
            result.say(made.treatment)
