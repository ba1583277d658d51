"""A fault as a table of bench.toml, or a call in a test, states it: where, of what kind, and when."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from benchctl_instruments.simulated.faults.schedule import When

Place = Literal["rate_table", "chamber", "digitizer", "digitizer_stream", "gyro"]
"""A link, named after the instrument at its end; the digitizer's stream has one of its own, `gyro` is a digital one."""

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class FaultTable(BaseModel):
    """What the tables of all kinds have; `kind` is the kind's own. The fields of time and counting are those of `When`.

    Examples
    --------
    In bench.toml, on a simulated bench: every 50th request to read the process value of a Watlow F4T is not answered.

        [[faults]]
        on = "chamber"
        kind = "silence"
        pattern = "^03 0b 04"
        every = 50
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)  # no "3" for 3, no true for 1

    places: ClassVar[tuple[Place, ...]] = ("rate_table", "chamber", "digitizer")

    on: Place
    kind: str
    pattern: str = ""
    from_s: float = Field(default=0.0, ge=0)
    to_s: float = Field(default=math.inf, gt=0)
    nth: int | None = Field(default=None, ge=1)
    every: int | None = Field(default=None, ge=1)
    every_s: Positive | None = None
    times: int | None = Field(default=None, ge=1)

    @field_validator("pattern")
    @classmethod
    def _is_a_pattern(cls, value: str) -> str:
        try:
            re.compile(value)
        except re.error as err:
            raise ValueError(f"{value!r} is no regular expression: {err}") from err
        return value

    @model_validator(mode="after")
    def _can_happen(self) -> FaultTable:
        if self.on not in self.places:
            raise ValueError(f"{self.kind} happens on {' or '.join(self.places)}, not on {self.on}")
        if not self.from_s < self.to_s:
            raise ValueError(f"from_s ({self.from_s:g}) must be before to_s ({self.to_s:g})")
        return self

    @property
    def when(self) -> When:
        """The operations at which it happens."""
        rule: dict[str, Any] = {name: getattr(self, name) for name in When.__dataclass_fields__}
        return When(**rule)
