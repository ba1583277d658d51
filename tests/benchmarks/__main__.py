"""How fast the suite is, beside its peers and its limits, measured in one run: `python -m tests.benchmarks`.

Prints a table with the machine, the date and the versions; progress goes to stderr. Peers come with
`pip install 'benchctl[benchmarks]'`. A figure that misses its goal is said in the table; the status is 0 where all
were measured, 1 where a benchmark failed (the others are measured all the same), 2 for options that cannot be used.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from benchctl.atomic import whole_file
from benchctl.closeness import meant
from benchctl_instruments.errors import UsageError
from tests.benchmarks.comparison import Comparison
from tests.benchmarks.machine import Conditions
from tests.benchmarks.running import run
from tests.benchmarks.table import table

NAMES = (
    "start_up",
    "allan",
    "recording_points",
    "recording_blocks",
    "fit_out_of_core",
    "diagnosis_speed",
    "simulated_bench",
    "fleet_speed",
)
"""The modules with a function `measured`, in the order of the table."""


def main(arguments: Sequence[str], names: Sequence[str] = NAMES, package: str = "tests.benchmarks") -> int:
    """Measure, print and write; the exit status."""
    try:
        told = _parser(names).parse_args(arguments)
        chosen = [name for name in names if name in _known(told.only or names, names)]
        for path in (told.json, told.picture):
            _require_folder(path)
        if told.picture is not None and told.picture.suffix.lower() != ".png":
            raise UsageError(f"--picture {told.picture}: expected a name that ends in .png")
        conditions = Conditions.now()
        found, failed = run(chosen, package)
        conditions = conditions.ended()
        _write(told, found, conditions)
    except UsageError as err:
        print(f"benchmarks: {err}", file=sys.stderr)  # noqa: T201
        return err.exit_status
    return 1 if failed else 0


def _parser(names: Sequence[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m tests.benchmarks", description="Speed beside peers and limits, measured in one run."
    )
    listed = ", ".join(names)
    parser.add_argument("--only", action="append", metavar="NAME", help=f"one of {listed}; may be given again")
    parser.add_argument("--json", type=Path, metavar="FILE", help="all figures, for programs; - for stdout")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="a PNG of all ratios beside their goals")
    return parser


def _known(only: Sequence[str], names: Sequence[str]) -> Sequence[str]:
    for name in only:
        if name not in names:
            raise UsageError(f"--only {name}: there is no such benchmark: {meant(name, names)}")
    return only


def _require_folder(path: Path | None) -> None:
    """So that nobody waits minutes for figures that cannot be written."""
    if path is not None and not path.parent.is_dir():
        raise UsageError(f"{path}: there is no folder {path.parent}; make it first")


def _write(told: argparse.Namespace, found: Sequence[Comparison], conditions: Conditions) -> None:
    to_stdout = told.json == Path("-")
    print(table(found, conditions), file=sys.stderr if to_stdout else sys.stdout)
    figures = json.dumps([one.as_json() for one in found], indent=2, ensure_ascii=False)
    if to_stdout:
        print(figures)  # noqa: T201
    elif told.json is not None:
        with whole_file(told.json) as temporary:
            temporary.write_text(figures + "\n", encoding="utf-8")
    if told.picture is not None:
        from tests.benchmarks.picture import write_picture

        write_picture(found, conditions, told.picture)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
