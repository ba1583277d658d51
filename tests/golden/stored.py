"""Results that are stored in `results`: numbers are compared within a tolerance, everything else exactly.

A change of the code that is meant to change no result must pass as it is. Where results are meant to change,
`BENCHCTL_WRITE_GOLDEN=1 pytest -m slow` writes them again, and the difference is reviewed.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tests.shared import SHARED

STORED = Path(__file__).parent / "results"
RELATIVE, ABSOLUTE = 1e-5, 1e-9
"""Other processors and libraries add in another order; a fit then ends elsewhere within its convergence criterion."""
LONGEST = 12
"""Longer lists of numbers are stored by their count, mean and root mean square."""
VOLATILE = re.compile(r"digest|sha256|version|wall|elapsed|utc|free|host|seconds|python|libraries|created|bytes")


def stable(value: Any, folder: Path) -> Any:
    """A result without what differs from run to run: times of day, versions, digests, folders."""
    if isinstance(value, Mapping):
        kept = {str(key): one for key, one in value.items() if not VOLATILE.search(str(key))}
        if isinstance(kept.get("steps"), list):
            kept["steps"] = columns(kept["steps"])
        return {key: stable(one, folder) for key, one in kept.items()}
    if isinstance(value, list):
        numbers = [one for one in value if isinstance(one, float | int)]
        if len(value) > LONGEST and len(numbers) == len(value):
            mean, power = sum(numbers) / len(numbers), sum(one * one for one in numbers) / len(numbers)
            return {"count": len(numbers), "mean": mean, "rms": math.sqrt(power)}
        return [stable(one, folder) for one in value]
    return value.replace(f"{folder}/", "").replace(f"{SHARED}/", "") if isinstance(value, str) else value


def columns(steps: list[Any]) -> Any:
    """The numbers of many steps by their names; a list of anything else as it is."""
    if not all(isinstance(step, Mapping) for step in steps):
        return steps
    names = sorted({name for step in steps for name, one in step.items() if isinstance(one, float | int)})
    return {name: [step[name] for step in steps if isinstance(step.get(name), float | int)] for name in names}


def differences(stored: Any, now: Any, where: str = "") -> Iterator[str]:
    """Where two results differ, one line each."""
    if isinstance(stored, dict) and isinstance(now, dict):
        for key in sorted(stored.keys() | now.keys()):
            if key not in stored or key not in now:
                yield f"{where}/{key}: {'is new' if key in now else 'is gone'}"
            else:
                yield from differences(stored[key], now[key], f"{where}/{key}")
    elif isinstance(stored, list) and isinstance(now, list) and len(stored) == len(now):
        for i, (one, other) in enumerate(zip(stored, now, strict=True)):
            yield from differences(one, other, f"{where}/{i}")
    elif isinstance(stored, float) and isinstance(now, float | int):
        if not math.isclose(stored, now, rel_tol=RELATIVE, abs_tol=ABSOLUTE):
            yield f"{where}: {stored!r} is now {now!r}"
    elif stored != now:
        yield f"{where}: {stored!r} is now {now!r}"


def compare(name: str, result: Mapping[str, Any], folder: Path) -> None:
    """Fail where a result is not the stored one."""
    now, path = json.loads(json.dumps(stable(result, folder))), STORED / f"{name}.json"
    if os.environ.get("BENCHCTL_WRITE_GOLDEN"):
        STORED.mkdir(exist_ok=True)
        path.write_text(json.dumps(now, indent=1, ensure_ascii=False, sort_keys=True) + "\n", encoding="utf-8")
    found = list(differences(json.loads(path.read_text(encoding="utf-8")), now))
    assert not found, f"{name}: {len(found)} differences\n" + "\n".join(found[:20])
