"""The bench that the markers of a test describe."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from benchctl.bench import SIMULATED, Bench, load_bench
from benchctl_instruments.errors import UsageError


def bench_of(node: pytest.Item, folder: Path) -> Bench:
    """The bench of `benchctl_bench` and the faults of `benchctl_fault`, the simulated one as it stands without them.

    What was made of them is written into a folder, for whoever looks into it afterwards.

    Raises
    ------
    UsageError
        Where it cannot be used, or is not simulated.
    """
    marker = node.get_closest_marker("benchctl_bench")
    file, seed, tables = _asked(*marker.args, **marker.kwargs) if marker else _asked()
    stands = load_bench(file)
    document = tomllib.loads(stands.text)
    document["chamber"]["model"] = stands.chamber.model  # a profile's whole path: what is written lies elsewhere
    faults = [_fault(*mark.args, **mark.kwargs) for mark in node.iter_markers("benchctl_fault")]
    if faults:
        document["faults"] = [*document.get("faults", []), *reversed(faults)]  # the test's own come last
    path = folder / "bench.toml"
    path.write_text(tomli_w.dumps(_changed(document, tables)), encoding="utf-8")
    bench = load_bench(str(path)).with_seed(seed)
    if not bench.simulated:
        raise UsageError(f"benchctl_bench {file}: expected a bench with simulated = true; fixtures move nothing real")
    return bench


def _asked(file: Any = SIMULATED, seed: int | None = None, **tables: Any) -> tuple[str, int | None, dict[str, Any]]:
    return str(file), seed, tables


def _fault(*args: Any, **fields: Any) -> dict[str, Any]:
    if args:
        raise UsageError(
            f'benchctl_fault{args!r}: expected its fields by name, as benchctl_fault(on="chamber", kind="silence")'
        )
    return fields


def _changed(document: dict[str, Any], tables: dict[str, Any]) -> dict[str, Any]:
    """The document with these values in the place of its own, table by table."""
    return document | {
        name: _changed(document[name], value) if isinstance(value, dict) and name in document else value
        for name, value in tables.items()
    }
