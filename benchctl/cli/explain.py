"""`benchctl explain`: built-in help on effects, metrics and terms."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.output import JsonOption, QuietOption, result_of


def explain(
    term: Annotated[
        list[str] | None, typer.Argument(metavar="[TERM]", help="An effect, a metric or a term, in any spelling.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", metavar="FILE", help="Also draw a picture: FILE.svg or FILE.png.")
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Explain an effect, a metric or a term: text, equation, parameters, sources; without a term, list all.

    Example: `benchctl explain thermal_lag --picture lag.svg`, `benchctl explain "scale factor"`
    """
    import shutil

    from benchctl.explain.book import explained, find, grouped
    from benchctl.explain.terminal import listing, page
    from benchctl_instruments.errors import UsageError

    columns = shutil.get_terminal_size((88, 24)).columns
    with result_of("explain", json_to, quiet) as result:
        if not term:
            if picture is not None:
                raise UsageError(f"--picture {picture}: expected a term before it, as in benchctl explain thermal_lag")
            groups = grouped()
            result.values["terms"] = [{"name": one.name, "group": group} for group in groups for one in groups[group]]
            result.say(listing(groups, columns))
            return
        name = " ".join(term)
        result.values |= explained(name)
        if picture is not None:
            from benchctl.explain.pictures.drawn import write_picture

            result.values["picture_file"] = str(picture)
            caption = write_picture(name, picture)
        result.say("\n\n".join(page(one, columns) for one in find(name)))
        if picture is not None:
            result.say(f"\npicture: {picture}\n    {caption}")
