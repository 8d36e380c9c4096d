"""JupyterLab as people use it: a real server, a real Chromium, the first notebook from top to
bottom, and the static pages.

Where there is no Chromium the tests are left out, and say so. Screenshots are in runs/browser/.
"""

import contextlib
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import nbformat
import psutil
import pytest

from workbench import paths

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
WHY = (
    "BROWSER TESTS: no chromium on this machine; install Debian's package chromium (or "
    "google-chrome) to run them"
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason=WHY),
    pytest.mark.filterwarnings("default"),  # playwright's event loop and the server's sockets
]
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
WIDGET = "application/vnd.jupyter.widget-view+json"
SHOTS = paths.RUNS / "browser"
TOKEN = "workbench-test"
MOVING_S = 8.0  # seconds over which frames and load are measured
OUTSIDE = re.compile(
    r"net::ERR_|Failed to load resource"
)  # a page asks the network for something: nothing that we need


WATCH = """number => {
  window.began = window.redrawn = null;
  document.addEventListener("keydown", () => { window.began = performance.now(); },
                            { capture: true, once: true });
  new MutationObserver((_, self) => { window.redrawn = performance.now(); self.disconnect(); })
    .observe(document.querySelectorAll("img.widget-image")[number], { attributeFilter: ["src"] });
}"""


def _redrawn_ms(page, number, key):
    """Return how long after a key on its slider a panel has another picture, by the page's own
    clock.
    """
    page.evaluate(WATCH, number)
    page.keyboard.press(key)
    page.wait_for_function("window.redrawn !== null", timeout=20_000)
    return page.evaluate("window.redrawn - window.began")


