"""The live arena as a widget: anywidget, with the JavaScript beside this file sent inline, so that
no network is needed.

    Arena(LiveScene(config, policy=run.policy))  # or ``workbench.play``, which makes the scene too

The page asks for control periods when it wants to show them (messages "advance"), so that a hidden,
reloaded or closed page costs nothing and the simulation never runs ahead. A control period is
whole: an interrupt of the kernel comes after it.

Contract: one thread at a time; handlers of several pages or cells wait for each other. Files are
saved in the folder given, by plain names.
"""

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

import anywidget
import numpy as np
import traitlets

from workbench import paths
from workbench.view.scenes import Frames, LiveScene, StoredScene

MOST = 200  # control periods per message
CHUNK = 2000  # frames per message of the history


class Arena(anywidget.AnyWidget):
    """Show a scene, play it, step, scrub, and let a person drive.

    Args:
        scene: what to show.
        folder: where drives are saved; default: ``runs/drives``.
        picture: returns a PNG that stands beside the widget in a stored notebook.

    Attributes:
        scene: open to every use while it is not played.
        saved: the file that was saved last.
    """

    _esm = Path(__file__).parent / "arena.js"
    about = traitlets.Dict().tag(sync=True)
    title = traitlets.Unicode().tag(sync=True)
    live = traitlets.Bool().tag(sync=True)
    drivable = traitlets.Bool().tag(sync=True)

    def __init__(
        self,
        scene: LiveScene | StoredScene,
        *,
        folder: str | Path | None = None,
        picture: Callable[[], bytes] | None = None,
    ) -> None:
        super().__init__(
            about=scene.about, title=scene.title, live=scene.live, drivable=scene.drivable
        )
        self.scene = scene
        self.folder = paths.RUNS / "drives" if folder is None else Path(folder).expanduser()
        self.saved = ""
        self._picture = picture
        self.on_msg(self._hear)

    def _repr_mimebundle_(self, **options: Any) -> Any:
        """Return what a page shows, and the picture that is left where no kernel runs."""
        bundle = super()._repr_mimebundle_(**options)
        data, about = bundle if isinstance(bundle, tuple) else (bundle, {})
        if data and self._picture is not None:
            picture = base64.b64encode(self._picture()).decode()
            data = data | {"image/png": picture}
            about = about | {"image/png": {"width": 700}}
        return data, about

    def _hear(self, _: object, message: dict[str, Any], buffers: object) -> None:
        kinds = {
            "advance": self._advance,
            "history": self._history,
            "restart": self._restart,
            "save": self._save,
            "instruct": self._instruct,
        }
        with self.scene.lock:
            try:
                kinds[message["type"]](message)
            except KeyboardInterrupt:
                self.send({"type": "said", "text": "interrupted", "stop": True})
                raise
            except (
                Exception
            ) as error:  # whatever it is, the page must hear of it: it waits for an answer
                self.send(
                    {"type": "said", "text": f"{type(error).__name__}: {error}", "stop": True}
                )

    def _live(self) -> LiveScene:
        if not isinstance(self.scene, LiveScene):
            raise ValueError(f"this scene is over ({self.scene.title}); expected a live one")
        return self.scene

    def _advance(self, message: dict[str, Any]) -> None:
        scene = self._live()
        have = int(message["have"])
        if message["generation"] != scene.generation or have != len(
            scene
        ):  # it was begun again, or another page has gone on
            self._tell(
                have if message["generation"] == scene.generation and have < len(scene) else 0
            )
            return
        if (
            "turn" in message
        ):  # from the page on which somebody drives, not from one that only looks on
            scene.steer(message["turn"], message["speed"])
        scene.advance(min(MOST, int(message["periods"])))
        self._tell(have)

    def _history(self, message: dict[str, Any]) -> None:
        if isinstance(self.scene, LiveScene) and not len(self.scene):
            self.scene.advance()
        self._tell(0)

    def _tell(self, first: int) -> None:
        """Send all frames from one on, in pieces."""
        scene = self.scene
        live = isinstance(self.scene, LiveScene)
        frames = scene.since(first)
        head = {"type": "frames", "generation": scene.generation, "over": scene.ended}
        for at in range(0, max(1, len(frames)), CHUNK):
            part: Frames = np.ascontiguousarray(frames[at : at + CHUNK], np.float32)
            self.send(head | {"first": first + at, "live": live}, [part.tobytes()])

    def _restart(self, message: dict[str, Any]) -> None:
        scene = self._live()
        scene.restart()
        scene.advance()
        self._tell(0)

    def _instruct(self, message: dict[str, Any]) -> None:
        shape = str(message["shape"])
        self._live().instruct(shape, message.get("points", ()))
        self.send({"type": "said", "text": f"asked for: {shape}"})

    def _save(self, message: dict[str, Any]) -> None:
        scene = self._live()
        name = str(message["name"])
        if Path(name).name != name or name.startswith("."):
            raise ValueError(f"name = {name!r}; expected a plain file name that ends in .csv")
        self.folder.mkdir(parents=True, exist_ok=True)
        self.saved = str(scene.save_drive(self.folder / name))
        seconds = len(scene.commands) * self.about["period"]
        self.send(
            {
                "type": "said",
                "text": f"saved {seconds:.1f} s; wb.play({self.saved!r}, policy) drives it again",
            }
        )
