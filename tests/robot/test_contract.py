"""One contract for all back-ends of the robot API (R1): simulated, real protocols over real bytes,
recorded.
"""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

from workbench.formation.config import SETTINGS
from workbench.formation.simulated import SimulatedRobot
from workbench.logs.recordings import Recorder
from workbench.logs.replay import RecordingEnded
from workbench.robot.api import SENSORS
from workbench.robot.faults import NotConnected, NotSupported
from workbench.robot.motors import motor_speed
from workbench.robot.open import open_robot
from workbench.robot.wire.emulator import Emulator

CONFIG = replace(SETTINGS["infrared"], followers=1, drive="planar", seed=3)
# s: in lockstep a request that is repeated lets another period pass, and a busy machine answers
# late
PATIENT = 10.0
WIRES = {  # name: protocol, options of the driver
    "serial": ("epuck1", {}),
    "serial binary": ("epuck1", {"binary": True}),
    "board": ("epuck1", {"board": True}),
    "bluetooth": ("epuck1-bt", {"variant": "epuck1-bt"}),
    "overo": ("overo", {}),
    "tcp": ("epuck2", {}),
}
BACK_ENDS = ["sim", *WIRES, "log"]


@pytest.fixture
def backend(request, tmp_path):
    """A robot that is not connected yet; its emulator lives as long as the test."""
    name = request.param
    if name == "sim":
        yield SimulatedRobot(CONFIG)
    elif name == "log":
        path = tmp_path / "simulated.csv"
        with SimulatedRobot(CONFIG) as robot:
            robot.enable("proximity", "light", "floor", "motor_position")
            with Recorder(path, robot, link="sim:", real=False) as recorder:
                for _ in range(40):
                    robot.step()
                    robot.set_motors_speed(300, 200)
                    recorder.add(robot.time_s, robot, command=(300, 200))
        yield open_robot(f"log:{path}")
    else:
        protocol, options = WIRES[name]
        with Emulator(SimulatedRobot(CONFIG), protocol, rate=0) as emulator:
            yield open_robot(emulator.url, period_s=0.0, timeout_s=PATIENT, **options)


every = pytest.mark.parametrize("backend", BACK_ENDS, indirect=True)


@every
def test_connects_and_disconnects_any_number_of_times(backend):
    assert not backend.is_connected()
    for _ in range(3):
        assert backend.connect() and backend.connect() and backend.is_connected()
        backend.disconnect()
        backend.close()
        assert not backend.is_connected()


@every
def test_a_with_block_connects_and_ends_the_connection_also_after_an_exception(backend):
    with pytest.raises(ZeroDivisionError), backend:
        assert backend.is_connected()
        raise ZeroDivisionError
    assert not backend.is_connected()


@every
def test_every_sensor_that_is_promised_reads_plain_finite_numbers_in_range(backend):
    sizes = {
        "proximity": 8,
        "light": 8,
        "floor": 3,
        "motor_speed": 2,
        "motor_position": 2,
        "accelerometer": 3,
        "selector": 1,
        "battery": 1,
        "gyroscope": 3,
        "magnetometer": 3,
        "distance": 1,
        "temperature": 1,
        "button": 1,
        "remote": 3,
        "age": 1,
    }
    called = {"light": "light_sensor", "floor": "floor_sensors", "distance": "distance_sensor"}
    promised = [sensor for sensor in SENSORS if sensor in backend.capabilities]
    assert {"proximity", "motor_speed"} <= set(promised)
    with backend:
        backend.enable(*promised)
        assert backend.get_sensors_enabled() == promised
        for _ in range(3):
            assert backend.step()
            for sensor in promised:
                values = getattr(backend, f"get_{called.get(sensor, sensor)}")()
                if sensor == "range_bearing":
                    assert all(len(heard.data) == 4 and heard.range_m > 0 for heard in values)
                    continue
                assert isinstance(values, tuple) and all(
                    isinstance(v, float) and math.isfinite(v) for v in values
                )
                assert sensor == "microphone" or len(values) == sizes[sensor]
            assert all(0 <= value <= 4095 for value in backend.get_proximity())


