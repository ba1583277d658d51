import pytest

from benchctl.bench import Limits
from benchctl.plan import Ask, ConstantRate, Home, Mount, Plan, PowerCycle, Sine, Soak, Static, ThermalRamp
from benchctl.reports.timeline import KIND_COLOURS, draw_timeline, timeline_figure
from benchctl_instruments.errors import UsageError

LIMITS = Limits(rate_dps=300, acceleration_dps2=1500, coldest_c=-55, hottest_c=85, ramp_c_per_min=2, silence_s=10)
STEPS = (
    Soak(setpoint_c=20.0, hold_s=3600.0),
    Static(duration_s=60.0),
    ConstantRate(rate_dps=-100.0, duration_s=30.0),
    Sine(amplitude_dps=165.0, frequency_hz=0.5, cycles=20, role="verify"),
    ThermalRamp(from_c=20.0, to_c=-20.0, ramp_c_per_min=1.0, rate_dps=10.0),
    PowerCycle(off_s=60.0),
    Mount(position="across"),
    Ask(says="close the chamber's door"),
    Home(),
)
SPANS = [
    (0.0, 3600.0, 20.0),
    (3600.0, 3660.0, 20.0),
    (3660.0, 3690.0, 20.0),
    (3690.0, 3730.0, 20.0),
    (3730.0, 6130.0, -20.0),
    (6130.0, 6190.0, -20.0),
    (6190.0, 6310.0, -20.0),
    (6310.0, 6430.0, -20.0),
    (6430.0, 6550.0, -20.0),
]


def plan(*steps):
    return Plan(procedure="example", parameters={}, steps=steps, calibrates=False)


def test_rates_are_bars_of_their_kinds_colour_and_the_chamber_a_line():
    chamber, table = timeline_figure(plan(*STEPS), SPANS).axes
    assert [bar.get_height() for bar in table.patches] == [100.0, 165.0, 10.0]
    assert chamber.lines[0].get_ydata()[-1] == -20.0
    assert chamber.lines[0].get_xdata()[-1] == pytest.approx(6550 / 3600)
    assert chamber.get_ylabel() == "chamber's set point (°C)"
    assert table.get_xlabel() == "bench time (h)"
    assert table.get_ylabel() == "largest |rate| (°/s)"


def test_the_legend_names_the_kinds_that_there_are_and_runs_kept_aside():
    figure = timeline_figure(plan(*STEPS), SPANS)
    named = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(named) == len(KIND_COLOURS) + 1
    assert named[-1] == "kept aside for verification"
    alone = timeline_figure(plan(STEPS[0]), SPANS[:1])
    assert [text.get_text() for text in alone.legends[0].get_texts()] == ["soak"]


def test_a_plan_without_steps_is_an_empty_picture():
    assert timeline_figure(plan(), []).axes[0].get_ylabel()


@pytest.mark.parametrize(("name", "begins"), [("t.svg", b"<?xml"), ("t.PNG", b"\x89PNG")])
def test_a_timeline_is_drawn_into_a_file_of_either_kind_the_same_each_time(tmp_path, name, begins):
    path = tmp_path / name
    draw_timeline(path, plan(*STEPS), LIMITS, 23.0)
    first = path.read_bytes()
    draw_timeline(path, plan(*STEPS), LIMITS, 23.0)
    assert first.startswith(begins)
    assert path.read_bytes() == first


def test_another_kind_of_file_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"t\.pdf: a picture is written as \.svg or \.png"):
        draw_timeline(tmp_path / "t.pdf", plan(*STEPS), LIMITS, 23.0)
    assert not list(tmp_path.iterdir())
