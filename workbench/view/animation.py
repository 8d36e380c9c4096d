"""A scene as an animated PNG, drawn by the ray-cast camera: the same bytes on every machine of a
kind, no OpenGL needed.

    Path("convoy.png").write_bytes(animated_png(StoredScene.of_run(run), start_s=10, seconds=6))

Contract: one picture per ``every`` control periods; colours are reduced to one palette, so that a
README can hold it.
"""

import io
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from workbench.arena.picture import picture
from workbench.formation.places import world_of
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.view.scenes import LiveScene, StoredScene

COLOURS = 96


def pictures(
    scene: LiveScene | StoredScene, frames: range, **view: Any
) -> Iterator[NDArray[np.uint8]]:
    """Yield pictures (height, width, 3) of a scene's frames; ``view``: see
    ``arena.picture.picture``.
    """
    shown = scene.frames
    world = world_of(scene.config)
    for t in frames:
        for robot, (x, y, heading) in enumerate(shown[t, :, :3].tolist()):
            world.place(0, robot, x, y, heading)
        yield picture(world, **view)


def animated_png(
    scene: LiveScene | StoredScene,
    *,
    start_s: float = 0.0,
    seconds: float = 6.0,
    every: int = 1,
    **view: Any,
) -> bytes:
    """Return an animated PNG that repeats for ever, at the speed at which it happened; ``view``:
    see ``arena.picture.picture``.

    Raises:
        ValueError: the scene is shorter than that.
    """
    first, last = round(start_s / CONTROL_PERIOD), round((start_s + seconds) / CONTROL_PERIOD)
    if every < 1:
        raise ValueError(f"every = {every!r}; expected 1 or more control periods per picture")
    if not 0 <= first < last <= len(scene.frames):
        raise ValueError(
            f"start_s = {start_s!r}, seconds = {seconds!r}; the scene has "
            f"{len(scene.frames) * CONTROL_PERIOD:.1f} s"
        )
    images = [
        Image.fromarray(pixels) for pixels in pictures(scene, range(first, last, every), **view)
    ]
    return animated(images, round(1000 * every * CONTROL_PERIOD))


def animated(
    images: Sequence[Image.Image], stands_ms: int | Sequence[int], *, samples: int = 1
) -> bytes:
    """Return an animated PNG of pictures of one size, which repeats for ever.

    Args:
        stands_ms: how long a picture stands, or each of them.
        samples: of how many pictures, spread over all, the colours are taken.
    """
    chosen = [images[k] for k in np.linspace(0, len(images) - 1, samples).astype(int)]
    palette = _palette(np.concatenate([np.asarray(one).reshape(-1, 3) for one in chosen]))
    small = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    buffer = io.BytesIO()
    small[0].save(
        buffer,
        format="PNG",
        save_all=True,
        append_images=small[1:],
        duration=stands_ms if isinstance(stands_ms, int) else list(stands_ms),
        loop=0,
    )
    return buffer.getvalue()


def _palette(pixels: NDArray[np.uint8]) -> Image.Image:
    """Return a picture whose palette serves pixels (N, 3): small and vivid things, the robots, get
    half of the colours.
    """
    vivid = pixels[np.ptp(pixels.astype(int), axis=1) > 40]
    copies = max(1, len(pixels) // max(1, len(vivid)))
    sample = np.concatenate([pixels, np.tile(vivid, (copies, 1))])
    return Image.fromarray(sample[None]).quantize(
        COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )
