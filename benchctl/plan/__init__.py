"""The building blocks of a procedure: steps, patterns of steps, and the `procedure` decorator.

>>> from benchctl.plan import Soak, Static, procedure
>>> @procedure()
... def rest(at_c: float = 20.0):
...     '''The output at rest.'''
...     yield Soak(setpoint_c=at_c, hold_s=1800.0)
...     yield Static(duration_s=60.0)
>>> [step.kind for step in rest.expand({"at_c": "25"}).steps]
['soak', 'static']
"""

from benchctl.plan.patterns import (
    across,
    alternating,
    axis_mounts,
    levels,
    rate_cycle,
    rates_between_zeros,
    set_points,
    slow_swing,
    small_steps,
    turn_ons,
    whole_cycles,
    whole_revolutions,
)
from benchctl.plan.procedure import POSITIVE, Parameter, Plan, Procedure, Range, procedure
from benchctl.plan.steps import Ask, ConstantRate, Home, Mount, PowerCycle, Role, Sine, Soak, Static, Step, ThermalRamp

__all__ = [
    "POSITIVE",
    "Ask",
    "ConstantRate",
    "Home",
    "Mount",
    "Parameter",
    "Plan",
    "PowerCycle",
    "Procedure",
    "Range",
    "Role",
    "Sine",
    "Soak",
    "Static",
    "Step",
    "ThermalRamp",
    "across",
    "alternating",
    "axis_mounts",
    "levels",
    "procedure",
    "rate_cycle",
    "rates_between_zeros",
    "set_points",
    "slow_swing",
    "small_steps",
    "turn_ons",
    "whole_cycles",
    "whole_revolutions",
]
