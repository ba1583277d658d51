"""Read the law from the content of a `coefficients.json`; validate every number."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from benchctl.calibration.applied_law import AppliedLaw, Factors
from benchctl.limits import listed
from benchctl.recordings.import_open import first_fault
from benchctl_instruments.errors import UsageError

By = Literal["joint", "stages"]

_MOST_TERMS = 16
_MOST_STAGES = 8
_MOST_SOURCES = 1000
_TERM = re.compile(r"([abcg])(\d{1,2})")

_Terms = Annotated[list[float], Field(max_length=_MOST_TERMS)]


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _Factor(_Part):
    coefficients: _Terms


class _Stage(_Part):
    k_t: _Factor = Field(alias="k_T")
    k_omega: _Factor
    U0_T: _Terms = []
    delay_s: float = 0.0


class _Parameter(_Part):
    value: float


class _Joint(_Part):
    law: Literal["sine", "polynomial", "response"]
    parameters: dict[str, _Parameter]


class _Valid(_Part):
    rate_dps: Annotated[list[float], Field(min_length=2, max_length=2)]
    temperature_c: Annotated[list[float | None], Field(min_length=2, max_length=2)]


class _Expanded(_Part):
    expanded: float | None = None


class _Uncertainty(_Part):
    k: float = 2.0
    parameters: dict[str, _Expanded] = {}


class _Source(_Part):
    recording: str
    digest: str


class Coefficients(_Part):
    """What compensation needs of the file's content; everything else in it is free."""

    unit: str | None = None
    output_unit: str = "V"
    convention: Literal["correction", "response"]
    K0_v_per_dps: float
    U0_v: float
    T0_c: float | None
    stages: Annotated[list[_Stage], Field(min_length=1, max_length=_MOST_STAGES)]
    joint: _Joint | None = None
    valid: _Valid | None = None
    uncertainty: _Uncertainty = _Uncertainty()
    source: Annotated[list[_Source], Field(max_length=_MOST_SOURCES)] = []
    error_percent: dict[str, float | None] = {}
    earth_rate_dps: float = 0.0


def checked(content: Mapping[str, Any], where: str) -> Coefficients:
    """The content with the types it should have; `where` begins the `UsageError` where it has others."""
    try:
        return Coefficients.model_validate(content)
    except ValidationError as err:
        raise UsageError(f"{where}: {first_fault(err)}; write it with `benchctl fit`") from err


def applied_law(found: Coefficients, by: By) -> AppliedLaw:
    """The law of the joint fit, or that of the stages; `UsageError` where there is none or it can give no rate."""
    law = _of_stages(found) if by == "stages" else _of_joint(found)
    if law.K0_v_per_dps == 0.0 or (law.name == "sine" and law.S_rad_per_dps == 0.0):
        raise UsageError(
            "the scale factor, or S of the sine, is 0, which gives no rate for an output; write it with `benchctl fit`"
        )
    if found.T0_c is None and law.knows_temperature:
        raise UsageError("T0_c is null, though the law depends on the temperature; write it with `benchctl fit`")
    return law


def is_of_law(name: str, law: AppliedLaw) -> bool:
    """Whether a parameter of the file is one of the law's own: no encoder's error, and S of a sine alone."""
    own = ("K0_v_per_dps", "U0_v", "delay_s", *(("S_rad_per_dps",) if law.name == "sine" else ()))
    return name in own or _TERM.fullmatch(name) is not None


def _of_joint(found: Coefficients) -> AppliedLaw:
    joint = found.joint
    if joint is None:
        raise UsageError("these coefficients hold no joint fit; compensate by their stages")
    values = {name: parameter.value for name, parameter in joint.parameters.items()}
    sine = joint.law == "sine"
    for name in ("K0_v_per_dps", "U0_v", *(("S_rad_per_dps",) if sine else ())):
        if name not in values:
            raise UsageError(f"the joint fit, law {joint.law}, has no {name}; write it with `benchctl fit`")
    return AppliedLaw(
        name=joint.law,
        K0_v_per_dps=values["K0_v_per_dps"],
        U0_v=values["U0_v"],
        T0_c=found.T0_c or 0.0,
        bias=_terms(values, "c", 1),
        S_rad_per_dps=values["S_rad_per_dps"] if sine else 0.0,
        stages=(Factors(k_t=_terms(values, "g" if sine else "a", 1), k_omega=() if sine else _terms(values, "b", 2)),),
        delay_s=values.get("delay_s", 0.0),
    )


def _of_stages(found: Coefficients) -> AppliedLaw:
    """K0, U0 and the bias are those of the last stage."""
    response = found.convention == "response"
    if response and len(found.stages) != 1:
        raise UsageError(
            f"a response of {len(found.stages)} stages has no one inverse, expected one stage; "
            "write it with `benchctl fit`"
        )
    last = found.stages[-1]
    return AppliedLaw(
        name="response" if response else "polynomial",
        K0_v_per_dps=found.K0_v_per_dps,
        U0_v=found.U0_v,
        T0_c=found.T0_c or 0.0,
        bias=tuple(last.U0_T),
        S_rad_per_dps=0.0,
        stages=tuple(
            Factors(k_t=tuple(stage.k_t.coefficients), k_omega=tuple(stage.k_omega.coefficients))
            for stage in found.stages
        ),
        delay_s=last.delay_s,
    )


def _terms(values: Mapping[str, float], letter: str, power: int) -> tuple[float, ...]:
    """The coefficients of a polynomial in the power `power`: `a1`, `a2`, … by 1, `b2`, `b4`, … by 2."""
    found = {int(term[2]): values[name] for name in values if (term := _TERM.fullmatch(name)) and term[1] == letter}
    if any(order == 0 or order % power or order // power > _MOST_TERMS for order in found):
        raise UsageError(
            f"the joint fit has the terms {listed([f'{letter}{order}' for order in found])}, which are no "
            "polynomial's; "
            "write it with `benchctl fit`"
        )
    orders = range(power, max(found, default=0) + 1, power)
    return tuple(found.get(order, 0.0) for order in orders)
