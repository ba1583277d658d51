"""`benchctl init`: write a template of bench.toml and limits.toml, and their JSON schemas for editors."""

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
    """Write a commented bench.toml, a limits.toml for acceptance, and the JSON schemas of both.

    Editors that support schemas (Even Better TOML in VS Code, Taplo) then explain, complete and check each field.
    Example: `benchctl init lab && benchctl check two_stage --bench lab/bench.toml`
    """
    from benchctl.atomic import whole_file
    from benchctl.bench import template
    from benchctl.bench_schema import BENCH_SCHEMA, LIMITS_SCHEMA, as_text, bench_schema, directive, limits_schema
    from benchctl.metrology.limit_file import acceptance_test_template, limits_template
    from benchctl_instruments.errors import UsageError, reason

    with result_of("init", json_to, quiet) as result:
        bench, limits, test = folder / "bench.toml", folder / "limits.toml", folder / "acceptance.bench-test.toml"
        for path in (bench, limits, test):
            if path.exists():
                raise UsageError(f"{path}: is there already and is left as it is; name another folder")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as err:
            raise UsageError(f"{folder}: cannot be made into a folder: {reason(err)}; name another") from err
        schemas = {BENCH_SCHEMA: bench_schema(), LIMITS_SCHEMA: limits_schema()}
        for name, schema in schemas.items():  # generated files: an older version is replaced
            with whole_file(folder / name) as temporary:
                temporary.write_text(as_text(schema), encoding="utf-8")
        texts = {
            bench: directive(BENCH_SCHEMA) + template(),
            limits: directive(LIMITS_SCHEMA) + limits_template(),
            test: acceptance_test_template(),
        }
        for path, text in texts.items():
            try:
                with path.open("x", encoding="utf-8") as file:
                    file.write(text)
            except OSError as err:
                raise UsageError(f"{path}: cannot be written: {reason(err)}; name another folder") from err
        result.values |= {
            "bench": bench,
            "limits": limits,
            "test": test,
            "schemas": [folder / name for name in schemas],
        }
        result.say(f"wrote {bench}: the bench is simulated; set simulated = false and the addresses for a real bench")
        result.say(f"wrote {limits}: limits for benchctl accept, to be replaced by those of your gyro")
        result.say(f"wrote {test}: the acceptance as a test, for pytest and CI: pytest {folder}")
        result.say(f"wrote {' and '.join(schemas)} next to them: editors explain and check the fields by them")
