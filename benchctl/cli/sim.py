"""`benchctl sim`: the simulated bench as servers, for other programs to talk to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchctl.cli.output import BenchOption, JsonOption, QuietOption, SeedOption, result_of

if TYPE_CHECKING:
    from benchctl.bench import Bench


def sim(
    bench: BenchOption,
    speed: Annotated[float, typer.Option(min=0.01, help="Bench seconds a wall second.")] = 1.0,
    pace_baud: Annotated[
        int | None, typer.Option(min=300, help="Let the chamber's bytes leave as a line at that baud would let them.")
    ] = None,
    write_bench: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a bench.toml that reaches these servers.")
    ] = None,
    seed: SeedOption = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Start the simulated instruments of a bench as servers, print their addresses as one line of JSON, and serve.

    They are wired as bench.toml says: its options (a unit's number, channels) and what kind of line its addresses name.
    Ends on Ctrl-C or SIGTERM. Example: `benchctl sim --bench simulated --speed 20 --write-bench sim.toml`, and in
    another terminal `benchctl run static --bench sim.toml`.
    """
    import json
    import sys
    import time

    from benchctl.bench import load_bench
    from benchctl.campaign.opened import drivers_at, simulated_bench
    from benchctl.campaign.stop import stop_on_signals
    from instruments.simulated.clock import ScaledClock

    with result_of("sim", json_to, quiet) as result:
        stands = load_bench(bench).with_seed(seed)
        options = {"chamber": {"pace_baud": pace_baud}} if pace_baud else {}
        with stop_on_signals() as stop, simulated_bench(stands, ScaledClock(speed), **options) as servers:
            drivers_at(stands, servers.clock, servers.addresses)  # whoever connects with this bench.toml can make them
            if write_bench is not None:
                _write_bench(write_bench, stands, servers.addresses, speed)
            result.values |= servers.addresses
            sys.stdout.write(json.dumps(servers.addresses) + "\n")
            sys.stdout.flush()
            while not stop.reason:
                time.sleep(0.1)


def _write_bench(path: Path, bench: Bench, addresses: dict[str, str], speed: float) -> None:
    import tomllib

    import tomli_w

    from instruments.errors import UsageError

    document = tomllib.loads(bench.text)
    document |= {"simulated": False, "time_factor": speed}
    document.pop("physics", None)
    document.pop("effects", None)
    document.pop("faults", None)
    for name in ("rate_table", "chamber", "digitizer", *(["gyro"] if bench.gyro else [])):
        document[name]["address"] = addresses[name]
    document["chamber"]["model"] = bench.chamber.model  # a profile's whole path: the new file may lie elsewhere
    if "digitizer_stream" in addresses:
        document["digitizer"]["stream_address"] = addresses["digitizer_stream"]
    try:
        path.write_text(tomli_w.dumps(document), encoding="utf-8")
    except OSError as err:
        raise UsageError(f"--write-bench {path}: cannot be written: {err.strerror or err}") from err
