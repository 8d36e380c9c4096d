"""One call to look at something that moves: ``play`` makes a scene and shows it, live on a page, as
a picture elsewhere.

Contract: widgets are imported here when they are needed, never by ``import workbench``.
"""

from pathlib import Path
from typing import Any

import numpy as np
from IPython.display import Image
from matplotlib.figure import Figure

from workbench import paths
from workbench.formation.config import ConvoyConfig
from workbench.formation.laws.law import ControlLaw
from workbench.formation.laws.table import Controller, check_controller
from workbench.formation.policy import Policy
from workbench.lab.runs import Run, controller_of
from workbench.measures.motion import Motion
from workbench.plots.figures import png
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.view.scenes import LiveScene, StoredScene, load_drive

Source = ConvoyConfig | Run | str | Path | LiveScene | StoredScene


def scene_of(
    source: Source, policy: Controller | Run | None = None, *, learn: int = 0, drive: bool = False
) -> LiveScene | StoredScene:
    """Return the scene that ``play`` shows.

    Args:
        source: a configuration, simulated live; a run, of which the last whole block is shown, or
            with ``drive`` what it learned, live; a
            recording that the live arena saved, whose leader drives again; or a scene.
        policy: who drives the followers, a policy or a law; default: a carrot, or θ₀ where they
            learn.
        learn: updates over which they learn while you watch; 0: they do not.
        drive: whether you drive the leader.

    Raises:
        TypeError, ValueError: the source is nothing of these, or policy, learn or drive do not go
            with it.
    """
    if isinstance(source, Run) and drive:  # live, and what it learned follows
        policy = policy or source
        source = source.config
    policy = None if policy is None else controller_of(policy)
    if policy is not None:
        check_controller(policy)
    law = policy if isinstance(policy, ControlLaw) else None
    learned = policy if isinstance(policy, Policy) else None
    if isinstance(source, ConvoyConfig):
        return LiveScene(source, policy=learned, law=law, learn=learn, drive=drive)
    if isinstance(source, (str, Path)):
        if drive:
            raise ValueError(
                f"drive = {drive!r} with a recorded drive; expected one or the other: give "
                "its configuration instead"
            )
        config, commands = load_drive(source)
        return LiveScene(config, policy=learned, law=law, learn=learn, commands=commands)
    if isinstance(source, Motion):
        raise TypeError(
            "source is a Motion; it does not know its configuration: expected "
            "StoredScene.of_motion(motion, config)"
        )
    if policy is not None or learn or drive:
        raise ValueError(
            f"policy, learn or drive with a {type(source).__name__}; they go with a "
            "configuration only: give run.config, or a "
            "scene that was made with them"
        )
    if isinstance(source, Run):
        return StoredScene.of_run(source)
    if isinstance(source, (LiveScene, StoredScene)):
        return source
    raise TypeError(
        f"source is a {type(source).__name__}; expected a configuration, a run, a recorded "
        "drive's path or a scene"
    )


def play(
    source: Source,
    policy: Controller | Run | None = None,
    *,
    learn: int = 0,
    drive: bool = False,
    folder: str | Path | None = None,
    still_s: float = 30.0,
) -> Any:
    """Show the live arena; arguments as ``scene_of``.

    Args:
        folder: where drives are saved; default: ``runs/drives``.
        still_s: simulated seconds after which the picture is taken where there is no page
            (WORKBENCH_STATIC=1).

    Returns:
        The widget, or a picture.
    """
    if folder is not None and not Path(folder).is_dir():
        raise FileNotFoundError(
            f"folder = {str(folder)!r} does not exist; expected the folder that drives are saved in"
        )
    if not 0 < still_s < 1e5:
        raise ValueError(f"still_s = {still_s!r}; expected simulated seconds above 0")
    scene = scene_of(source, policy, learn=learn, drive=drive)
    if paths.STATIC:
        return still(scene, still_s)
    from workbench.view.widget import Arena

    def picture() -> bytes:
        if isinstance(source, (LiveScene, StoredScene)):  # as far as it has come
            return bytes(still(source, max(1, len(source)) * CONTROL_PERIOD).data)
        # another one: that on the page stays where it is
        own = scene_of(source, policy, learn=learn, drive=drive)
        return bytes(still(own, still_s).data)

    return Arena(scene, folder=folder, picture=picture)


def still(scene: LiveScene | StoredScene, seconds: float) -> Image:
    """Return the picture of a scene after some seconds; a live one runs until then, its joystick
    forwards and a little aside.
    """
    from workbench.view.drawing import draw_scene

    periods = max(1, round(seconds / CONTROL_PERIOD))
    if isinstance(scene, LiveScene):
        for t in range(len(scene), periods):
            scene.steer(0.45 * np.sin(t / 25), 1.0)  # what a person might do
            scene.advance()
    fig = Figure(figsize=(7.0, 6.2), layout="constrained")
    ax = draw_scene(scene, min(periods, len(scene.frames)) - 1, ax=fig.add_subplot())
    ax.set_title(
        ax.get_title(loc="left").replace("live, ", "").replace("you drive", "a script drives"),
        loc="left",
        fontsize=9,
    )
    return Image(png(fig), width=700)
