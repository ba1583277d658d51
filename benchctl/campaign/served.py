"""A bench.toml that reaches the servers of a simulated bench, for other programs."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping

import tomli_w

from benchctl.bench import Bench

_SIMULATION = ("physics", "effects", "faults")


def bench_toml_at(bench: Bench, addresses: Mapping[str, str], speed: float) -> str:
    """The bench's own text with the servers' addresses, without what only a simulation has.

    `speed` is bench seconds a wall second.
    """
    document = tomllib.loads(bench.text)
    document |= {"simulated": False, "time_factor": speed}
    for table in _SIMULATION:
        document.pop(table, None)
    for name in bench.entries:
        document[name]["address"] = addresses[name]
    document["chamber"]["model"] = bench.chamber.model  # a profile's whole path: the new file may lie elsewhere
    if "digitizer_stream" in addresses:
        document["digitizer"]["stream_address"] = addresses["digitizer_stream"]
    return tomli_w.dumps(document)
