"""The verbs, gathered; and what every one of them owes its user: one line for an error, and the right exit status."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Annotated

import typer
from typer.exceptions import TyperException

import benchctl
from benchctl.cli import (
    accept,
    allan,
    apply,
    check,
    compare,
    diagnose,
    export,
    fit,
    history,
    import_,
    init,
    paper,
    procedures,
    prove,
    recover,
    run,
    show,
    sim,
    simulate,
    verify,
)
from benchctl.cli.output import tell
from instruments.errors import BenchError


def _print_version(wanted: bool) -> None:
    if wanted:
        tell(f"benchctl {benchctl.__version__}")
        raise typer.Exit


app = typer.Typer(
    name="benchctl",
    help="Test automation for gyroscopes on a rate table in a climate chamber.",
    epilog="Try it without hardware: benchctl run two_stage --bench simulated",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    """Test automation for gyroscopes on a rate table in a climate chamber."""


_VERBS: dict[str, Callable[..., None]] = {
    "init": init.init,
    "procedures": procedures.procedures,
    "check": check.check,
    "run": run.run,
    "recover": recover.recover,
    "fit": fit.fit,
    "accept": accept.accept,
    "diagnose": diagnose.diagnose,
    "compare": compare.compare,
    "allan": allan.allan,
    "history": history.history,
    "apply": apply.apply,
    "export": export.export,
    "show": show.show,
    "verify": verify.verify,
    "simulate": simulate.simulate,
    "sim": sim.sim,
    "prove": prove.prove,
    "paper": paper.paper,
}
for _name, _verb in _VERBS.items():
    app.command(_name)(_verb)
app.command("import", epilog=import_.map_explained())(import_.import_)


_STOPPED = 130
"""What typer makes of Ctrl-C: the exit status of a program that SIGINT ended."""


def main() -> None:
    """The console script."""
    sys.exit(run_verb(sys.argv[1:]))


def run_verb(arguments: list[str]) -> int:
    """Run a verb and return its exit status: 0, 1, 2 or 3, as `instruments.errors` says, 130 for Ctrl-C in between."""
    try:
        status = app(arguments, standalone_mode=False)
    except (BenchError, TyperException) as err:
        message = err.format_message() if isinstance(err, TyperException) else str(err)
        tell(f"benchctl: {' '.join(message.split())}", err=True)
        return 2 if isinstance(err, TyperException) else err.exit_status
    except typer.Abort:
        status = _STOPPED
    if status == _STOPPED:
        tell("benchctl: stopped", err=True)
    return status if isinstance(status, int) else 0
