"""The C file of a policy against the policy, on every reading that matters."""

import ctypes
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import workbench as wb
from workbench.formation.solo import SoloFollower
from workbench.logs.export_c import MOST, export_c, merged

RAW = replace(wb.SETTINGS["infrared"], sensing="ir-raw", followers=1)
GCC = shutil.which("gcc")
needs_gcc = pytest.mark.skipif(GCC is None, reason="no gcc on this machine")


def _policy(config, seed=0):
    return wb.Policy.of(
        config, np.random.default_rng(seed).normal(size=(1, config.rows, config.action_count))
    )


def _compiled(path):
    library = path.with_suffix(".so")
    flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O2", "-shared", "-fPIC"]
    subprocess.run([GCC, *flags, "-o", library, path], check=True, capture_output=True)
    call = ctypes.CDLL(str(library)).gq_policy
    call.restype = None

    def speeds(left, right):
        a, b = ctypes.c_int16(), ctypes.c_int16()
        call(ctypes.c_uint16(left), ctypes.c_uint16(right), ctypes.byref(a), ctypes.byref(b))
        return a.value, b.value

    return speeds


@needs_gcc
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"state_tiles": (5, 5), "action_levels": (3, 3)},
        {"state_tiles": (5, 5), "tilings": 4},
        {"state_tiles": (1, 3)},
        {"state_tiles": (1, 1)},
        {"distance_tiling": "uniform", "bearing_tiling": "uniform", "action_levels": (17, 17)},
    ],
)
def test_c_and_python_agree_on_every_tile_and_edge(tmp_path, changes):
    config = replace(RAW, **changes)
    policy = _policy(config)
    sizes = export_c(policy, tmp_path / "policy.c")
    speeds = _compiled(tmp_path / "policy.c")
    grids = config.grids()
    theta = policy.theta[0]

    def choose(left, right):
        value = np.zeros(config.action_count)
        first = 0
        for grid in grids:
            value = value + theta[first + grid.index(left, right)]
            first = first + grid.n
        action = int(np.argmax(value))
        return int(policy.left_steps[action // len(policy.right_steps)]), int(
            policy.right_steps[action % len(policy.right_steps)]
        )

    marks = []
    for axis in (0, 1):
        edges = np.unique(np.concatenate([grid.tilings[axis].edges for grid in grids]))
        near = {int(np.floor(edge)) + step for edge in edges for step in (-1, 0, 1)}
        marks.append(sorted({mark for mark in near | {0, MOST} if 0 <= mark <= MOST}))
    for left in marks[0]:
        for right in marks[1]:
            assert speeds(left, right) == choose(float(left), float(right)), (left, right)
    assert sizes["cells"] == merged(policy)[2].size


@needs_gcc
def test_c_drives_as_the_compiled_follower_does(tmp_path):
    policy = _policy(RAW, 3)
    export_c(policy, tmp_path / "policy.c")
    speeds = _compiled(tmp_path / "policy.c")
    follower = SoloFollower(RAW, policy)
    followed = 0
    for left in range(15, 400, 7):
        for right in range(15, 400, 11):
            readings = np.zeros(8)
            readings[7] = left
            readings[0] = right
            commands = follower.decide(readings)
            if follower.record["reset"]["phase"] == 0:
                followed += 1
                assert commands == speeds(left, right)
    assert followed > 100


def test_the_file_uses_whole_numbers_and_calls_nothing(tmp_path):
    sizes = export_c(_policy(RAW), tmp_path / "policy.c", source="a */ sneaky /* source\nof words")
    text = (tmp_path / "policy.c").read_text()
    assert not {"float", "double", "malloc", "printf"} & set(text.replace("(", " ").split())
    assert (
        text.count("#include") == 1
        and "#include <stdint.h>" in text
        and sizes["table_bytes"] < 1000
    )
    assert text.count("*/") == text.count("/*") == 2  # what the file is, when to begin


def test_what_cannot_be_exported_is_refused(tmp_path):
    metric = replace(RAW, sensing="ir-metric")
    with pytest.raises(
        ValueError,
        match=r"sensing = 'ir-metric', tiles in m and rad; expected counts.*Learn with "
        r"sensing='ir-raw'",
    ):
        export_c(_policy(metric), tmp_path / "policy.c")
    with pytest.raises(ValueError, match="expected a name that ends in .c"):
        export_c(_policy(RAW), tmp_path / "policy.h")
    with pytest.raises(ValueError, match="table = 1; the policy has tables 0 to 0"):
        export_c(_policy(RAW), tmp_path / "policy.c", table=1)
    warped = replace(RAW, infrared=replace(RAW.infrared, warp="offset"))
    with pytest.raises(ValueError, match="learned on distorted readings"):
        export_c(_policy(warped), tmp_path / "policy.c")
    assert_array_equal(list(tmp_path.iterdir()), [])


@needs_gcc
@pytest.mark.parametrize("tiles", [{}, {"state_tiles": (5, 5), "tilings": 4}])
@pytest.mark.parametrize("output", ["greedy", "interpolated"])
@pytest.mark.parametrize("trim", [0.0, 0.02])
def test_c_makes_the_same_of_a_table_as_the_follower_bit_for_bit(tmp_path, tiles, output, trim):
    config = replace(RAW, output=output, trim=trim, **tiles)
    policy = _policy(config, 7)
    export_c(policy, tmp_path / "policy.c", config=config)
    speeds = _compiled(tmp_path / "policy.c")
    begin = ctypes.CDLL(str(tmp_path / "policy.so")).gq_begin
    assert speeds(65535, 65535) == speeds(4095, 4095)  # no reading is beyond a table
    begin()
    follower = SoloFollower(config, policy)
    rng = np.random.default_rng(5)
    followed, different = 0, 0
    left, right = 120.0, 120.0
    for _ in range(4000):
        left, right = (
            float(np.clip(round(x * np.exp(0.2 * rng.standard_normal())), 20, 700))
            for x in (left, right)
        )
        readings = np.zeros(8)
        readings[7] = left
        readings[0] = right
        before = follower.record["choice"]["state"]
        commands = follower.decide(readings)
        if follower.record["reset"]["phase"] != 0:
            left = right = 120.0
            continue
        if before < 0:
            begin()
        followed += 1
        different += commands[0] not in policy.left_steps
        assert commands == speeds(int(left), int(right))
    assert followed > 500
    assert (different > 0) == (output == "interpolated")


@needs_gcc
def test_c_drives_a_simulated_robot_as_drive_does(tmp_path):
    """Learned, calm, trimmed: the firmware's file and the one-robot loop on the same readings."""
    config = replace(RAW, drive="rolling", output="interpolated", trim=0.01)
    run = wb.learn(config, steps=5000, progress=False)
    export_c(run.policy, tmp_path / "policy.c", config=config)
    speeds = _compiled(tmp_path / "policy.c")
    begin = ctypes.CDLL(str(tmp_path / "policy.so")).gq_begin
    follower = SoloFollower(config, run.policy)
    same = 0
    with wb.open_robot("sim:", config=config) as robot:
        robot.enable("proximity")
        robot.calibrate_proximity_sensors()
        for _ in range(600):
            robot.step()
            readings = robot.get_proximity()
            before = follower.record["choice"]["state"]
            commands = follower.decide(readings)
            robot.set_motors_speed(*commands)
            if follower.record["reset"]["phase"] == 0:
                if before < 0:
                    begin()
                same += 1
                assert commands == speeds(int(readings[7]), int(readings[0]))
    assert same > 300
