"""Chamber profiles: what a lab writes of its controller's registers; a driver and a simulated controller of each."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path

from benchctl_instruments.chambers.profile import parse_profile, profile_text
from benchctl_instruments.chambers.profiled import ProfiledChamber
from benchctl_instruments.simulated.profiled import SimulatedProfiled
from tests.fuzz.harness import Harness, refusals, workplace
from tests.instruments.chamber_machine import FakeChamber, InstantClock
from tests.instruments.chambers.lab_controllers import ACME, BRAND


def one_input(data: bytes) -> None:
    path = workplace() / "lab.toml"
    path.write_bytes(data)
    with refusals():
        profile = parse_profile(profile_text(path), "lab.toml")
        json.dumps(profile.model_dump(mode="json"))
        ProfiledChamber("tcp://localhost:1", profile=profile, clock=InstantClock())
        SimulatedProfiled(FakeChamber(), profile=profile)


def seeds() -> list[bytes]:
    shipped = sorted(Path(str(files("benchctl_instruments.chambers.profiles"))).glob("*.toml"))
    return [ACME.encode(), BRAND.encode(), *(path.read_bytes() for path in shipped)]


HARNESS = Harness(
    name="chamber_profiles",
    weight=40,
    one_input=one_input,
    seeds=seeds,
    tokens=(
        b"[[alarms]]",
        b"[[checks]]",
        b"[[modes]]",
        b"[transport]",
        b"[busy]",
        b"[power]",
        b"kept_limits_c = ",
        b"address = 65535",
        b'kind = "f32"',
        b'by = "bit"',
        b'by = "nothing"',
        b"decimals = 3",
        b"decimals = { address = 1 }",
        b"bits = { 15 = ",
        b"words = { 0xFFFF = ",
        b"otherwise = ",
        b"runs = [{ first = 0, count = 125 }]",
        b"restricted = [[0, 65535]]",
        b"1e400",
        b"nan",
        b"9" * 400,
        b"a." * 100,
    ),
    longest=8192,
)
