"""Programs that others wrote for the real controllers, against the simulated ones.

PyMeasure's and InstrumentKit's ESP30x clients run as they are installed. Of clients that are no packages the dialogue
is reproduced: what they send, and what they need for an answer.
"""

from __future__ import annotations

import socket
import sys
import warnings
from collections.abc import Iterator
from functools import partial
from typing import Any

import pytest

from benchctl_instruments.links.address import parse_address
from benchctl_instruments.physics.table import TableParameters
from benchctl_instruments.simulated.acutrol3000 import SimulatedAcutrol3000
from benchctl_instruments.simulated.aerotech_ensemble import SimulatedEnsemble
from benchctl_instruments.simulated.clock import ScaledClock
from benchctl_instruments.simulated.machines import TableMachine
from benchctl_instruments.simulated.newport_esp301 import SimulatedEsp301
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World

START_DEG = 40.0
"""Where the table stands at power-up."""
by_pymeasure = partial(pytest.mark.foreign_client, "newport_esp301", "PyMeasure ESP300", package="pymeasure")
by_instrumentkit = partial(
    pytest.mark.foreign_client, "newport_esp301", "InstrumentKit NewportESP301", package="instrumentkit"
)


@pytest.fixture
def table() -> TableMachine:
    """A table with dynamics, twenty times as fast as the wall's clock."""
    parameters = TableParameters(start_angle_deg=START_DEG, rate_limit_dps=1000.0, acceleration_limit_dps2=8300.0)
    return World(ScaledClock(20.0), WorldSettings(table=parameters)).table


# Newport ESP301 -------------------------------------------------------------------------------------------------------


@pytest.fixture
def esp301_port(table: TableMachine) -> Iterator[str]:
    """The device of an ESP301's serial line."""
    if sys.platform == "win32":
        pytest.skip("Windows has no pseudo-terminals")
    with SimulatedEsp301(table) as esp301:
        yield esp301.address.removeprefix("serial://").partition("?")[0]


@pytest.fixture
def pymeasure_esp300(esp301_port: str) -> Iterator[Any]:
    adapters = pytest.importorskip("pymeasure.adapters", reason="PyMeasure is not installed: pip install pymeasure")
    newport = pytest.importorskip("pymeasure.instruments.newport")
    adapter = adapters.SerialAdapter(
        esp301_port, baudrate=19200, timeout=10.0, write_termination="\r", read_termination="\r\n"
    )
    with warnings.catch_warnings():  # PyMeasure does not know whether an ESP300 speaks SCPI
        warnings.simplefilter("ignore", FutureWarning)
        controller = newport.ESP300(adapter)
    yield controller
    adapter.close()


@by_pymeasure("homes, moves, limits, reads the axis")
def test_pymeasures_esp300_homes_moves_and_reads_the_axis(pymeasure_esp300: Any, table: TableMachine) -> None:
    controller, axis = pymeasure_esp300, pymeasure_esp300.x
    assert controller.id.startswith("ESP301 Version")
    controller.clear_errors()
    axis.enable()
    assert axis.enabled
    assert axis.position == 0.0  # not homed: it counts from where it was switched on
    assert table.motion().angle_deg == pytest.approx(START_DEG, abs=0.01)
    axis.home()
    axis.wait_for_stop()
    assert axis.position == pytest.approx(0.0, abs=0.01)
    assert table.motion().angle_deg == pytest.approx(0.0, abs=0.01)
    axis.position = 25.0
    axis.wait_for_stop(delay=0.01)
    assert axis.position == pytest.approx(25.0, abs=0.01)
    axis.define_position(100.0)
    assert axis.position == pytest.approx(100.0, abs=0.01)
    axis.zero()
    axis.left_limit, axis.right_limit = -90.0, 180.0
    assert (axis.left_limit, axis.right_limit) == (-90.0, 180.0)
    assert controller.errors == []
    axis.disable()
    assert not axis.enabled


@by_pymeasure("units")
def test_pymeasures_esp300_sets_each_unit_and_reads_it_back(pymeasure_esp300: Any) -> None:
    units = ("encoder count", "motor step", "millimeter", "radian", "microradian", "degree")
    for unit in units:
        pymeasure_esp300.x.units = unit
        assert pymeasure_esp300.x.units == unit
    assert pymeasure_esp300.errors == []


