"""What a lab writes by hand: bench.toml, map files, model files, chamber profiles. The first byte says which it is."""

from __future__ import annotations

from benchctl.bench import Bench, template
from benchctl.model_file import read_model
from benchctl.recordings.column_map import parse_map
from benchctl.toml_file import parse_toml
from benchctl_instruments.physics.effects.making import make_effects
from benchctl_instruments.simulated.settings import WorldSettings
from tests.fuzz.harness import Harness, refusals, workplace

_KINDS = (b"b", b"m", b"d")

MAP = """
[unit]
serial = "VG-7"
[bench]
sample_rate_hz = 10.0
[time]
column = "t"
unit = "ms"
stamps = "repair"
[channels.encoder_deg]
column = "angle"
unit = "counts"
counts_per_rev = 65536
[channels.gyro_v]
column = "out"
unit = "mV"
[channels.coil_ma]
column = 4
unit = "mA"
[[steps]]
name = "rest"
kind = "static"
t_end = 1.0
"""

POINTS_MAP = """
[unit]
serial = "VG-7"
[points.rate]
column = "r"
unit = "rpm"
[points.mean]
column = "m"
unit = "V"
"""

_MODEL = """
format = "benchctl-model/1"
recording = "a.h5"
[simulation]
K0_v_per_dps = 0.02
U0_v = 0.01
T0_c = 23.0
k_T = [1e-4]
k_omega = [3e-6]
noise_v_rms = 0.0005
output_limit_v = 4.0
[effects.thermal_lag]
tau_s = 312.0
[physics.table]
resonance_hz = 30.0
[parts.drive]
inertia_kg_m2 = 0.1
[parts.drive.effects.coulomb_friction]
torque_nm = 0.2
"""


def one_input(data: bytes) -> None:
    kind, text = data[:1], data[1:]
    with refusals():
        if kind == b"b":
            bench = parse_toml(text.decode("utf-8", "replace"), Bench, "bench.toml")
            make_effects(bench.effects)
            WorldSettings.from_mapping(bench.physics)
        elif kind == b"m":
            parse_map(text.decode("utf-8", "replace"), "map.toml")
        else:
            path = workplace() / "model.toml"
            path.write_bytes(text)
            read_model(path)


def seeds() -> list[bytes]:
    texts = [(b"b", template()), (b"m", MAP), (b"m", POINTS_MAP), (b"d", _MODEL), (b"d", "[gyro]\nscale = 1.0\n")]
    return [kind + text.encode() for kind, text in texts]


HARNESS = Harness(
    name="toml_files",
    weight=5,
    one_input=one_input,
    seeds=seeds,
    tokens=(
        *_KINDS,
        b"[channels.",
        b"[points.",
        b"[effects.",
        b"[parts.chamber]",
        b"[physics.",
        b"[[steps]]",
        b"[[interlocks]]",
        b"column = ",
        b"unit = ",
        b"1e400",
        b"nan",
        b"-inf",
        b"0x" + b"f" * 40,
        b"5e-324",
    ),
    longest=8192,
)