@every
def test_what_is_not_promised_is_refused_with_what_is_there(backend):
    missing = [sensor for sensor in SENSORS if sensor not in backend.capabilities]
    with backend:
        for sensor in missing:
            with pytest.raises(NotSupported, match="proximity"):
                backend.enable(sensor)
        if "drive" not in backend.capabilities:
            with pytest.raises(NotSupported, match="cannot 'drive'"):
                backend.set_motors_speed(1, 1)


@every
def test_readings_need_a_connection_an_enabled_sensor_and_a_step(backend):
    with pytest.raises(NotConnected, match="connect"):
        backend.step()
    with backend:
        with pytest.raises(ValueError, match="not enabled; call enable"):
            backend.get_proximity()
        backend.enable("proximity")
        with pytest.raises(ValueError, match="call step"):
            backend.get_proximity()
        with pytest.raises(ValueError, match="unknown sensor 'sonar'.*proximity"):
            backend.enable("sonar")
        backend.step()
        backend.disable("proximity")
        with pytest.raises(ValueError, match="not enabled"):
            backend.get_proximity()


@every
def test_wheels_do_what_they_are_told_and_the_counters_count_it(backend):
    if "drive" not in backend.capabilities:
        pytest.skip("a recording cannot be driven")
    with backend:
        backend.enable("motor_position", "motor_speed", "proximity")
        backend.step()
        before = backend.get_motor_position()
        backend.set_motors_speed(300, -200)
        for _ in range(10):
            backend.step()
        after = backend.get_motor_position()
        assert backend.get_motor_speed() == (300.0, -200.0)
        # the firmware's quantisation: 300 becomes 303 steps/s; ten periods of 0.1 s
        assert after[0] - before[0] == pytest.approx(motor_speed(300), abs=2)
        assert after[1] - before[1] == pytest.approx(motor_speed(-200), abs=2)
        backend.stop()
        for _ in range(2):
            backend.step()
        still = backend.get_motor_position()
        backend.step()
        assert backend.get_motor_position() == still and backend.get_motor_speed() == (0.0, 0.0)


@every
@pytest.mark.parametrize("speed", [math.nan, math.inf, "300", True])
def test_impossible_speeds_are_refused_and_named(backend, speed):
    with backend, pytest.raises(ValueError, match="left = "):
        backend.set_motors_speed(speed, 0)


@every
def test_other_speeds_are_cut_as_pyepuck_and_the_firmware_do_and_said_once(backend):
    if "drive" not in backend.capabilities:
        pytest.skip("a recording cannot be driven")
    with backend:
        with pytest.warns(UserWarning, match=r"left = 300.7 was cut to 300 steps/s.*strict=True"):
            backend.set_motors_speed(300.7, np.float32(-200.2))
        assert backend.commanded == (300, -200)
        backend.set_motors_speed(5000, np.int64(-5000))
        assert backend.commanded == (backend.most_steps, -backend.most_steps)
        backend.strict = True
        with pytest.raises(ValueError, match="left = 5000"):
            backend.set_motors_speed(5000, 0)


@every
def test_words_of_other_clients_are_there_and_a_robot_without_a_camera_says_so(backend):
    with backend:
        assert backend.startsim() and backend.version
        for picture in (backend.get_image, backend.save_image, backend.get_camera_parameters):
            with pytest.raises(NotSupported, match="'camera'"):
                picture()
        with pytest.raises(NotSupported, match="'accelerometer_filter'"):
            backend.set_accelerometer_filtered(True)
        if "drive" in backend.capabilities:
            backend.enable("motor_position")
            backend.stepsim()
            begin = backend.get_motor_position()[0]
            backend.set_motors_speed(300, 300)
            backend.sleep(0.5)
            backend.stopsim()
            assert backend.commanded == (0, 0)
            backend.stepsim()
            if not backend.wired:  # simulated time has passed
                assert backend.get_motor_position()[0] - begin > 100


