"""`benchctl simulate`: record a procedure on the simulated bench, without the instrument protocols."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.output import (
    BenchOption,
    JsonOption,
    ParameterOption,
    ProcedureArgument,
    QuietOption,
    SeedOption,
    parameters,
    refuse_existing,
    result_of,
    toml_option,
)


def simulate(
    procedure: ProcedureArgument,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.h5", help="The recording to write.")],
    bench: BenchOption = "simulated",
    model: Annotated[
        Path | None,
        toml_option("--model", "A model file that the simulated bench follows, for example from a diagnosis."),
    ] = None,
    parameter: ParameterOption = None,
    seed: SeedOption = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Record a procedure on the simulated bench without the instrument protocols: same physics and runner, but faster.

    Example: `benchctl simulate rate_sweep -o sweep.h5 --seed 7`
    """
    import shutil
    import tempfile

    from benchctl.bench import load_bench
    from benchctl.cli.campaigns import play, told
    from benchctl.model_file import read_model
    from benchctl.plan.find import find_procedure
    from benchctl_instruments.errors import UsageError

    with result_of("simulate", json_to, quiet) as result:
        loaded = load_bench(bench)
        if not loaded.simulated:
            raise UsageError(f"--bench {bench}: expected a bench with simulated = true; benchctl run takes real ones")
        if model is not None:
            loaded = loaded.obeying(read_model(model))
        loaded = loaded.with_seed(seed)
        plan = find_procedure(procedure).expand(parameters(parameter))
        refuse_existing(output)
        if output.is_dir():
            raise UsageError(f"-o {output}: is a folder; name the file to write")
        if not output.parent.is_dir():
            raise UsageError(f"-o {output}: there is no folder {output.parent}; make it first")
        with tempfile.TemporaryDirectory(prefix=f".{output.name}.", dir=output.parent) as folder:
            outcome = play(plan, loaded, Path(folder), quiet=quiet, wires=False)
            if outcome.error is not None:
                raise outcome.error
            shutil.move(outcome.recording, output)
        result.values |= {**told(outcome), "recording": output}
        result.say(f"{output}: {outcome.whole} steps, {outcome.samples:,} samples in {outcome.wall_time_s:.1f} s")
