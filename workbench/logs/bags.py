"""ROS 2 bags (MCAP) as tables of numbers, read only: odometry, commands, joints, ranges and scans.

Every message type that is known becomes columns with units in their names, as ``import`` reads
them. Rows are the messages of one topic, odometry where there is some; of every other topic a row
has the last message before it. Where several topics have one type, the topic's name stands before
the column's, and ``--map`` says which is meant.

The packages ``mcap`` and ``mcap-ros2-support`` are needed for this and nothing else.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from workbench.robot.geometry import TRACK


def is_bag(place: Path) -> bool:
    """Return whether a path is a bag: an .mcap file, or the folder of one."""
    return place.suffix.lower() == ".mcap" or place.is_dir()


def read_bag(place: Path, said: list[str]) -> pd.DataFrame:
    """Return the numbers of a bag, a row per message of its leading topic.

    Args:
        place: an .mcap file or the folder of a bag.
        said: what was taken for what is appended.

    Raises:
        ImportError: a package is missing. ValueError: no bag, or nothing in it that is known.
    """
    topics: dict[str, list[dict[str, float]]] = {}
    kinds: dict[str, str] = {}
    others: dict[str, str] = {}
    begin: int | None = None  # times since 1970 would lose their last digits
    for file in _files(place):
        for topic, kind, time_ns, message in _messages(file):
            begin = time_ns if begin is None else begin
            if kind not in _COLUMNS:
                others[topic] = kind
                continue
            kinds[topic] = kind
            row = {"time [s]": (time_ns - begin) * 1e-9} | _columns(topic, kind, message)
            topics.setdefault(topic, []).append(row)
    if not topics:
        known = ", ".join(_COLUMNS)
        there = ", ".join(f"{topic} ({kind})" for topic, kind in others.items()) or "nothing"
        raise ValueError(f"{place} has {there}; expected one of {known}")
    if others:
        said.append(f"topics left out: {', '.join(others)}")
    return _together(topics, kinds, said)


def _together(
    topics: dict[str, list[dict[str, float]]], kinds: dict[str, str], said: list[str]
) -> pd.DataFrame:
    """Return one table, its rows those of the topic whose type comes first in ``_COLUMNS``."""
    order = list(_COLUMNS)
    names = sorted(topics, key=lambda topic: (order.index(kinds[topic]), -len(topics[topic])))
    tables = {}
    for topic in names:
        table = pd.DataFrame(topics[topic]).sort_values("time [s]", kind="stable")
        if sum(kind == kinds[topic] for kind in kinds.values()) > 1:
            own = {name: f"{topic} {name}" for name in table if name != "time [s]"}
            table = table.rename(columns=own)
        tables[topic] = table
    lead, *rest = names
    whole = tables[lead]
    begun = max(table["time [s]"].iloc[0] for table in tables.values())
    for topic in rest:
        whole = pd.merge_asof(whole, tables[topic], on="time [s]")
    said.append(f"rows are the messages of {lead} ({kinds[lead]})")
    complete = whole[whole["time [s]"] >= begun].reset_index(drop=True)
    early = len(whole) - len(complete)
    if complete.empty:
        raise ValueError(f"no moment at which all of {', '.join(names)} have sent something")
    if early:
        said.append(f"{early} rows before every topic had sent something: left out")
    return complete


def _files(place: Path) -> list[Path]:
    if place.is_file():
        return [place]
    found = sorted(place.glob("*.mcap"))
    if not found:
        raise ValueError(
            f"{place} is a folder without .mcap files; a bag of another kind has to be converted: "
            "ros2 bag convert, storage_id mcap"
        )
    return found


def _messages(file: Path) -> Any:
    """Yield topic, type, time in ns and message of everything in a file."""
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError as error:
        raise ImportError(
            "reading bags needs two packages: pip install mcap mcap-ros2-support"
        ) from error
    try:
        with open(file, "rb") as stream:
            factory = DecoderFactory()
            for schema, channel, message in make_reader(stream).iter_messages():
                kind = schema.name if schema is not None else ""
                decoder = factory.decoder_for(channel.message_encoding, schema)
                decoded = decoder(message.data) if decoder and kind in _COLUMNS else None
                yield channel.topic, kind if decoder else "", message.log_time, decoded
    except Exception as error:  # a damaged file: decoders raise whatever they stumble over
        raise ValueError(
            f"{file} is no MCAP file, or is damaged: {type(error).__name__} {error}; "
            "mcap recover may mend it"
        ) from error


def _columns(topic: str, kind: str, message: Any) -> dict[str, float]:
    try:
        return _COLUMNS[kind](message)
    except AttributeError as error:
        raise ValueError(f"{topic}: {kind} has not the fields of that type: {error}") from None


def _odometry(message: Any) -> dict[str, float]:
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    length = turn.w**2 + turn.x**2 + turn.y**2 + turn.z**2
    heading = math.nan  # of a quaternion that was never set
    if length > 0:
        ahead = length - 2 * (turn.y**2 + turn.z**2)
        heading = math.atan2(2 * (turn.w * turn.z + turn.x * turn.y), ahead)
    return {"x [m]": at.x, "y [m]": at.y, "heading [rad]": heading}


def _wheels(twist: Any) -> dict[str, float]:
    """Return the wheel speeds of an e-puck that moves so."""
    ahead, turning = twist.linear.x, twist.angular.z * TRACK / 2
    return {"left speed [m/s]": ahead - turning, "right speed [m/s]": ahead + turning}


def _joints(message: Any) -> dict[str, float]:
    found = {}
    for k, name in enumerate(message.name):
        for values, what in ((message.position, "position [rad]"), (message.velocity, "[rad/s]")):
            if k < len(values):
                found[f"{name} {what}"] = float(values[k])
    return found


def _scan(message: Any) -> dict[str, float]:
    return {f"range {k} [m]": float(value) for k, value in enumerate(message.ranges)}


_COLUMNS: dict[str, Callable[[Any], dict[str, float]]] = {
    "nav_msgs/msg/Odometry": _odometry,
    "sensor_msgs/msg/JointState": _joints,
    "geometry_msgs/msg/Twist": _wheels,
    "geometry_msgs/msg/TwistStamped": lambda message: _wheels(message.twist),
    "sensor_msgs/msg/LaserScan": _scan,
    "sensor_msgs/msg/Range": lambda message: {"range [m]": float(message.range)},
}
