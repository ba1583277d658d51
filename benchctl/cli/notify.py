"""`benchctl notify`: list the recipients of messages, and send each a test message."""

from __future__ import annotations

from typing import Annotated

import typer

from benchctl.cli.output import JsonOption, QuietOption, bench_option, result_of


def notify(
    test: Annotated[bool, typer.Option("--test", help="Send a test message to each recipient.")] = False,
    bench: Annotated[
        str,
        bench_option("A bench.toml with [notify]."),
    ] = "bench.toml",
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """List the recipients in [notify] of bench.toml, and with --test send each a test message; URLs are masked.

    Exit status 0: all can be used, and were delivered with --test; 2: there is no [notify], or a URL cannot be used;
    3: a message was not delivered.
    Example: `benchctl notify --test --bench lab/bench.toml`
    """
    from benchctl.app.notify import try_recipients
    from benchctl.bench import load_bench
    from benchctl_instruments.errors import LinkError, UsageError

    with result_of("notify", json_to, quiet) as result:
        loaded = load_bench(bench)
        tried = []
        for one in try_recipients(loaded, send=test):
            tried.append(one)
            result.say(f"{one.url}: {one.problem or ('delivered' if test else 'can be used')}")
        result.values["recipients"] = [
            {"url": one.url, "known": one.known, "delivered": test and not one.problem, "problem": one.problem}
            for one in tried
        ]
        result.values["on"] = list(loaded.notify.on) if loaded.notify else []
        result.say(f"events: {', '.join(result.values['on'])}")
        for one in sorted(tried, key=lambda one: one.known):  # a URL that cannot be used counts first
            if one.problem:
                raise (LinkError if one.known else UsageError)(one.problem)
