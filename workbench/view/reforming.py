"""A film of a formation that changes its shape while it drives: how the README's picture of it is
made.

    python -m workbench.view.reforming figures/change_of_shape.png
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
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


def film(path: str | Path) -> int:
    """Write the film to an animated PNG; return its pictures."""
    config, policy = scene()
    pictures = []
    convoy = Convoy(config, [config.seed], periods=10**6, policy=policy.theta, threads=1)
    driven: list[Any] = []
    t = 0
    for shape in SHAPES:
        convoy.instruct(shape)
        for _ in range(round(SECONDS / EVERY_S)):
            for _ in range(round(EVERY_S / CONTROL_PERIOD)):
                driven.append(convoy.period(t)[0].copy())
                convoy.world.step()
                t += 1
            pictures.append(_drawn(convoy, driven, shape))
    write_bytes(Path(path), animated(pictures, round(1000 * EVERY_S / FAST), samples=3))
    return len(pictures)


def _drawn(convoy: Convoy, driven: list[Any], shape: str) -> Image.Image:
    """Return a picture of a formation as it stands."""
    motion = Motion.of_steps(np.stack(driven[-130:]), None, convoy.config.robot)
    figure = Figure(figsize=(4.2, 4.2), dpi=100, layout="constrained")
    with style():
        ax = draw_formation(convoy, motion, reach_m=0.62, ax=figure.subplots())
        ax.set(xlabel="", ylabel="", xticks=[], yticks=[], title=f"“{shape}”")
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


if __name__ == "__main__":
    print(film(sys.argv[1]), "pictures")
