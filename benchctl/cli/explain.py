"""`benchctl explain`: built-in help on effects, metrics and terms."""

from __future__ import annotations

from typing import Annotated

import typer

from benchctl.cli.output import JsonOption, QuietOption, result_of


def explain(
    term: Annotated[
        list[str] | None, typer.Argument(metavar="[TERM]", help="An effect, a metric or a term, in any spelling.")
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Explain an effect, a metric or a term: text, equation, parameters, sources; without a term, list all.

    Example: `benchctl explain thermal_lag`, `benchctl explain "scale factor"`
    """
    import shutil

    from benchctl.explain.book import explained, find, grouped
    from benchctl.explain.terminal import listing, page

    columns = shutil.get_terminal_size((88, 24)).columns
    with result_of("explain", json_to, quiet) as result:
        if not term:
            groups = grouped()
            result.values["terms"] = [{"name": one.name, "group": group} for group in groups for one in groups[group]]
            result.say(listing(groups, columns))
            return
        name = " ".join(term)
        result.values |= explained(name)
        result.say("\n\n".join(page(one, columns) for one in find(name)))
