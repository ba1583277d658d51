"""What `benchctl --help` says: the verbs by who needs them. It is plain text, so that it is there at once."""

from __future__ import annotations

from collections.abc import Iterator

from benchctl.cli.verbs import GROUPS

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
    """The whole text."""
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
        yield from (f"  {name:<{width}}  {says}" for name, says in verbs.items())
    yield ""
    yield "Options:"
    width = max(map(len, OPTIONS))
    yield from (f"  {option:<{width}}  {says}" for option, says in OPTIONS.items())