@contextlib.contextmanager
def _page(width=1100, height=1400):
    from playwright.sync_api import sync_playwright

    SHOTS.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(60_000)
        errors = []
        page.on("pageerror", lambda error: errors.append(f"page error: {error}"))
        page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
        try:
            yield page, errors
        finally:
            browser.close()


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Start JupyterLab on a copy of the notebook and yield its process and address."""
    folder = tmp_path_factory.mktemp("lab")
    shutil.copy(paths.NOTEBOOKS / "00_start_here.ipynb", folder)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    environment = {key: value for key, value in os.environ.items() if key != "WORKBENCH_STATIC"} | {
        "WORKBENCH_QUICK": "1",
        "JUPYTER_CONFIG_DIR": str(folder / "config"),
        "JUPYTER_DATA_DIR": str(folder / "data"),
    }
    command = [
        sys.executable,
        "-m",
        "jupyterlab",
        "--no-browser",
        "--allow-root",
        f"--port={port}",
        "--port-retries=0",
        f"--IdentityProvider.token={TOKEN}",
        f"--ServerApp.root_dir={folder}",
        "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate",
        "--LabApp.news_url=None",
    ]
    with open(folder / "server.log", "w") as log:
        server = subprocess.Popen(
            command, env=environment, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
        )
    try:
        for _ in range(300):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            assert server.poll() is None, (folder / "server.log").read_text()
            time.sleep(0.2)
        yield server, f"http://127.0.0.1:{port}", folder
    finally:
        for child in psutil.Process(server.pid).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                child.kill()
        server.kill()
        server.wait()


def _kernel(server):
    """Return the process of the notebook's kernel; what it starts has its name until it is another
    program.
    """
    [kernel] = [
        child
        for child in psutil.Process(server.pid).children()
        if any("ipykernel_launcher" in part for part in child.cmdline())
    ]
    return kernel


def _load(process, seconds):
    """Return the share of one core that a process uses."""
    before = sum(process.cpu_times()[:2])
    time.sleep(seconds)
    return (sum(process.cpu_times()[:2]) - before) / seconds


def _prompts(page):
    return page.locator(".jp-Notebook .jp-InputPrompt").all_inner_texts()


def _open_and_run(page, url, server):
    """Open the notebook and run all its cells; a page whose connection to the kernel got lost at
    the start is loaded again.
    """
    for _ in range(4):
        page.goto(url)
        page.wait_for_selector(".jp-Notebook .jp-CodeCell")
        page.wait_for_selector(".jp-Notebook-ExecutionIndicator[data-status=idle]")
        page.wait_for_timeout(3000)
        page.get_by_role("menuitem", name="Run", exact=True).click()
        page.get_by_role("menuitem", name="Run All Cells", exact=True).click()
        with contextlib.suppress(AssertionError):
            _wait_for(
                lambda: sum(_kernel(server).cpu_times()[:2]) > 2.0,
                40,
                "the kernel importing the workbench",
            )
            return
    raise AssertionError("the kernel did nothing in four attempts")


def _number(arena, name):
    return float(arena.get_attribute(f"data-{name}") or 0)


def _wait_for(condition, seconds, what):
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, f"{what} did not happen within {seconds} s"
        time.sleep(0.2)


def _leader(arena):
    return [float(value) for value in (arena.get_attribute("data-leader") or "0 0").split()]


def _choose_theme(page, name):
    page.locator(".lm-MenuBar-item").get_by_text("Settings", exact=True).click()
    page.wait_for_timeout(500)
    page.locator(".lm-Menu-itemLabel").get_by_text("Theme", exact=True).hover()
    page.locator(".lm-Menu-itemLabel").get_by_text(f"JupyterLab {name}", exact=True).click()


def test_the_first_notebook_in_a_real_jupyterlab(lab, capsys):
    server, address, folder = lab
    with _page() as (page, errors):
        _open_and_run(page, f"{address}/lab/tree/00_start_here.ipynb?token={TOKEN}", server)
        code = [
            cell
            for cell in nbformat.read(folder / "00_start_here.ipynb", 4).cells
            if cell.cell_type == "code"
        ]
        done = f"[{len(code)}]:"
        _wait_for(
            lambda: done in _prompts(page) and "[*]:" not in _prompts(page),
            480,
            "running all cells",
        )  # compiles once
        assert (
            page.locator(
                ".jp-OutputArea-output[data-mime-type='application/vnd.jupyter.error']"
            ).count()
            == 0
        )
        arenas = page.locator(".wba")
        assert arenas.count() == 3 and page.locator("img.widget-image").count() == 3
        learning, driven, replayed = (arenas.nth(k) for k in range(3))

        # the arena moves: five robots, live
        learning.scroll_into_view_if_needed()
        learning.locator(".play").click()
        _wait_for(lambda: _number(learning, "periods") > 20, 30, "the arena moving")
        load = _load(_kernel(server), MOVING_S)
        frames = _number(learning, "frames-per-second")
        with capsys.disabled():
            print(
                f"\nlive arena, five robots: {frames:.0f} frames/s, kernel load "
                f"{100 * load:.0f} % of a core"
            )
        assert frames > 0
        page.screenshot(path=SHOTS / "1_learning.png")

        # letters typed while the mouse is over an arena are not the notebook's commands: "d d"
        # deletes a cell there
        cells = page.locator(".jp-Notebook .jp-Cell").count()
        page.keyboard.press("Escape")
        learning.locator("canvas").first.hover()
        for key in "wwddaaxx":
            page.keyboard.press(key)
        page.wait_for_timeout(500)
        assert page.locator(".jp-Notebook .jp-Cell").count() == cells

        # dark theme, and a narrow window
        _choose_theme(page, "Dark")
        _wait_for(lambda: "dark" in learning.get_attribute("class"), 20, "the arena going dark")
        page.set_viewport_size({"width": 700, "height": 1000})
        page.wait_for_timeout(1500)
        learning.scroll_into_view_if_needed()
        box = learning.bounding_box()
        assert box["x"] + box["width"] <= 700
        page.screenshot(path=SHOTS / "1_dark_narrow.png")
        page.set_viewport_size({"width": 1100, "height": 1400})
        _choose_theme(page, "Light")
        _wait_for(lambda: "dark" not in learning.get_attribute("class"), 20, "it going light")

        # an interrupt of the kernel does not stop it, and two arenas run side by side
        page.locator("[data-command='notebook:interrupt-kernel']").first.click()
        driven.scroll_into_view_if_needed()
        driven.locator("canvas").first.click(position={"x": 30, "y": 30})
        start = _leader(driven)
        before = _number(learning, "periods")
        page.keyboard.down("ArrowUp")
        page.keyboard.down("a")
        page.wait_for_timeout(1500)
        page.keyboard.up("a")
        page.wait_for_timeout(4500)
        page.screenshot(path=SHOTS / "2_driven.png")
        page.keyboard.up("ArrowUp")
        _wait_for(
            lambda: sum((a - b) ** 2 for a, b in zip(_leader(driven), start, strict=True)) > 0.2**2,
            5,
            "keys driving",
        )
        assert _number(learning, "periods") > before + 20
        page.wait_for_timeout(3000)
        stopped = _leader(driven)
        page.wait_for_timeout(2000)
        assert _leader(driven) == pytest.approx(stopped, abs=0.01)  # nothing held: it stands still

        # the joystick drives, too, and the drive can be saved
        stick = driven.locator(".stick").bounding_box()
        page.mouse.move(stick["x"] + 55, stick["y"] + 55)
        page.mouse.down()
        page.mouse.move(stick["x"] + 40, stick["y"] + 8)
        page.wait_for_timeout(4000)
        page.mouse.up()
        _wait_for(
            lambda: _leader(driven) != pytest.approx(stopped, abs=0.05), 5, "the joystick driving"
        )
        driven.locator(".save").click()
        _wait_for(lambda: "saved" in driven.locator(".said").inner_text(), 30, "saving the drive")

        # scrubbing back shows the past
        replayed.scroll_into_view_if_needed()
        replayed.locator(".speed").select_option("10")
        replayed.locator(".play").click()
        _wait_for(lambda: _number(replayed, "periods") >= 300, 30, "replaying the recorded drive")
        _wait_for(lambda: "play" in replayed.locator(".play").inner_text(), 20, "the replay's end")
        last = replayed.locator("canvas").first.screenshot()
        replayed.locator(".scrub").fill("30")
        page.wait_for_timeout(300)
        assert (
            replayed.locator(".clock").inner_text() == "3.0 s"
            and replayed.locator("canvas").first.screenshot() != last
        )

        # sliders change pictures
        for number in range(3):
            shown = page.locator("img.widget-image").nth(number)
            shown.scroll_into_view_if_needed()
            picture = shown.get_attribute("src")
            box = page.locator(".widget-vbox").nth(number)
            box.locator(".noUi-handle").first.focus()
            page.keyboard.press("ArrowLeft")
            _wait_for(
                lambda shown=shown, picture=picture: shown.get_attribute("src") != picture,
                20,
                "a slider changing its picture",
            )
            page.screenshot(path=SHOTS / f"3_panel_{number}.png")
            # its other values are drawn in the pause, so that sliding shows what is there
            page.wait_for_timeout(3000)
            took = [_redrawn_ms(page, number, key) for key in ("ArrowRight", "ArrowLeft")]
            print(f"panel {number}: redrawn {min(took):.0f} ms after a key (drawn ahead)")

        # a reloaded page finds its arenas again, with what was shown, and they go on
        page.keyboard.press("Control+s")
        page.wait_for_timeout(2500)
        stored = nbformat.read(folder / "00_start_here.ipynb", 4)
        shown = [out for cell in stored.cells for out in cell.get("outputs", []) if "data" in out]
        live = [out.data for out in shown if WIDGET in out.data]
        live = [
            data for data in live if "functions" not in data["text/plain"]
        ]  # a bar of compiling
        assert len(live) == 6 and all("image/png" in data for data in live)
        count = _number(learning, "periods")
        page.reload()
        page.wait_for_selector(".wba", timeout=90_000)
        again = page.locator(".wba").first
        again.scroll_into_view_if_needed()
        _wait_for(lambda: _number(again, "periods") >= count, 30, "the history after a reload")
        again.locator(".play").click()
        _wait_for(lambda: _number(again, "periods") > count + 20, 30, "going on after a reload")
        page.screenshot(path=SHOTS / "4_reloaded.png")
        serious = [error for error in errors if not OUTSIDE.search(error)]
        assert not serious, serious


@pytest.fixture(scope="module")
def narrow():
    with _page(width=700, height=1000) as found:
        yield found


@pytest.mark.parametrize(
    "path", sorted(paths.NOTEBOOKS.glob("[0-9][0-9]_*.ipynb")), ids=lambda path: path.stem
)
def test_a_static_page_of_every_notebook_shows_every_picture_at_700_pixels(path, tmp_path, narrow):
    from nbconvert import HTMLExporter

    page_file = tmp_path / f"{path.stem}.html"
    page_file.write_text(HTMLExporter().from_filename(str(path))[0], encoding="utf-8")
    notebook = nbformat.read(path, 4)
    outputs = [out for cell in notebook.cells if cell.cell_type == "code" for out in cell.outputs]
    told = [out.get("data", {}) for out in outputs]
    pictures = sum("image/png" in data for data in told)
    pictures += sum("<img" in data.get("text/html", "") for data in told)
    page, errors = narrow
    errors.clear()
    page.goto(Path(page_file).as_uri(), wait_until="domcontentloaded")
    images = page.locator(".jp-OutputArea-output img")
    assert images.count() == pictures > 0
    boxes = images.evaluate_all(
        "all => all.map(i => [i.complete && i.naturalWidth > 100, i.getBoundingClientRect().right])"
    )
    assert all(whole and right <= 700 for whole, right in boxes)
    assert page.locator(".jupyter-widgets").count() == 0
    assert not any("widget" in kind for out in outputs for kind in out.get("data", {}))
    page.screenshot(path=SHOTS / f"static_{path.stem}.png", full_page=True)
    serious = [error for error in errors if not OUTSIDE.search(error) and "require" not in error]
    assert not serious, serious
