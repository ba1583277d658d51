"""The verbs (subcommands), in the order of typical use; each module is imported only when its verb is run."""

from __future__ import annotations

import importlib
import keyword
from collections.abc import Iterator
from types import ModuleType

GROUPS: dict[str, dict[str, str]] = {
    "In the lab": {
        "init": "write a bench.toml and a limits.toml to start from",
        "doctor": "check ports, permissions and instruments; suggest what to do",
        "instrument": "ask an unknown device what it is; write the start of a driver",
        "procedures": "list procedures, their parameters and durations",
        "check": "a dry run: limits, timeline, operator questions; nothing moves",
        "run": "run a procedure, record and fit it; or resume a campaign",
        "serve": "the live page: watch a campaign in a browser",
        "notify": "send a test message to the recipients in bench.toml",
        "recover": "after a crash: close the recording and list the complete steps",
        "show": "what is in a recording",
        "fit": "the two-stage calibration: coefficients and a report",
        "allan": "Allan deviation and noise coefficients",
        "diagnose": "what physics the model leaves out, and what to run next",
        "compare": "differences between a recording and its simulations",
        "apply": "compensate a recording by coefficients",
        "explain": "an effect, a metric or a term: words, equation, sources",
        "help": "a page of the handbook",
    },
    "For quality assurance": {
        "accept": "the tests of a gyro with limits: verdicts, report, JUnit",
        "verify": "check that a recording or campaign is unchanged, and who signed it",
        "history": "units over time, and compared with each other",
    },
    "For programs and CI": {
        "simulate": "a recording by the simulated bench, without its wires",
        "sim": "the simulated instruments as servers on real sockets",
        "fleet": "fit, diagnose or accept many recordings, on a cluster or all cores",
        "import": "a recording from another bench into a file of ours",
        "export": "a recording, or a compensation, for other programs",
        "prove": "sealed trials of the diagnosis, scored",
        "paper": "redo the paper's experiment and audit its numbers",
    },
}

VERBS: dict[str, str] = {name: summary for group in GROUPS.values() for name, summary in group.items()}
"""All verbs, each with one line of help."""

SYNONYMS = {
    "acceptance": "accept",
    "calibrate": "fit",
    "convert": "export",
    "dashboard": "serve",
    "dry-run": "check",
    "info": "show",
    "list": "procedures",
    "resume": "run --resume",
    "rerun": "run --again",
    "selftest": "doctor",
    "watch": "serve",
}
"""Names of verbs in other programs; used only in error messages."""


def module_of(verb: str) -> ModuleType:
    """Import and return the module of a verb; the verb's function has the same name as the module."""
    return importlib.import_module(f"benchctl.cli.{_identifier(verb)}")


def function_name(verb: str) -> str:
    """Return the name of the verb's function in its module."""
    return _identifier(verb)


def _identifier(verb: str) -> str:
    return f"{verb}_" if keyword.iskeyword(verb) else verb


OPTIONS = {
    "--version": "print the version and exit",
    "--install-completion [SHELL]": "complete verbs, options, procedures and files by Tab: bash, zsh, fish, powershell",
    "--show-completion [SHELL]": "print what --install-completion would install",
    "-h, --help": "print this and exit; benchctl VERB --help explains a verb",
}

EXAMPLES = (
    "benchctl run two_stage --bench simulated  # without hardware: a campaign of 34 hours in a minute",
    "benchctl init lab  # a bench of your own: lab/bench.toml, commented",
    "benchctl run --help",
)


def overview() -> str:
    """Return the text of `benchctl --help`."""
    return "\n".join(_lines())


def _lines() -> Iterator[str]:
    yield "Usage: benchctl VERB [OPTIONS] …"
    yield ""
    yield "  Test automation for gyroscopes on a rate table in a climate chamber."
    yield ""
    yield "Examples:"
    yield from (f"  {line}" for line in EXAMPLES)
    width = max(len(name) for verbs in GROUPS.values() for name in verbs)
    for group, verbs in GROUPS.items():
        yield ""
        yield f"{group}:"
        yield from (f"  {name:<{width}}  {summary}" for name, summary in verbs.items())
    yield ""
    yield "Options:"
    width = max(map(len, OPTIONS))
    yield from (f"  {option:<{width}}  {summary}" for option, summary in OPTIONS.items())
