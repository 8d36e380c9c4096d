"""Meeting a robot: what it is, how fast it answers, whether its wheels do what they are told."""

import json
from dataclasses import replace

import pytest

from workbench.__main__ import main
from workbench.formation.config import SETTINGS
from workbench.formation.simulated import SimulatedRobot
from workbench.logs.hello import hello
from workbench.robot.wire.emulator import Emulator

CONFIG = replace(SETTINGS["infrared"], followers=1, drive="planar", seed=3)


@pytest.mark.parametrize("protocol", ["epuck1", "epuck2"])
def test_an_emulated_robot_passes_its_acceptance_test(protocol, tmp_path):
    body = SimulatedRobot(CONFIG)
    with Emulator(body, protocol, delay_s=0.01) as emulator:
        report = hello(emulator.url, move=True, out=tmp_path / "today.json")
        assert body._speed == (0, 0)
    assert report["version"] and report["lights"][:1] == ["ring"]
    assert 0.01 < report["delay_s"] < 0.2 and report["rate_hz"] > 5
    assert report["driven_m"] == pytest.approx(0.05, rel=0.1) and report["wheels_as_told"]
    assert report["turned_deg"] == pytest.approx(90, rel=0.1)
    stored = json.loads((tmp_path / "today.json").read_text())
    assert stored["delay_s"] == report["delay_s"]


def test_btcom_says_what_it_is_by_its_version_and_has_no_battery():
    with Emulator(SimulatedRobot(CONFIG), "epuck1-bt") as emulator:
        report = hello(emulator.url.replace("?variant=epuck1-bt", ""))
    assert report["variant"] == "epuck1-bt: open_robot(…, variant='epuck1-bt')"
    assert report["battery"] is None and "1.1.3" in report["version"]
    with Emulator(SimulatedRobot(CONFIG), "epuck1") as emulator:
        assert "variant" not in hello(emulator.url)


def test_wheels_that_do_something_else_are_told():
    body = SimulatedRobot(CONFIG)
    told = body.set_motors_speed
    body.set_motors_speed = lambda left, right: told(left // 2, right // 2)
    with Emulator(body, "epuck1") as emulator:
        assert not hello(emulator.url, move=True)["wheels_as_told"]


def test_nothing_moves_without_a_yes(capsys, monkeypatch):
    def no(*words, **kinds):
        raise KeyboardInterrupt

    with Emulator(SimulatedRobot(CONFIG), "epuck1") as emulator:
        monkeypatch.setattr("click.confirm", no)
        assert main(["hello", emulator.url, "--move"]) == 130
        assert not any(b"D,300" in data for _, data in emulator.heard)
        monkeypatch.undo()
        assert main(["hello", emulator.url]) == 0
        assert "driven_m" not in capsys.readouterr().out
    assert main(["robots"]) == 0
