"""ROS 2 bags as recordings: bags written with the ROS 2 writer, read as anybody's log."""

import builtins
import math

import numpy as np
import pytest

from workbench.logs.bags import read_bag
from workbench.logs.csv_import import import_table
from workbench.logs.recordings import load_recording
from workbench.robot.geometry import STEP, TRACK

STAMP = "builtin_interfaces/Time stamp\nstring frame_id\n"
TIME = "int32 sec\nuint32 nanosec\n"
VECTOR = "float64 x\nfloat64 y\nfloat64 z\n"
POSE = "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
TWIST = "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"


def _joined(first, **parts):
    """Return a message definition with those that it needs, as bags hold them."""
    text = first
    for name, definition in parts.items():
        text += "=" * 80 + f"\nMSG: {name.replace('__', '/')}\n{definition}"
    return text


GEOMETRY = {
    "geometry_msgs__Point": VECTOR,
    "geometry_msgs__Vector3": VECTOR,
    "geometry_msgs__Quaternion": VECTOR + "float64 w\n",
}
TYPES = {
    "nav_msgs/msg/Odometry": _joined(
        "geometry_msgs/PoseWithCovariance pose\n",
        geometry_msgs__PoseWithCovariance="geometry_msgs/Pose pose\n",
        geometry_msgs__Pose=POSE,
        **GEOMETRY,
    ),
    "geometry_msgs/msg/Twist": _joined(TWIST, **GEOMETRY),
    "sensor_msgs/msg/JointState": "string[] name\nfloat64[] position\nfloat64[] velocity\n",
    "sensor_msgs/msg/Range": "float32 range\n",
    "sensor_msgs/msg/LaserScan": "float32[] ranges\n",
    "std_msgs/msg/String": "string data\n",
}


def _bag(path, messages):
    """Write (time in s, topic, type, message) as a bag."""
    writing = pytest.importorskip("mcap_ros2.writer")
    with open(path, "wb") as file:
        writer = writing.Writer(file)
        schemas = {kind: writer.register_msgdef(kind, text) for kind, text in TYPES.items()}
        for time_s, topic, kind, message in messages:
            at = round(time_s * 1e9)
            writer.write_message(topic, schemas[kind], message, log_time=at, publish_time=at)
        writer.finish()
    return path


def _odometry(x, heading):
    turn = {"x": 0.0, "y": 0.0, "z": math.sin(heading / 2), "w": math.cos(heading / 2)}
    return {"pose": {"pose": {"position": {"x": x, "y": 0.1, "z": 0.0}, "orientation": turn}}}


def _twist(ahead, turning):
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    return {"linear": zero | {"x": ahead}, "angular": zero | {"z": turning}}


def _drive():
    begin = 1_700_000_000.0
    for k in range(20):
        at = begin + 0.1 * k
        yield at, "/odom", "nav_msgs/msg/Odometry", _odometry(0.006 * k, 0.05 * k)
        if k >= 2:
            yield at - 0.01, "/cmd_vel", "geometry_msgs/msg/Twist", _twist(0.06, 0.5)
        yield at, "/rosout", "std_msgs/msg/String", {"data": "hello"}


def test_odometry_and_commands_become_a_recording(tmp_path):
    bag = _bag(tmp_path / "drive.mcap", sorted(_drive(), key=lambda message: message[0]))
    said = import_table(bag, robot="e-puck2 with ROS")["said"]
    frame = load_recording(tmp_path / "drive_recording.csv").frame
    assert len(frame) == 18 and frame["t_s"].tolist()[:2] == pytest.approx([0.0, 0.1])
    assert frame["x_m"].tolist() == pytest.approx([0.006 * k for k in range(2, 20)])
    assert frame["heading_rad"].iloc[-1] == pytest.approx(0.95)
    left, right = ((0.06 + side * 0.25 * TRACK) / STEP for side in (-1, 1))
    assert frame["left_command"].iloc[0] == round(left)
    assert frame["right_command"].iloc[0] == round(right)
    text = "; ".join(said)
    assert "rows are the messages of /odom (nav_msgs/msg/Odometry)" in text
    assert "topics left out: /rosout" in text and "2 rows before every topic" in text


