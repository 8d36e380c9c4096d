"""An e-puck2 as its firmware is: a stream of packets at 45 Hz, header and payload apart, none for
two seconds after calibrating, lights in bits and colours.
"""

from dataclasses import replace

import pytest

from tests.robot.wires import SteppedClock, Stream
from workbench.formation.config import SETTINGS
from workbench.formation.simulated import SimulatedRobot
from workbench.robot.api import SENSORS
from workbench.robot.wire.epuck2 import EPuck2Robot, lights_of
from workbench.robot.wire.firmware import CALIBRATION_S, EPuck2Firmware

CONFIG = replace(SETTINGS["infrared"], followers=1, drive="planar", seed=3)


class Counting:
    """A body that stands still; its proximity readings tell how many packets were made."""

    def __init__(self, robot):
        self._robot = robot
        self.made = 0

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def get_proximity(self):
        self.made += 1
        return (self.made % 4000,) * 8

    def step(self):
        return True


@pytest.fixture
def streamed():
    with SimulatedRobot(CONFIG) as body:
        body.enable(*(sensor for sensor in SENSORS if sensor in body.capabilities))
        body.step()
        clock = SteppedClock()
        link = Stream(EPuck2Firmware(Counting(body)), clock)
        yield EPuck2Robot("memory", watchdog_s=None, clock=clock, link=lambda: link), link


def test_ten_thousand_periods_of_split_packets_are_read_without_an_error(streamed):
    robot, link = streamed
    with robot:
        robot.enable("proximity")
        last = -1
        for _ in range(10_000):
            robot.step()
            made = robot.get_proximity()[0]
            assert made != last  # never an old packet again
            assert (link.firmware._body.robot.made - made) % 4000 <= 1  # and none but the newest
            last = made
            robot.set_motors_speed(200, 200)
        assert robot.missed_deadlines == 0
        assert link.packets > 10_000


def test_calibration_waits_until_the_robot_hears_and_sends_again(streamed):
    robot, _ = streamed
    with robot:
        begun = robot.clock.now()
        robot.calibrate_proximity_sensors()
        assert CALIBRATION_S <= robot.clock.now() - begun < 3.0
        robot.enable("proximity")
        robot.step()
        robot.set_motors_speed(300, 300)
        assert robot.commanded == (300, 300)


def test_every_light_is_the_one_that_was_asked_for(streamed):
    robot, link = streamed
    lit = {}
    body = link.firmware._body.robot
    body.set_led = lit.__setitem__
    body.set_body_led = lambda value: lit.__setitem__("body", value)
    body.set_front_led = lambda value: lit.__setitem__("front", value)
    with robot:
        for led in range(8):
            robot.set_led(led, 1)
            assert [key for key, value in lit.items() if value] == [led]
            robot.set_led(led, 0)
        robot.set_body_led(1)
        assert [key for key, value in lit.items() if value] == ["body"]
        robot.set_body_led(0)
        robot.set_front_led(1)
        assert [key for key, value in lit.items() if value] == ["front"]
        robot.set_led(8, 1)  # another number than 0 to 7: all of the ring
        assert all(lit[led] for led in range(8)) and not lit["body"]
    assert lights_of([0] * 10) == bytes(13)