@by_pymeasure("errors")
def test_pymeasures_esp300_reads_what_was_wrong_from_the_queue(pymeasure_esp300: Any) -> None:
    controller = pymeasure_esp300
    for line in ("1XY", "9MO", "1VA", "1PA10", "1OR7", "hello", "2MO"):
        controller.write(line)
    said = [str(error).rpartition(": ")[2] for error in controller.errors]
    assert said == [
        "COMMAND DOES NOT EXIST",
        "AXIS NUMBER OUT OF RANGE",
        "COMMAND PARAMETER MISSING",
        "MOTOR NOT ENABLED",
        "MOTOR NOT ENABLED",
        "COMMAND DOES NOT EXIST",
        "MOTOR / STAGE NOT CONNECTED",
    ]
    controller.x.enable()
    for kind in (3, 4, 5, 6):  # of limit switches, which the stage does not have
        controller.x.home(kind)
    assert [error.error for error in controller.errors] == ["20"] * 4


@by_pymeasure("waits for the end of a motion")
def test_what_follows_a_wait_is_answered_at_the_end_of_the_motion(pymeasure_esp300: Any) -> None:
    controller = pymeasure_esp300
    controller.x.enable()
    controller.write("1VA4;1PR200;1MD?")  # slow: a busy machine is to ask while it still moves
    assert controller.read() == "0"
    controller.write("1WP20;1TP?;1MD?;1WS;1MD?;1DP?")
    passed_deg, still, done, goal_deg = (float(controller.read()) for _ in range(4))
    assert 20.0 <= passed_deg < 200.0
    assert (still, done, goal_deg) == (0.0, 1.0, pytest.approx(200.0, abs=0.01))
    assert controller.errors == []


@pytest.fixture
def instrumentkit_esp301(esp301_port: str) -> Iterator[Any]:
    # not `instruments` alone: where InstrumentKit is missing, that is a folder of the checkout
    newport = pytest.importorskip(
        "instruments.newport", reason="InstrumentKit is not installed: pip install 'instrumentkit>=1.0.0b2'"
    )
    serial = pytest.importorskip("serial")
    communicator = pytest.importorskip("instruments.abstract_instruments.comm").SerialCommunicator
    with serial.Serial(esp301_port, 19200, timeout=10.0) as port:
        yield newport.NewportESP301(communicator(port))


@by_instrumentkit("homes, moves, stops, reads the axis")
def test_instrumentkits_esp301_homes_moves_and_reads_the_axis(instrumentkit_esp301: Any, table: TableMachine) -> None:
    controller = instrumentkit_esp301
    axis = controller.axis[0]
    assert str(axis.units) == "degree"
    axis.enable()
    axis.search_for_home(search_mode=controller.HomeSearchMode.home_index_signals.value)
    axis.wait_for_motion(max_wait=10.0)
    assert axis.position.magnitude == pytest.approx(0.0, abs=0.01)
    assert table.motion().angle_deg == pytest.approx(0.0, abs=0.01)
    axis.velocity, axis.acceleration, axis.deceleration = 50.0, 200.0, 250.0
    assert [axis.velocity.magnitude, axis.acceleration.magnitude, axis.deceleration.magnitude] == [50.0, 200.0, 250.0]
    axis.move(30.0, wait=True, block=True)
    assert axis.position.magnitude == pytest.approx(30.0, abs=0.01)
    axis.move(-10.0, absolute=False)
    axis.wait_for_stop()
    assert axis.is_motion_done
    status = axis.get_status()
    assert status["position"].magnitude == pytest.approx(20.0, abs=0.01)
    assert status["desired_position"].magnitude == pytest.approx(20.0, abs=0.01)
    axis.move(300.0)
    axis.stop_motion()
    axis.wait_for_motion(max_wait=10.0)
    assert axis.position.magnitude < 290.0
    axis.abort_motion()
    axis.disable()


