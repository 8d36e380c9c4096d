"""A film of the live arena, taken from a real JupyterLab in a real browser: how the README's first
picture is made.

    python -m workbench.view.filming figures/live_arena.png

Robots that know nothing learn while it is watched; then the leader is driven with the round stick.
Needs the development extras and Chromium.
"""

import contextlib
import io
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
from PIL import Image

from workbench.lab.storage import write_bytes
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.view.animation import animated

WIDTH = 744  # pixels of the arena
FRAMES_PER_S = 6  # about
SPEED = "1"  # of the arena while pictures are taken, as a browser takes one or two a second
LEARNING_SPEED, LEARNING_S = 5, 35.0  # as fast as that in the film, and simulated seconds
DRIVING_SPEED = 3
TOKEN = "film"
CELLS = (
    """from dataclasses import replace
import workbench as wb
config = replace(wb.SETTINGS["recommended"], drive="planar", actions="relative",
                 wheel_speed_mps=(0.0, 0.12), seed=4)
run = wb.learn(config, steps=60_000, progress=False)
wb.play(config, learn=60_000)""",
    "wb.play(config.with_seed(5), run.policy, drive=True)",
)
# what somebody who drives might do with the round stick: to the left, forward, simulated seconds
WAY = ((0.0, 1.0, 2.0), (-0.12, 1.0, 6.0), (0.14, 1.0, 10.0), (-0.14, 1.0, 9.0), (0.0, 1.0, 2.0))
Shot = tuple[bytes, float]


@contextlib.contextmanager
def _server(folder: Path) -> Iterator[str]:
    """Serve a folder by JupyterLab; yield its address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = [
        "--no-browser",
        "--allow-root",
        f"--port={port}",
        f"--IdentityProvider.token={TOKEN}",
        f"--ServerApp.root_dir={folder}",
        "--LabApp.news_url=None",
    ]
    server = subprocess.Popen(
        [sys.executable, "-m", "jupyterlab", *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        for _ in range(300):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.2)
        yield f"http://127.0.0.1:{port}/lab/tree/film.ipynb?token={TOKEN}"
    finally:
        server.terminate()
        server.wait()


def _shoot(arena: Any, seconds: float, speed: int) -> list[Shot]:
    """Return pictures of an arena over simulated seconds, with how many milliseconds each stands in
    the film: by the arena's own clock, so that a busy machine makes fewer pictures of the same.
    """
    shots: list[Shot] = []
    at = begun = _periods(arena)
    while at - begun < seconds / CONTROL_PERIOD:
        picture = arena.screenshot()
        time.sleep(1 / FRAMES_PER_S / 4)
        until = _periods(arena)
        if until > at:
            shots.append((picture, 1000 * CONTROL_PERIOD * (until - at) / speed))
            at = until
    return shots


def _periods(arena: Any) -> int:
    return int(arena.get_attribute("data-periods") or 0)


def film(path: str | Path) -> int:
    """Write the film to an animated PNG; return its frames."""
    from playwright.sync_api import sync_playwright

    browser_path = shutil.which("chromium") or shutil.which("google-chrome")
    if browser_path is None:
        raise RuntimeError("no chromium on this machine; install it to take a film")
    with tempfile.TemporaryDirectory() as place, sync_playwright() as playwright:
        book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in CELLS])
        book.metadata.kernelspec = {"name": "python3", "display_name": "Python 3"}
        nbformat.write(book, Path(place) / "film.ipynb")
        browser = playwright.chromium.launch(executable_path=browser_path, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1500, "height": 1900})
        with _server(Path(place)) as address:
            page.goto(address)
            page.wait_for_selector(".jp-Notebook-ExecutionIndicator[data-status=idle]")
            page.add_style_tag(content=f".wba {{ max-width: {WIDTH}px !important; }}")
            page.wait_for_timeout(4000)
            page.get_by_role("menuitem", name="Run", exact=True).click()
            page.get_by_role("menuitem", name="Run All Cells", exact=True).click()
            page.wait_for_function("document.querySelectorAll('.wba').length == 2", timeout=120_000)
            shots = _play(page)
        browser.close()
    write_bytes(Path(path), _film(shots))
    return len(shots)


def _play(page: Any) -> list[Shot]:
    """Let one arena learn, drive the other with the stick, and return the pictures of both."""
    learning, driven = (page.locator(".wba").nth(k) for k in range(2))
    learning.locator(".speed").select_option(SPEED)
    learning.locator(".play").click()
    shots = _shoot(learning, LEARNING_S, LEARNING_SPEED)
    learning.locator(".play").click()
    driven.scroll_into_view_if_needed()
    driven.locator(".speed").select_option(SPEED)
    stick = driven.locator(".stick").bounding_box()
    middle = [stick[side] + stick[size] / 2 for side, size in (("x", "width"), ("y", "height"))]
    reach = 0.4 * stick["width"]
    page.mouse.move(*middle)
    page.mouse.down()
    for left, forward, seconds in WAY:
        page.mouse.move(middle[0] - left * reach, middle[1] - forward * reach)
        shots += _shoot(driven, seconds, DRIVING_SPEED)
    page.mouse.up()
    return shots


def _film(shots: list[Shot]) -> bytes:
    """Return the film of pictures of a page, the arenas a pixel apart in height."""
    frames = [Image.open(io.BytesIO(shot)).convert("RGB") for shot, _ in shots]
    size = frames[0].size
    stands = [round(stands_ms) for _, stands_ms in shots]
    return animated([frame.resize(size) for frame in frames], stands, samples=3)


if __name__ == "__main__":
    print(film(sys.argv[1]), "frames")
