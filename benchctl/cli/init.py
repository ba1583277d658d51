"""`benchctl init`: a bench.toml to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.output import JsonOption, QuietOption, result_of


def init(
    folder: Annotated[Path, typer.Argument(metavar="[DIR]", help="Where to write it.")] = Path(),
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Write a commented bench.toml to start from.

    Example: `benchctl init lab && benchctl check two_stage --bench lab/bench.toml`
    """
    from benchctl.bench import template
    from instruments.errors import UsageError

    with result_of("init", json_to, quiet) as result:
        path = folder / "bench.toml"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as err:
            raise UsageError(f"{folder}: cannot be made into a folder: {err.strerror or err}") from err
        try:
            with path.open("x", encoding="utf-8") as file:
                file.write(template())
        except FileExistsError as err:
            raise UsageError(f"{path}: is there already and is left as it is; name another folder") from err
        except OSError as err:
            raise UsageError(f"{path}: cannot be written: {err.strerror or err}") from err
        result.values["bench"] = path
        result.say(f"wrote {path}: simulated as it stands; set simulated = false and the addresses for a real bench")