@by_instrumentkit("30 settings of the axis")
def test_instrumentkits_esp301_reads_and_writes_the_axis_set_up(instrumentkit_esp301: Any) -> None:
    axis = instrumentkit_esp301.axis[0]
    delivered = axis.read_setup()
    assert len(delivered) == 26
    wanted = {
        "units": 7,
        "motor_type": 4,
        "current": 1.5,
        "voltage": 24.0,
        "encoder_resolution": 0.001,
        "max_velocity": 400.0,
        "max_base_velocity": 20.0,
        "homing_velocity": 15.0,
        "jog_high_velocity": 30.0,
        "jog_low_velocity": 3.0,
        "max_acceleration": 800.0,
        "acceleration": 300.0,
        "velocity": 100.0,
        "deceleration": 350.0,
        "error_threshold": 0.5,
        "estop_deceleration": 700.0,
        "jerk": 4000.0,
        "proportional_gain": 12.0,
        "derivative_gain": 6.0,
        "integral_gain": 2.0,
        "integral_saturation_gain": 60.0,
        "trajectory": 2,
        "position_display_resolution": 5,
        "feedback_configuration": 0x300,
        "full_step_resolution": 0.02,
        "home": 0.0,
        "acceleration_feed_forward": 1.5,
        "microstep_factor": 200,
        "reduce_motor_torque_time": 1000,
        "reduce_motor_torque_percentage": 50,
    }
    set_up = axis.setup_axis(**wanted)
    read = {name: getattr(value, "magnitude", value) for name, value in set_up.items()}
    once = {"units", "feedback_configuration", "hardware_limit_configuration"}  # read otherwise than written
    assert {name: read[name] for name in read.keys() - once} == {name: wanted[name] for name in read.keys() - once}


@by_instrumentkit("errors")
def test_instrumentkits_esp301_raises_what_the_controller_reports(instrumentkit_esp301: Any) -> None:
    axis = instrumentkit_esp301.axis[0]
    for act, code in (
        (lambda: axis.move(10.0), 13),
        (axis.move_indefinitely, 38),  # InstrumentKit names no direction
        (lambda: setattr(axis, "velocity", 1e5), 10),
        (lambda: setattr(axis, "acceleration", 1e6), 11),
        (lambda: instrumentkit_esp301.run_program(3), 6),
    ):
        with pytest.raises(OSError, match="Newport Error") as caught:
            act()
        assert caught.value.errcode == code  # type: ignore[attr-defined]


def test_the_command_line_of_an_esp300_answers_as_one_was_seen_to(pymeasure_esp300: Any) -> None:
    """`*IDN?` with CR LF (public transcripts of an ESP300), `ID?`, `SU?` (a laboratory's admission of one), TS, PH."""
    controller = pymeasure_esp300
    answers = []
    for line in ("*IDN?\r\n", "1ID?", "1SU?", "TS", "PH", "1ZB?", "1OR?"):
        controller.write(line)
        answers.append(controller.read() if line != "1OR?" else str(controller.error))
    assert answers == ["ESP301 Version 3.0.1 simulated", "SIMULATED, SN1", "0.000500", "@", "0H, 0H", "300H", "6"]


MOVE_ACTIVE, DIRECTION = 0x8, 0x200  # of AXISSTATUS

# Dialogues ------------------------------------------------------------------------------------------------------------


def answered(address: str, dialogue: str) -> Iterator[tuple[str, str, str]]:
    """Lines `sent -> answer`, each with what came; `(rest)` waits until no axis of an Ensemble moves."""
    where = parse_address(address)
    with socket.create_connection((where.host, where.port), timeout=10.0) as wire, wire.makefile("rb") as answers:
        for line in dialogue.strip().splitlines():
            sent, _, wanted = (part.strip() for part in line.partition("->"))
            wire.sendall(f"{sent}\n".encode() if sent != "(rest)" else b"AXISSTATUS(@0)\n")
            came = answers.readline().decode().rstrip("\r\n")
            while sent == "(rest)" and int(came[1:]) & MOVE_ACTIVE:
                wire.sendall(b"AXISSTATUS(@0)\n")
                came = answers.readline().decode().rstrip("\r\n")
            if sent != "(rest)":
                yield sent, wanted, came


# Aerotech Ensemble ----------------------------------------------------------------------------------------------------

ROBMARKCOLE_AEROTECH = """
ENABLE X -> %
ENABLE Y -> %
ENABLE Z -> %
HOME X -> %
HOME Y -> %
HOME Z -> %
MOVEABS X10.000000 XF10.0 Y-2.500000 YF10.0 Z1.000000 ZF10.0 -> %
PFBK X -> %10.000000
PFBK Y -> %-2.500000
PFBK Z -> %1.000000
"""

ENSEMBLE_SOCKET_CONNECTION = """
ENABLE A -> %
SCURVE 100 -> %
MOVEABS A 1 F 80 -> %
MOVEABS A 0 F 80 -> %
DISABLE A -> %
"""

