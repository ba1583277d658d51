"""benchctl from Python: plan, run, open, fit, diagnose and accept, each a function that gives a frozen result.

>>> from benchctl import api
>>> plan = api.plan("rate_sweep", soak_s=600, rates=3, run_s=10, zero_s=10)
>>> outcome = api.run(plan, out="sweep", seed=7)
>>> fitted = api.fit(outcome)
>>> fitted.error_percent["joint"] < 0.1 < fitted.error_percent["raw"]
True

What cannot be used, and what a bench refuses, is an error of `benchctl_instruments.errors`, all of them `BenchError`,
in one line. Nothing here prints, asks or needs a terminal, but for the steps that a person does on a real bench. It
works in a notebook and outside the main thread, where only signals cannot stop a run.
"""

from benchctl.api.planning import plan
from benchctl.api.reading import Source, open
from benchctl.api.results import Accepted, Diagnosed, Fitted, accept, diagnose, fit
from benchctl.api.running import run
from benchctl.bench import Bench, load_bench
from benchctl.campaign.progress import Moment
from benchctl.campaign.runner import Outcome
from benchctl.plan import Plan, Procedure
from benchctl.recordings.reader import Recording
from benchctl_instruments.errors import BenchError, InstrumentError, LinkError, SafetyError, UsageError

__all__ = [
    "Accepted",
    "Bench",
    "BenchError",
    "Diagnosed",
    "Fitted",
    "InstrumentError",
    "LinkError",
    "Moment",
    "Outcome",
    "Plan",
    "Procedure",
    "Recording",
    "SafetyError",
    "Source",
    "UsageError",
    "accept",
    "diagnose",
    "fit",
    "load_bench",
    "open",
    "plan",
    "run",
]
