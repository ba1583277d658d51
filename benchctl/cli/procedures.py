"""`benchctl procedures`: list the procedures."""

from __future__ import annotations

from benchctl.cli.output import BenchOption, JsonOption, QuietOption, result_of


def procedures(bench: BenchOption = "simulated", json_to: JsonOption = None, quiet: QuietOption = False) -> None:
    """List the scripted procedures: what each measures, its parameters, and its duration on a bench.

    Example: `benchctl procedures --bench bench.toml`
    """
    from benchctl.bench import load_bench
    from benchctl.campaign.check import bench_time_s
    from benchctl.cli.messages import duration, tell
    from benchctl.plan.find import installed_procedures
    from benchctl_instruments.errors import UsageError

    with result_of("procedures", json_to, quiet) as result:
        loaded = load_bench(bench)
        listed = []
        for name, procedure in installed_procedures():
            try:
                plan = procedure.expand()
            except UsageError as err:  # list the other procedures
                tell(f"benchctl: warning: {err}", err=True)
                continue
            takes_s = bench_time_s(plan, loaded)
            listed.append(
                {
                    "name": name,
                    "says": procedure.says,
                    "steps": len(plan.steps),
                    "bench_time_s": takes_s,
                    "calibrates": procedure.calibrates,
                    "parameters": [
                        {"name": p.name, "default": p.default, "says": p.says, "range": str(p.range)}
                        for p in procedure.parameters
                    ],
                }
            )
            result.say(
                f"{name}: {procedure.says}\n    {len(plan.steps)} steps, at least {duration(takes_s)} on {loaded.name}"
            )
            for p in procedure.parameters:
                value = ",".join(f"{v:g}" for v in p.default) if isinstance(p.default, tuple) else p.default
                limits = f" ({p.range})" if str(p.range) else ""
                result.say(f"    -p {p.name}={value}".ljust(38) + f" {p.says}{limits}")
            result.say("")
        result.values["procedures"] = listed