EPICS_MOTOR_AEROTECH = """
NONE -> !
GETPARM(@0, 140) -> %X
GETPARM(@0, 47) -> %2.000000
GETPARM(@0, 2) -> %1000.000000
GETPARM(@0, 77) -> %0.000000
GETPARM(@0, 75) -> %0.000000
GETPARM(@0, 61) -> %0.000000
RAMP MODE @0 RATE -> %
GETPARM(@0, 1) -> %0.000000
GETPARM(@1, 140) -> %Y
GETPARM(@3, 140) -> !
AXISFAULT @0 -> %0
FAULTACK @0 -> %
ENABLE @0 -> %
WAIT MODE NOWAIT -> %
SETPARM @0, 76, 30.00000 -> %
SETPARM @0, 75, 1 -> %
IGLOBAL(32) = 1 -> %
IGLOBAL(33) = 0 -> %
PROGRAM RUN 5, "HomeAsync.bcx" -> %
AXISSTATUS(@0) -> %-2147467255
ABORT @0 -> %
(rest)
POSOFFSET SET @0, 12.50000 -> %
PFBKPROG(@0) -> %12.500000
PCMDPROG(@0) -> %12.500000
PLANESTATUS(0) -> %0
INC -> %
RAMP RATE 500.00000 -> %
LINEAR @0 90.00000 F20.00000 -> %
PLANESTATUS(0) -> %1
ABORT @0 -> %
(rest)
SETPARM @0, 73, 500.00000 -> %
RAMP RATE @0 500.00000 -> %
DISABLE @0 -> %
FREERUN @0 25.00000 -> #
"""

ESRF_BLISS = """
ACKNOWLEDGEALL -> %
RAMP MODE RATE -> %
WAIT MODE NOWAIT -> %
ENABLE X -> %
ENABLE Y -> %
AXISSTATUS(X) -> %-2147483643
AXISFAULT(X) -> %0
VERSION -> %5.6.1 simulated
GETPARM(X,2) -> %1000.000000
SETPARM X, 75, 1 -> %
HOME X -> %
CMDPOS(X) -> %0.000000
RAMP RATE X 50.0 -> %
MOVEABS X 90.000000 Y 90.000000 XF 20.000000 YF 20.000000 -> %
ABORT X Y -> %
FREERUN X 0 -> %
ABORT -> %
DISABLE X -> %
"""

LAB_CONTROL_LIB = """
VERSION -> %5.6.1 simulated
WAIT MODE NOWAIT -> %
ENABLE @0 -> %
AXISSTATUS(@0) -> %-2147483643
HOME @0 -> %
AXISSTATUS(@0) -> %-2147483641
MOVEABS @0 90.000000 @0F 20.000000 -> %
AXISSTATUS(@0) -> %-2147483637
MOVEINC @0 5.000000 @0F 45.000000 -> #
ABORT @0 -> %
AXISFAULT(@0) -> %0
ACKNOWLEDGEALL -> %
"""


@pytest.mark.parametrize(
    "dialogue",
    [
        pytest.param(ROBMARKCOLE_AEROTECH, id="robmarkcole/aerotech aerotech.py"),
        pytest.param(ENSEMBLE_SOCKET_CONNECTION, id="EnsembleSocketConnection.py"),
        pytest.param(EPICS_MOTOR_AEROTECH, id="epics-motor/motorAerotech drvEnsembleAsyn.cc"),
        pytest.param(ESRF_BLISS, id="ESRF bliss aerotech.py"),
        pytest.param(LAB_CONTROL_LIB, id="optimato/lab-control-lib aerotech.py"),
    ],
)
@pytest.mark.foreign_client("aerotech_ensemble", "", "its commands, each answer checked")
def test_a_public_clients_dialogue_with_an_ensemble_is_answered_as_it_needs(table: TableMachine, dialogue: str) -> None:
    with SimulatedEnsemble(table) as ensemble:
        for sent, wanted, came in answered(ensemble.address, dialogue):
            if sent.startswith(("PFBK", "PCMD", "CMDPOS")):
                assert float(came[1:]) == pytest.approx(float(wanted[1:]), abs=0.01), sent
            elif sent.startswith("AXISSTATUS"):
                assert int(came[1:]) & ~DIRECTION == int(wanted[1:]), sent
            else:
                assert came == wanted, sent


# Acutronic ACUTROL3000 ------------------------------------------------------------------------------------------------

