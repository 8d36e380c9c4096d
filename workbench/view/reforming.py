"""Films of formations: five shapes beside each other, and one that changes its shape while it
drives. How the README's pictures of them are made.

    python -m workbench.view.reforming figures/five_shapes.png figures/change_of_shape.png
"""

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from workbench.arena.tracks import TrackConfig
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.policy import Policy
from workbench.formation.shapes import FormationConfig
from workbench.lab.runs import learn
from workbench.lab.storage import write_bytes
from workbench.measures.motion import Motion
from workbench.plots.shapes import draw_formation
from workbench.plots.style import style
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.view.animation import animated

SHAPES = ("wedge", "line", "diamond", "circle", "column")
SECONDS, EVERY_S = 34.0, 1.0  # of a shape, between pictures
FAST = 8  # as it is shown
SETTLED_S, ROW_S = 60.0, 63.0  # until five shapes are kept, and of them in the film: half an eight


def scene() -> tuple[ConvoyConfig, Policy]:
    """Return a formation, and what drives it: learned in the paper's worm by one follower."""
    worm = replace(
        SETTINGS["recommended"],
        drive="rolling",
        followers=1,
        leader_speed_mps=0.05,
        wheel_speed_mps=(0.0, 0.12),
    )
    policy = learn(worm, steps=100_000, progress=False).policy
    assert isinstance(policy, Policy)
    track = TrackConfig(shape="eight", radius_m=1.5, judder="none")
    told = FormationConfig(shape="column", frame="heading", place_speed_mps=0.03)
    return replace(worm, followers=4, seed=7, track=track, formation=told), policy


class _Drive:
    """A formation that drives on, and what it has driven."""

    def __init__(self, config: ConvoyConfig, policy: Policy) -> None:
        self.convoy = Convoy(config, [config.seed], periods=10**6, policy=policy.theta, threads=1)
        self._driven: list[Any] = []
        self._t = 0

    def go_on(self, seconds: float) -> None:
        """Drive for some simulated seconds."""
        for _ in range(round(seconds / CONTROL_PERIOD)):
            self._driven.append(self.convoy.period(self._t)[0].copy())
            self.convoy.world.step()
            self._t += 1

    def draw(self, shape: str, ax: Axes) -> None:
        """Draw it as it stands."""
        motion = Motion.of_steps(np.stack(self._driven[-130:]), None, self.convoy.config.robot)
        draw_formation(self.convoy, motion, reach_m=0.62, ax=ax)
        ax.set(xlabel="", ylabel="", xticks=[], yticks=[], title=f"“{shape}”")


def film_changes(path: str | Path) -> int:
    """Write a film of one formation that is asked for one shape after another to an animated PNG;
    return its pictures.
    """
    config, policy = scene()
    drive = _Drive(config, policy)
    pictures = []
    for shape in SHAPES:
        drive.convoy.instruct(shape)
        for _ in range(round(SECONDS / EVERY_S)):
            drive.go_on(EVERY_S)
            pictures.append(_drawn({shape: drive}, (4.2, 4.2)))
    return _write(pictures, path)


def film_row(path: str | Path) -> int:
    """Write a film of five formations, each in a shape, to an animated PNG; return its pictures."""
    config, policy = scene()
    drives = {}
    for shape in sorted(SHAPES):
        told = replace(config.formation, shape=shape)
        drives[shape] = _Drive(replace(config, formation=told), policy)
        drives[shape].go_on(SETTLED_S)
    pictures = []
    for _ in range(round(ROW_S / EVERY_S)):
        for drive in drives.values():
            drive.go_on(EVERY_S)
        pictures.append(_drawn(drives, (10.5, 2.4)))
    return _write(pictures, path)


def _write(pictures: list[Image.Image], path: str | Path) -> int:
    write_bytes(Path(path), animated(pictures, round(1000 * EVERY_S / FAST), samples=3))
    return len(pictures)


def _drawn(drives: Mapping[str, _Drive], size: tuple[float, float]) -> Image.Image:
    """Return a picture of formations beside each other as they stand, inches wide and high."""
    figure = Figure(figsize=size, dpi=100, layout="constrained")
    with style():
        places = figure.subplots(1, len(drives), squeeze=False)[0]
        for ax, (shape, drive) in zip(places, drives.items(), strict=True):
            drive.draw(shape, ax)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


if __name__ == "__main__":
    print(film_row(sys.argv[1]), film_changes(sys.argv[2]), "pictures")
