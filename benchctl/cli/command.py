"""Run a verb as a Typer command or group of commands, with plain help: description, examples, arguments and options."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, cast

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException
from typer.main import get_command

from benchctl.cli.verbs import function_name, module_of
from benchctl.closeness import meant, nearest
from benchctl_instruments.errors import UsageError, in_line
from benchctl_instruments.field_faults import expectation

_WIDEST = 110
_COMMAND = re.compile(r"`(benchctl [^`]+)`")


class VerbCommand(TyperCommand):
    """A command whose docstring ends in `Example:` paragraphs with commands in backticks."""

    further: Callable[[], str] | None = None
    """Returns the text below the options, printed verbatim; called when the help is shown."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; raise `UsageError` if they are invalid."""
        with _worded(ctx, self):
            return super().parse_args(ctx, args)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the usage after the verb's name: optional parts in brackets, required parts without."""
        pieces = super().collect_usage_pieces(ctx)
        return [re.sub(r"[{}]|(?<=\[)\[|\](?=\])", "", piece) for piece in pieces]

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        """Write the text without its examples, then each example on one line for copying."""
        _write_help(self.help, formatter)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the further help of the verb."""
        if self.further is not None:
            formatter.write_paragraph()
            formatter.write(f"{self.further()}\n")


class VerbGroup(TyperGroup):
    """A verb with several commands, each a `VerbCommand`; its help lists them."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments up to the command; raise `UsageError` if there is no such command."""
        with _worded(ctx, self):
            rest = super().parse_args(ctx, args)
        known = self.list_commands(ctx)
        if not args:
            raise UsageError(f"{self.name}: expected {' or '.join(known)}; {_explains(ctx)}")
        if args[0] not in known:
            raise UsageError(f"{self.name}: there is no command {args[0]}: {meant(args[0], known, _explains(ctx))}")
        return rest

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        """Write the text and the examples."""
        _write_help(self.help, formatter)


def run_command(verb: str, arguments: list[str]) -> int:
    """Run a verb and return its exit status, 130 if Ctrl-C ended it.

    Raises
    ------
    BenchError
        Any error that the verb raises; `UsageError` also for invalid arguments.
    """
    try:
        status = command_of(verb).main(arguments, prog_name=f"benchctl {verb}", standalone_mode=False)
    except typer.Abort:
        return 130
    return status if isinstance(status, int) else 0


def command_of(verb: str) -> VerbCommand | VerbGroup:
    """Return the command of a verb, or its group of commands if its module has `COMMANDS`, the functions to run.

    `further_help` of the module, if any, returns the text below the options.
    """
    module = module_of(verb)
    app = typer.Typer(
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": _WIDEST},
    )
    function = getattr(module, function_name(verb))
    if commands := getattr(module, "COMMANDS", ()):
        app.callback(cls=VerbGroup, subcommand_metavar="COMMAND …")(function)
        for one in commands:
            app.command(one.__name__, cls=VerbCommand)(one)
    else:
        app.command(verb, cls=VerbCommand)(function)
    command = cast("VerbCommand | VerbGroup", get_command(app))
    command.name = verb
    if isinstance(command, VerbCommand):
        command.further = getattr(module, "further_help", None)
    return command


def named_command(verb: str, arguments: Sequence[str]) -> tuple[VerbCommand | VerbGroup, list[str]]:
    """Return the command that a verb and its first arguments name, and the arguments after the name."""
    command, rest = command_of(verb), list(arguments)
    if isinstance(command, VerbGroup) and rest and rest[0] in command.commands:
        return cast(VerbCommand, command.commands[rest[0]]), rest[1:]
    return command, rest


def examples(docstring: str | None) -> tuple[str, ...]:
    r"""Return the example commands of a verb's docstring, each on one line.

    >>> examples("Fits.\n\nExample: `benchctl fit\na.h5`, `benchctl fit b.h5`")
    ('benchctl fit a.h5', 'benchctl fit b.h5')
    """
    parts = [part for part in _paragraphs(docstring) if _is_example(part)]
    return tuple(" ".join(found.split()) for part in parts for found in _COMMAND.findall(part))


def _paragraphs(docstring: str | None) -> Sequence[str]:
    return re.split(r"\n\s*\n|\s+(?=Example: )", inspect.cleandoc(docstring or ""))


def _is_example(paragraph: str) -> bool:
    return paragraph.startswith("Example")


def _write_help(docstring: str | None, formatter: Any) -> None:
    text = "\n\n".join(part for part in _paragraphs(docstring) if not _is_example(part))
    formatter.write_paragraph()
    with formatter.indentation():
        formatter.write_text(text)
    formatter.write_paragraph()
    formatter.write_heading("Examples")
    for line in examples(docstring):
        formatter.write(f"  {line}\n")


@contextmanager
def _worded(ctx: typer.Context, command: VerbCommand | VerbGroup) -> Iterator[None]:
    """Raise a fault in the arguments as a `UsageError` that states it and its remedy."""
    try:
        yield
    except TyperException as err:
        raise UsageError(f"{_path(ctx)}: {_fault(err, ctx, command)}") from err


def _fault(err: TyperException, ctx: typer.Context, command: VerbCommand | VerbGroup) -> str:
    option = getattr(err, "option_name", "")
    known = option_names(command)
    if option and option not in known:
        return f"there is no option {option}: {meant(option, known, _explains(ctx))}"
    message = err.format_message().rstrip(".")
    if not isinstance(err, typer.BadParameter) or err.param is None:
        return f"{message}; {_explains(ctx)}"
    is_option = err.param.param_type_name == "option"
    hint = " / ".join(err.param.opts) if is_option else str(err.param.metavar or err.param.name).upper()
    if not err.message:
        return f"{hint} is needed: {in_line(getattr(err.param, 'help', '') or '')} ({_explains(ctx)})"
    message = expectation(err.message.removeprefix("Value error, ").rstrip("."))
    if given := re.match(r"'(.*)' is not one of", message):
        choices = [item.value for item in err.param.shell_complete(ctx, "")]
        message += f": did you mean {close}?" if (close := nearest(given[1], choices)) else ""
    return f"{hint}: {message}"


def option_names(command: VerbCommand | VerbGroup) -> list[str]:
    """Return all options of a command, as they are typed."""
    options = [param for param in command.get_params(typer.Context(command)) if param.param_type_name == "option"]
    return [name for param in options for name in (*param.opts, *param.secondary_opts)]


def _path(ctx: typer.Context) -> str:
    """Return the verb, and its command if it has one, as they are typed."""
    return ctx.command_path.removeprefix("benchctl ")


def _explains(ctx: typer.Context) -> str:
    return f"benchctl {_path(ctx)} --help explains it"