ACUTRONIC_ROBOTICS = """
:utility:lockout on -> OK
:interlock:open 1 -> OK
:interlock:reset 1 -> OK
:interlock:close 1 -> OK
:mode:position 1 -> OK
:demand:position 1, 40.000 -> OK
:mode:rate 1 -> OK
:demand:rate 1, 06.300 -> OK
:read:rate 1 -> 1.0
:read:position 1 -> 1.0
:demand:rate 1, 00.000 -> OK
:mode:off 1 -> OK
:interlock:open 1 -> OK
"""

IEAV_EFO = """
*idn? -> simulated,ACUTROL3000,1,0
:read:pos? 1;rate? 1;acc? 1 -> 1.0;1.0;1.0
:interlock? 1 -> Open
*stb? -> 0
:Interlock:Reset -> OK
:mode:off 1 -> OK
:int:close 1 -> OK
:mode:synt 1 -> OK
:dem:osc 1,0,0,0 -> OK
:mode:rate 1 -> OK
:dem:rate 1,0 -> OK
:mode? 1 -> Rate
:limit:absolute? 1 -> 1000.000000,8300.000000,0,-360,360,1100.000000
:limit:acc? pos,1 -> 8300.000000
:limit:rate? synt,1 -> 1000.000000
:lim:acc pos,1,4200 -> OK
:lim:rate synt,1,900 -> OK
:limit:acc? pos,1 -> 4200.000000
:mode 1,pos -> OK
:mode? 1 -> Position
:dem:pos 1,40 -> OK
:dem:delta 1,179 -> OK
:con:osc 1,Enable,2.0,0.1,Pos,Lin -> OK
:con:osc? 1 -> Enable,2.000000,0.100000,Pos,Lin
:mode 1,rate -> OK
:int:open 1 -> OK
"""

IEAV_EFO_ROUTINE = """
:Interlock:Reset -> OK
:int:close 1 -> OK
:limit ALL,P,100,100,1 -> OK
:limit ALL,R,90,80,1 -> OK
:limit:rate? pos,1;rate? rate,1;acc? rate,1 -> 100.000000;90.000000;80.000000
:d:p 1,0 -> OK
:d:p? 1 -> 0.000000
:m:p ALL -> OK
:d:r 1,0 -> OK
:m:r 1 -> OK
:d:r 1,10 -> OK
:d:r 1,-10 -> OK
:d:r 1,0 -> OK
"""

WILLIAMSEA = """
u:t 179,179,176,32,152,151,32,50,176,181,181,181 -> OK
:I:R -> OK
:I:C 1 -> OK
:M:P 1 -> OK
:u:f f ; :R:P 1 -> 1.0
:u:f f ; :R:R 1 -> 1.0
:u:f f ; :R:A 1 -> 1.0
:D:P 1, 0 -> OK
:D:R 1, 5 -> OK
:D:A 1, 20 -> OK
:L :L P 1 -30; :L :H P 1 30 -> OK
:L :R P 1 60 -> OK
:L :A P 1 70 -> OK
:L :R A 1 50 -> OK
:L :A A 1 500 -> OK
:L :V S 1 990 -> OK
:limit:rate? pos,1;rate? abort,1;acc? abort,1 -> 60.000000;50.000000;500.000000
:C:W 1, 1082 -> OK
:M:S 1 -> OK
:D:O 1, 5, 0.5, 0 -> OK
:I:O 1 -> OK
"""


@pytest.mark.parametrize(
    "dialogue",
    [
        pytest.param(ACUTRONIC_ROBOTICS, id="AcutronicRobotics/acutrol acutrol.py, ac117.json"),
        pytest.param(IEAV_EFO, id="IEAv-EFO/acutrol3000 python/acutrol3000.py"),
        pytest.param(IEAV_EFO_ROUTINE, id="IEAv-EFO/acutrol3000 examples/routine_example.cfg"),
        pytest.param(WILLIAMSEA, id="williamsea/Acutrol Form1.cs"),
    ],
)
@pytest.mark.foreign_client("acutrol3000", "", "its commands, each answer checked")
def test_a_public_clients_dialogue_with_an_acutrol_is_answered_as_it_needs(table: TableMachine, dialogue: str) -> None:
    """Each reply behind its header of 8 characters, which the clients on TCP strip; `1.0` stands for any number."""
    with SimulatedAcutrol3000(table) as acutrol:
        for sent, wanted, came in answered(acutrol.address, dialogue):
            said = came[8:]
            if "1.0" in wanted.split(";"):
                assert len([float(word) for word in said.split(";")]) == len(wanted.split(";")), sent
            else:
                assert said == wanted, sent
