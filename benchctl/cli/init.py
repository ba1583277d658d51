"""`benchctl init`: a bench.toml and a limits.toml to start from."""

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
    """Write a commented bench.toml, and limits.toml for acceptance, to start from.

    Example: `benchctl init lab && benchctl check two_stage --bench lab/bench.toml`
    """
    from benchctl.bench import template
    from benchctl.metrology.limits_template import limits_template
    from instruments.errors import UsageError

    with result_of("init", json_to, quiet) as result:
        bench, limits = folder / "bench.toml", folder / "limits.toml"
        for path in (bench, limits):
            if path.exists():
                raise UsageError(f"{path}: is there already and is left as it is; name another folder")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as err:
            raise UsageError(f"{folder}: cannot be made into a folder: {err.strerror or err}") from err
        for path, text in ((bench, template()), (limits, limits_template())):
            try:
                with path.open("x", encoding="utf-8") as file:
                    file.write(text)
            except OSError as err:
                raise UsageError(f"{path}: cannot be written: {err.strerror or err}") from err
        result.values |= {"bench": bench, "limits": limits}
        result.say(f"wrote {bench}: simulated as it stands; set simulated = false and the addresses for a real bench")
        result.say(f"wrote {limits}: limits for benchctl accept, to be replaced by those of your gyro")