def test_the_folder_of_a_bag_is_one_too_and_joints_and_ranges_have_names(tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    joints = {"name": ["left wheel", "right wheel"], "position": [0.1, 0.2], "velocity": [1.0, 2.0]}
    _bag(
        folder / "bag_0.mcap",
        [
            (0.0, "/ps0", "sensor_msgs/msg/Range", {"range": 0.05}),
            (0.0, "/ps7", "sensor_msgs/msg/Range", {"range": 0.04}),
            (0.0, "/scan", "sensor_msgs/msg/LaserScan", {"ranges": [0.5, 0.25]}),
            (0.1, "/joints", "sensor_msgs/msg/JointState", joints),
            (0.2, "/joints", "sensor_msgs/msg/JointState", joints),
        ],
    )
    frame = read_bag(folder, [])
    assert len(frame) == 2
    assert frame["/ps7 range [m]"].iloc[0] == pytest.approx(0.04)
    assert frame["range 1 [m]"].tolist() == [0.25, 0.25]
    assert frame["right wheel [rad/s]"].tolist() == [2.0, 2.0]
    names = {"left wheel [rad/s]": "left_command", "right wheel [rad/s]": "right_command"}
    written = import_table(folder, robot="one", names=names, out=tmp_path / "joints.csv")
    assert written["rows"] == 2
    assert load_recording(tmp_path / "joints.csv").frame["right_command"].iloc[0] == 318


def test_what_is_no_bag_or_has_nothing_known_is_refused(tmp_path):
    (tmp_path / "no.mcap").write_bytes(b"not a bag at all")
    with pytest.raises(ValueError, match="is no MCAP file, or is damaged"):
        import_table(tmp_path / "no.mcap", robot="one")
    words = [(0.0, "/rosout", "std_msgs/msg/String", {"data": "hello"})]
    bag = _bag(tmp_path / "words.mcap", words)
    with pytest.raises(ValueError, match=r"has /rosout \(std_msgs/msg/String\); expected one of"):
        import_table(bag, robot="one")
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "metadata.yaml").write_text("")
    with pytest.raises(ValueError, match="has to be converted: ros2 bag convert"):
        import_table(tmp_path / "old", robot="one")
    whole = _bag(tmp_path / "whole.mcap", _drive()).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="is damaged"):
        read_bag(tmp_path / "cut.mcap", [])


def test_without_the_packages_it_says_what_to_install(tmp_path, monkeypatch):
    bag = _bag(tmp_path / "drive.mcap", _drive())
    real = builtins.__import__

    def without(name, *rest, **kinds):
        if name.startswith("mcap"):
            raise ImportError(name)
        return real(name, *rest, **kinds)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match="pip install mcap mcap-ros2-support"):
        read_bag(bag, [])


def test_a_beam_without_a_number_costs_no_row_of_what_is_asked_for(tmp_path):
    messages = list(_drive())
    for k in range(20):
        scan = {"ranges": [math.nan, 0.5]}
        messages.append((1_700_000_000.0 + 0.1 * k, "/scan", "sensor_msgs/msg/LaserScan", scan))
    bag = _bag(tmp_path / "scan.mcap", sorted(messages, key=lambda message: message[0]))
    assert import_table(bag, robot="one")["rows"] == 18


def test_a_topic_in_another_encoding_is_left_out(tmp_path):
    writing = pytest.importorskip("mcap_ros2.writer")
    with open(tmp_path / "mixed.mcap", "wb") as file:
        writer = writing.Writer(file)
        schema = writer.register_msgdef("nav_msgs/msg/Odometry", TYPES["nav_msgs/msg/Odometry"])
        raw = writer._writer
        json = raw.register_schema(name="Words", encoding="jsonschema", data=b"{}")
        words = raw.register_channel(topic="/words", message_encoding="json", schema_id=json)
        for k in range(3):
            at = k * 10**8
            writer.write_message("/odom", schema, _odometry(0.1 * k, 0.0), at, at)
            raw.add_message(words, log_time=at, data=b"{}", publish_time=at)
        writer.finish()
    said = []
    assert len(read_bag(tmp_path / "mixed.mcap", said)) == 3
    assert "topics left out: /words" in said[0]


def test_headings_are_of_any_length_of_quaternion_and_of_none_for_none(tmp_path):
    half = {"x": 0.0, "y": 0.0, "z": 0.5 * math.sin(0.5), "w": 0.5 * math.cos(0.5)}
    rows = []
    for k, turn in enumerate((half, dict.fromkeys("xyzw", 0.0))):
        message = _odometry(0.0, 0.0)
        message["pose"]["pose"]["orientation"] = turn
        rows.append((0.1 * k, "/odom", "nav_msgs/msg/Odometry", message))
    frame = read_bag(_bag(tmp_path / "turn.mcap", rows), [])
    assert frame["heading [rad]"].iloc[0] == pytest.approx(1.0)
    assert math.isnan(frame["heading [rad]"].iloc[1])
    with pytest.raises(ValueError, match="row 2: no number for heading_rad; add --cut"):
        import_table(tmp_path / "turn.mcap", robot="one", commands=False)


def test_times_that_stand_still_and_damaged_bytes_are_refused_in_one_sentence(tmp_path):
    twice = [(0.0, "/odom", "nav_msgs/msg/Odometry", _odometry(0.1 * k, 0.0)) for k in range(2)]
    bag = _bag(tmp_path / "twice.mcap", twice)
    with pytest.raises(ValueError, match="row 2: time does not advance; cut the row out"):
        import_table(bag, robot="one", commands=False)
    whole = bytearray(_bag(tmp_path / "whole.mcap", _drive()).read_bytes())
    rng = np.random.default_rng(1)
    for number in range(60):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 5):
            damaged[place] = rng.integers(0, 256)
        path = tmp_path / f"{number}.mcap"
        path.write_bytes(damaged)
        try:
            read_bag(path, [])
        except ValueError as error:
            assert "mcap" in str(error).lower()