@every
def test_calibration_makes_idle_sensors_read_about_zero(backend):
    if "calibrate" not in backend.capabilities:
        pytest.skip("a recording cannot be calibrated")
    with backend:
        backend.enable("proximity")
        backend.step()
        before = np.array(backend.get_proximity())
        backend.calibrate_proximity_sensors()
        readings = []
        for _ in range(10):
            backend.step()
            readings.append(backend.get_proximity())
        idle = [1, 2, 3, 4, 5, 6]  # the front two see the leader
        assert np.all(before[idle] > 50) and np.mean(readings, axis=0)[idle].max() < 15


@every
def test_step_counters_count_on_where_sixteen_bits_wrap(backend):
    if not {"drive", "motor_position"} <= backend.capabilities:
        pytest.skip("no wheels")
    with backend:
        backend.set_motor_position(32700, -32700)
        backend.enable("motor_position", "proximity")
        backend.step()
        backend.set_motors_speed(1000, -1000)
        for _ in range(3):
            backend.step()
        left, right = backend.get_motor_position()
        assert left == pytest.approx(33000, abs=1) and right == pytest.approx(-33000, abs=1)


def test_a_recording_gives_its_readings_in_order_then_says_that_it_ended(tmp_path):
    path = tmp_path / "simulated.csv"
    seen = []
    with SimulatedRobot(CONFIG) as robot:
        robot.enable("proximity")
        with Recorder(path, robot, link="sim:", real=False) as recorder:
            for _ in range(5):
                robot.step()
                seen.append(robot.get_proximity())
                recorder.add(robot.time_s, robot, command=(0, 0))
    with open_robot(f"log:{path}") as replayed:
        replayed.enable("proximity")
        for expected in seen:
            replayed.step()
            assert replayed.get_proximity() == expected
        with pytest.raises(RecordingEnded, match="has 5 rows"):
            replayed.step()


SCRIPT = """
robot.connect()
robot.enable('proximity', 'motor_position')
robot.calibrate_proximity_sensors()
for turn in range(30):
    robot.step()
    front = max(robot.get_proximity()[0], robot.get_proximity()[7])
    if front > 150:
        robot.set_motors_speed(0, 0)
    else:
        robot.set_motors_speed(350, 350)
    robot.set_led(turn % 8, 2)
travelled = robot.get_motor_position()
robot.stop()
robot.close()
"""


def test_a_script_in_the_words_of_pyepuck_drives_all_robots_by_changing_the_constructor_only():
    results = []
    for name in ("sim", "serial", "overo", "tcp"):
        space = {}
        if name == "sim":
            space["robot"] = SimulatedRobot(CONFIG)
            exec(SCRIPT, space)
        else:
            protocol, options = WIRES[name]
            with Emulator(SimulatedRobot(CONFIG), protocol, rate=0) as emulator:
                space["robot"] = open_robot(
                    emulator.url, period_s=0.0, timeout_s=PATIENT, **options
                )
                exec(SCRIPT, space)
        results.append((space["travelled"], space["front"]))
    assert results[0] == results[1] == results[2] == results[3]
    assert results[0][0][0] > 400  # it did drive


def test_unknown_urls_are_refused_with_what_there_is():
    with pytest.raises(ValueError, match="expected sim:, serial:PORT"):
        open_robot("bluetooth:1")
    with pytest.raises(ValueError, match="has no address"):
        open_robot("tcp:")
    with pytest.raises(ValueError, match="expected HOST or HOST:PORT"):
        open_robot("tcp:robot:http")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(FileNotFoundError, match="expected the .csv"):
            open_robot("log:/nowhere.csv")
