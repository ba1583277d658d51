"""Run a verb as a typer command, with plain help: description, examples, arguments and options."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Sequence
from typing import Any, cast

import typer
from typer.core import TyperCommand
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

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the usage after the verb's name: optional parts in brackets, required parts without."""
        pieces = super().collect_usage_pieces(ctx)
        return [re.sub(r"[{}]|(?<=\[)\[|\](?=\])", "", piece) for piece in pieces]

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        """Write the text without its examples, then each example on one line for copying."""
        text = "\n\n".join(part for part in _paragraphs(self.help) if not _is_example(part))
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text(text)
        formatter.write_paragraph()
        formatter.write_heading("Examples")
        for line in examples(self.help):
            formatter.write(f"  {line}\n")

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the further help of the verb."""
        if self.further is not None:
            formatter.write_paragraph()
            formatter.write(f"{self.further()}\n")


def run_command(verb: str, arguments: list[str]) -> int:
    """Run a verb and return its exit status, 130 if Ctrl-C ended it.

    Raises
    ------
    BenchError
        Any error that the verb raises; `UsageError` also for invalid arguments.
    """
    command = command_of(verb)
    try:
        status = command.main(arguments, prog_name=f"benchctl {verb}", standalone_mode=False)
    except typer.Abort:
        return 130
    except TyperException as err:
        raise UsageError(f"{verb}: {_worded(err, command)}") from err
    return status if isinstance(status, int) else 0


def command_of(verb: str) -> VerbCommand:
    """Return the command of a verb; `further_help` of its module, if any, returns the text below the options."""
    module = module_of(verb)
    app = typer.Typer(
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": _WIDEST},
    )
    app.command(verb, cls=VerbCommand)(getattr(module, function_name(verb)))
    command = cast(VerbCommand, get_command(app))
    command.further = getattr(module, "further_help", None)
    return command


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


def _worded(err: TyperException, command: VerbCommand) -> str:
    """Return a message that states the fault in the arguments and its remedy."""
    option = getattr(err, "option_name", "")
    known = option_names(command)
    if option and option not in known:
        return f"there is no option {option}: {meant(option, known, _explains(command))}"
    message = err.format_message().rstrip(".")
    if not isinstance(err, typer.BadParameter) or err.param is None:
        return f"{message}; {_explains(command)}"
    is_option = err.param.param_type_name == "option"
    hint = " / ".join(err.param.opts) if is_option else str(err.param.metavar or err.param.name).upper()
    if not err.message:
        return f"{hint} is needed: {in_line(getattr(err.param, 'help', '') or '')} ({_explains(command)})"
    message = expectation(err.message.removeprefix("Value error, ").rstrip("."))
    if given := re.match(r"'(.*)' is not one of", message):
        choices = [item.value for item in err.param.shell_complete(typer.Context(command), "")]
        message += f": did you mean {close}?" if (close := nearest(given[1], choices)) else ""
    return f"{hint}: {message}"


def option_names(command: VerbCommand) -> list[str]:
    """Return all options of a command, as they are typed."""
    options = [param for param in command.get_params(typer.Context(command)) if param.param_type_name == "option"]
    return [name for param in options for name in (*param.opts, *param.secondary_opts)]


def _explains(command: VerbCommand) -> str:
    return f"benchctl {command.name} --help explains it"
