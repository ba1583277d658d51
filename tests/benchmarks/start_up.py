"""How much longer than bare Python the command line takes to answer, and the package to be imported."""

from __future__ import annotations

import subprocess
import sys
import time

from tests.benchmarks.comparison import Comparison, alternating

LIMIT_S = 0.15
_TURNS = 15
_LEAST_S = 1e-3
"""Less is not told from nothing."""
_BARE = ("-c", "pass")
_STARTS = {"benchctl --help": ("-m", "benchctl", "--help"), "import benchctl": ("-c", "import benchctl")}


def measured() -> list[Comparison]:
    """Of each start what it takes more than `python -c pass`, beside the limit."""
    found = []
    for name, arguments in _STARTS.items():
        ours_s, bare_s = alternating(lambda arguments=arguments: _wall_s(arguments), lambda: _wall_s(_BARE), _TURNS)
        more_s = max(ours_s - bare_s, _LEAST_S)
        found.append(Comparison(name, more_s, "s", "0.15 s more than bare Python", LIMIT_S, "<=", 1.0))
    return found


def _wall_s(arguments: tuple[str, ...]) -> float:
    began_s = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - began_s
