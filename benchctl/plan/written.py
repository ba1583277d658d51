"""Write a plan as the source of a procedure, and its parameters as command line arguments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

from benchctl.plan.procedure import Plan
from benchctl.plan.steps import Step


def plan_source(plan: Plan, description: str) -> str:
    """Return the source of a procedure that yields the plan's steps; its docstring begins with `description`."""
    kinds = sorted({type(step).__name__ for step in plan.steps}, key=str.lower)
    given = ", ".join(f"{name}={text}" for name, text in as_texts(plan.parameters).items())
    return "\n".join(
        [
            f"from benchctl.plan import {', '.join([*kinds, 'procedure'])}",
            "",
            "",
            "@procedure()",
            f"def {plan.procedure}():",
            f"    {' '.join(description.split())!r}",
            f"    # the steps of {plan.procedure}({given})",
            *(f"    yield {_call(step)}" for step in plan.steps),
            "",
        ]
    )


def as_texts(parameters: Mapping[str, Any]) -> dict[str, str]:
    """Return parameters as texts for `-p NAME=VALUE`."""
    return {
        name: ",".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
        for name, value in parameters.items()
    }


def _call(step: Step) -> str:
    """Return the call that creates a step, without arguments equal to their defaults."""
    given = {field.name: getattr(step, field.name) for field in fields(step)}
    usual = {field.name: field.default for field in fields(step) if field.default is not MISSING}
    items = [f"{name}={_literal(value)}" for name, value in given.items() if name not in usual or usual[name] != value]
    return f"{type(step).__name__}({', '.join(items)})"


def _literal(value: Any) -> str:
    return repr(value) if isinstance(value, int | str) else repr(float(value))
