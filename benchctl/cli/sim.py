"""`benchctl sim`: serve the simulated instruments of a bench to other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchctl.cli.output import BenchOption, JsonOption, QuietOption, SeedOption, result_of

if TYPE_CHECKING:
    from benchctl.bench import Bench


def sim(
    bench: BenchOption,
    speed: Annotated[
        float, typer.Option("--speed", metavar="X", min=0.01, help="Simulated seconds per second of real time.")
    ] = 1.0,
    pace_baud: Annotated[
        int | None,
        typer.Option(
            "--pace-baud",
            metavar="BAUD",
            min=300,
            help="Send the chamber's bytes at the speed of a serial line of this baud rate.",
        ),
    ] = None,
    write_bench: Annotated[
        Path | None,
        typer.Option("--write-bench", metavar="FILE", help="Write a bench.toml with the addresses of these servers."),
    ] = None,
    seed: SeedOption = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Start the simulated instruments of a bench as servers, print their addresses as one line of JSON, and serve.

    The wiring follows bench.toml: its options (such as unit number and channels) and the kind of line in its
    addresses. Ends on Ctrl-C or SIGTERM. Example: `benchctl sim --bench simulated --speed 20 --write-bench sim.toml`,
    and in another terminal `benchctl run static --bench sim.toml`.
    """
    import json
    import sys
    import time

    from benchctl.bench import load_bench
    from benchctl.campaign.opened import drivers_at, simulated_bench
    from benchctl.campaign.stop import stop_on_signals
    from benchctl_instruments.simulated.clock import ScaledClock

    with result_of("sim", json_to, quiet) as result:
        loaded = load_bench(bench).with_seed(seed)
        options = {"chamber": {"pace_baud": pace_baud}} if pace_baud else {}
        with stop_on_signals() as stop, simulated_bench(loaded, ScaledClock(speed), **options) as servers:
            drivers_at(loaded, servers.clock, servers.addresses)  # check that clients can create the drivers
            if write_bench is not None:
                _write_bench(write_bench, loaded, servers.addresses, speed)
            result.values |= servers.addresses
            sys.stdout.write(json.dumps(servers.addresses) + "\n")
            sys.stdout.flush()
            while not stop.reason:
                time.sleep(0.1)


def _write_bench(path: Path, bench: Bench, addresses: dict[str, str], speed: float) -> None:
    from benchctl.campaign.opened import bench_toml_at
    from benchctl_instruments.errors import UsageError, reason

    try:
        path.write_text(bench_toml_at(bench, addresses, speed), encoding="utf-8")
    except OSError as err:
        raise UsageError(f"--write-bench {path}: cannot be written: {reason(err)}; name another file") from err
