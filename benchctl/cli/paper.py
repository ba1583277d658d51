"""`benchctl paper`: reproduce and audit the paper's experiment."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from benchctl.cli.output import JsonOption, QuietOption, SeedOption, out_option, result_of

if TYPE_CHECKING:
    from benchctl.calibration.paper_audit import PaperAudit


def paper(
    out: Annotated[Path | None, out_option("Keep the recording, coefficients and report here.")] = None,
    seed: SeedOption = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Reproduce the paper's experiment on a simulated VG910Q, print both tables side by side, and audit its numbers.

    The simulated unit follows the interferometer's sine law with the value of S implied by the paper's polynomial.

    Example: `benchctl paper --out paper`
    """
    import tempfile
    from dataclasses import asdict

    from benchctl.app.fit import fit
    from benchctl.app.run import play
    from benchctl.bench import load_bench
    from benchctl.calibration.paper_audit import audit, implied_sine
    from benchctl.cli.campaigns import at_terminal
    from benchctl.plan.find import find_procedure
    from benchctl.recordings.reader import open_recording

    with result_of("paper", json_to, quiet) as result, tempfile.TemporaryDirectory() as scratch:
        S_rad_per_dps = implied_sine()[0]
        loaded = load_bench("simulated")
        physics = {**loaded.physics, "gyro": {"S_rad_per_dps": S_rad_per_dps}}
        loaded = loaded.model_copy(update={"physics": physics}).with_seed(seed)
        folder = out or Path(scratch) / "paper"
        outcome = play(find_procedure("two_stage").expand(), loaded, folder, watch=at_terminal(quiet), wires=False)
        outcome.raise_error()
        with open_recording(outcome.recording) as recording:
            found = audit(recording.steps(), recording.meta)
        result.values |= {
            "S_rad_per_dps": S_rad_per_dps,
            "points": [asdict(point) for point in found.points],
            "table": [asdict(row) for row in found.rows],
        }
        result.say(_table(found))
        if out is not None:
            report = fit([outcome.recording], out=folder).files["report"]
            files = {"recording": outcome.recording, "report": report}
            result.values |= files
            result.say_files(files)


def _table(found: PaperAudit) -> str:
    lines = [f"{'quantity':<58}{'paper':>22}{'ours':>14}  unit"]
    for row in found.rows:
        ours = "not measured" if row.ours is None else f"{row.ours:.5g}"
        lines.append(f"{row.quantity:<58}{row.paper:>22}{ours:>14}  {row.unit}")
    for point in found.points:
        lines.append(f"\n{point.number}. {point.claim}")
        lines += [f"   {name} = {value:.5g}" for name, value in point.computed.items()]
        lines.append(f"   {point.verdict}")
    return "\n".join(lines)
