"""Where the shared recordings and data lie: beside the checkout, or wherever BENCHCTL_SHARED says."""

import os
from pathlib import Path

import pytest

SHARED = Path(os.environ.get("BENCHCTL_SHARED", Path(__file__).resolve().parents[2] / "shared"))


def needs_shared(part: str) -> pytest.MarkDecorator:
    """Skip, saying why, where a part of the shared data is absent."""
    return pytest.mark.skipif(
        not (SHARED / part).exists(), reason=f"{SHARED / part} is not here: shared data are not part of the project"
    )
