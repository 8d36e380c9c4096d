"""The live arena as a widget: anywidget, with the JavaScript beside this file sent inline, so that no network is needed.

    Arena(LiveScene(config, policy=run.policy))      # or ``workbench.play``, which makes the scene too

The page asks for control periods when it wants to show them (messages "advance"), so that a hidden, reloaded or closed page costs
nothing and the simulation never runs ahead. A message is handled whole: an interrupt of the kernel comes after it.

Contract: one thread at a time; handlers of several pages or cells wait for each other. Files are saved in the folder given, by
plain names.
"""

import contextlib
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import anywidget
import numpy as np
import traitlets

from workbench.doors.scenes import Frames, LiveScene, StoredScene

MOST = 200  # control periods per message
CHUNK = 2000  # frames per message of the history


@contextlib.contextmanager
def whole() -> Iterator[None]:
    """Let an interrupt wait until the block is done: half a control period would leave the scene inconsistent."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[Any] = []
    before = signal.signal(signal.SIGINT, lambda *arguments: waiting.append(arguments))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if waiting and callable(before):
            before(*waiting[0])


class Arena(anywidget.AnyWidget):
    """Show a scene, play it, step, scrub, and let a person drive.

    Args:
        scene: what to show.
        folder: where drives are saved; default: where the kernel runs.

    Attributes:
        scene: open to every use while it is not played.
        saved: the file that was saved last.
    """

    _esm = Path(__file__).parent / "arena.js"
    about = traitlets.Dict().tag(sync=True)
    title = traitlets.Unicode().tag(sync=True)
    live = traitlets.Bool().tag(sync=True)
    drivable = traitlets.Bool().tag(sync=True)

    def __init__(self, scene: LiveScene | StoredScene, *, folder: str | Path = ".") -> None:
        super().__init__(about=scene.about, title=scene.title, live=scene.live, drivable=scene.drivable)
        self.scene, self.folder, self.saved = scene, Path(folder), ""
        self._lock, self._generation = threading.Lock(), 0
        self.on_msg(self._hear)

    def _hear(self, _: object, message: dict[str, Any], buffers: object) -> None:
        kinds = {"advance": self._advance, "history": self._history, "restart": self._restart, "save": self._save}
        with self._lock, whole():
            try:
                kinds[message["type"]](message)
            except (FloatingPointError, OSError, RuntimeError, ValueError) as error:
                self.send({"type": "said", "text": f"{type(error).__name__}: {error}", "stop": True})

    def _advance(self, message: dict[str, Any]) -> None:
        scene = self.scene
        if not isinstance(scene, LiveScene):
            return
        shown = len(scene)
        if message["generation"] != self._generation or message["have"] < shown:  # another page has gone on
            self._tell(scene.frames[message["have"] :] if message["generation"] == self._generation else scene.frames, message)
            return
        scene.steer(message["turn"], message["speed"])
        self._tell(scene.advance(min(MOST, int(message["periods"]))), {"have": shown, "generation": self._generation})

    def _history(self, message: dict[str, Any]) -> None:
        scene = self.scene
        if isinstance(scene, LiveScene) and not len(scene):
            scene.advance()
        frames = scene.frames
        for first in range(0, max(1, len(frames)), CHUNK):
            self._tell(frames[first : first + CHUNK], {"have": first, "generation": self._generation, "history": True})

    def _tell(self, frames: Frames, message: dict[str, Any]) -> None:
        over = self.scene.ended if isinstance(self.scene, LiveScene) else True
        fresh = message["generation"] == self._generation
        self.send(
            {
                "type": "frames", "first": message["have"] if fresh else 0, "generation": self._generation, "over": over,
                "restarted": not fresh, "history": message.get("history", False),
            },
            [np.ascontiguousarray(frames, np.float32).tobytes()],
        )  # fmt: skip

    def _restart(self, message: dict[str, Any]) -> None:
        assert isinstance(self.scene, LiveScene)
        before, self._generation = self._generation, self._generation + 1
        self.scene.restart()
        self.scene.advance()
        self._tell(self.scene.frames, {"have": 0, "generation": before})

    def _save(self, message: dict[str, Any]) -> None:
        assert isinstance(self.scene, LiveScene)
        name = str(message["name"])
        if Path(name).name != name or name.startswith("."):
            raise ValueError(f"name = {name!r}; expected a plain file name that ends in .csv")
        self.saved = str(self.scene.save_drive(self.folder / name))
        seconds = len(self.scene.commands) * self.about["period"]
        self.send({"type": "said", "text": f"saved {seconds:.1f} s; wb.play({self.saved!r}, policy) drives it again"})
