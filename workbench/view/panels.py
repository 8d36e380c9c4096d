"""Panels: sliders and choices around a pure function that draws, and the same picture where there
is no page.

    panel(tile_explorer, spacing=Choice(("uniform", "logarithmic")), distance_tiles=Slider(3, 15, 2,
    9))

``tile_panel``, ``infrared_panel`` and ``learning_panel`` are those of the notebooks. With
WORKBENCH_STATIC=1 a panel is the picture of its first values, the static twin that stored and
exported notebooks show.

Contract: callbacks hold no science: they call the function with the controls' values and show what
it returns, or its error. Once somebody has moved a control, the pictures of its other values are
drawn in the pauses, nearest first, so that sliding shows what is there already.
"""

import asyncio
import base64
import contextlib
import html
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from IPython.display import Image
from matplotlib.figure import Figure

from workbench import paths
from workbench.plots.figures import hasty_png, png
from workbench.view.explorers import History, infrared_explorer, learning_explorer, tile_explorer

Draw = Callable[..., Figure]
WIDTH = 700  # pixels
REST_S = 0.3  # after which the picture is drawn with care
PAUSE_S = 0.005  # between pictures that are drawn ahead, for whatever else is asked for
KEPT = 500  # pictures of a panel, of some 50 kB


class Slider(NamedTuple):
    """A number from low to high, whole if all four are."""

    low: float
    high: float
    step: float
    value: float
    label: str = ""


class Choice(NamedTuple):
    """One of a few values, the first at the start."""

    options: tuple[Any, ...]
    label: str = ""


def panel(draw: Draw, **controls: Slider | Choice) -> Any:
    """Return a widget that draws anew whenever a control changes, or with WORKBENCH_STATIC=1 the
    picture of the first values.

    Args:
        draw: a function of the controls' names that returns a figure.
        controls: see ``Slider`` and ``Choice``.
    """
    first = {name: _first(control) for name, control in controls.items()}
    if paths.STATIC:
        return _picture(draw, first)
    from ipywidgets import HTML, Image as Shown

    parts = {name: _widget(name, control) for name, control in controls.items()}
    pictures = _Pictures(draw)
    shown = Shown(format="png", value=pictures.careful(first), layout={"max_width": f"{WIDTH}px"})
    said = HTML()
    rest = _Rest()

    def change(event: Any) -> None:
        values = {name: part.value for name, part in parts.items()}
        [moved] = [name for name, part in parts.items() if part is event["owner"]]

        def settle() -> Iterator[None]:
            shown.value = pictures.careful(values)
            for value in _nearest_first(controls[moved], values[moved]):
                yield
                pictures.ahead(values | {moved: value})

        try:
            shown.value = pictures.quick(values) if rest.possible else pictures.careful(values)
            rest.then(settle)
            said.value = ""
        except (ArithmeticError, ValueError) as error:
            # a combination that cannot be: the message says what would
            said.value = f"<span style='color:#a00'>{html.escape(str(error))}</span>"

    for part in parts.values():
        part.observe(change, names="value")

    return _kept([*parts.values(), said, shown], shown)


def _first(control: Slider | Choice) -> Any:
    return control.options[0] if isinstance(control, Choice) else control.value


def _kept(parts: list[Any], shown: Any) -> Any:
    """Return controls and a picture, which a stored notebook keeps."""
    from ipywidgets import VBox

    class Panel(VBox):
        """Controls and a picture."""

        def _repr_mimebundle_(self, **options: Any) -> Any:
            data = dict(super()._repr_mimebundle_(**options))
            picture = base64.b64encode(shown.value).decode()
            return data | {"image/png": picture}, {"image/png": {"width": WIDTH}}

    return Panel(parts)


class _Pictures:
    """A panel's pictures by the controls' values: careful ones, and hasty ones with the layout of
    the last careful one.
    """

    def __init__(self, draw: Draw) -> None:
        self._draw = draw
        self._last = Figure()
        self._kept: dict[tuple[Any, ...], bytes] = {}

    def careful(self, values: dict[str, Any]) -> bytes:
        """Draw with the layout that fits."""
        self._last = self._draw(**values)
        return self._keep(values, png(self._last))

    def quick(self, values: dict[str, Any]) -> bytes:
        """Return the picture that is there, or draw one in haste."""
        known = self._kept.get(_key(values))
        if known is not None:
            return known
        hasty = hasty_png(self._draw(**values), self._last, WIDTH)
        return self.careful(values) if hasty is None else self._keep(values, hasty)

    def ahead(self, values: dict[str, Any]) -> None:
        """Draw what may be asked for next; combinations that cannot be are left to who asks."""
        with contextlib.suppress(ArithmeticError, ValueError):
            if _key(values) not in self._kept:
                hasty = hasty_png(self._draw(**values), self._last, WIDTH)
                if hasty is not None:
                    self._keep(values, hasty)

    def _keep(self, values: dict[str, Any], picture: bytes) -> bytes:
        if len(self._kept) >= KEPT:
            self._kept.clear()
        self._kept[_key(values)] = picture
        return picture


def _key(values: dict[str, Any]) -> tuple[Any, ...]:
    """Return values as what names a picture; sums of steps are not exact."""
    return tuple(round(v, 9) if isinstance(v, float) else v for v in values.values())


def _nearest_first(control: Slider | Choice, value: Any) -> list[Any]:
    """Return a control's other values, those next to the present one first."""
    if isinstance(control, Choice):
        options, near = list(control.options), control.options.index(value)
    else:
        count = round((control.high - control.low) / control.step) + 1
        options = [control.low + k * control.step for k in range(count)]
        near = round((value - control.low) / control.step)
    order = sorted(range(len(options)), key=lambda k: abs(k - near))
    return [options[k] for k in order if k != near]


class _Rest:
    """Something to do bit by bit once controls rest, where a kernel's event loop runs."""

    def __init__(self) -> None:
        self._waiting: asyncio.TimerHandle | None = None

    @property
    def possible(self) -> bool:
        """Whether there is a loop that waits."""
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return False
        return True

    def then(self, what: Callable[[], Iterator[None]]) -> None:
        """Begin once nothing else has been asked for REST_S, in place of what was to be done."""
        if self._waiting is not None:
            self._waiting.cancel()
        if self.possible:
            self._wait(REST_S, what())

    def _wait(self, seconds: float, rest: Iterator[None]) -> None:
        def go() -> None:
            # an iterator that has ended says so by what is left: nothing
            if next(rest, self) is None:
                self._wait(PAUSE_S, rest)

        self._waiting = asyncio.get_running_loop().call_later(seconds, go)


def _picture(draw: Draw, values: dict[str, Any]) -> Image:
    return Image(png(draw(**values)), width=WIDTH)


def _widget(name: str, control: Slider | Choice) -> Any:
    from ipywidgets import Dropdown, FloatSlider, IntSlider

    look = {
        "description": control.label or name.replace("_", " "),
        "style": {"description_width": "190px"},
    }
    if isinstance(control, Choice):
        return Dropdown(options=control.options, **look)
    whole = all(isinstance(value, int) for value in control[:4])
    kind = IntSlider if whole else FloatSlider
    return kind(
        min=control.low,
        max=control.high,
        step=control.step,
        value=control.value,
        layout={"width": "560px"},
        **look,
    )


def tile_panel() -> Any:
    """Return the tile explorer."""
    return panel(
        tile_explorer,
        spacing=Choice(("uniform", "logarithmic")),
        distance_tiles=Slider(3, 15, 2, 9),
        bearing_tiles=Slider(3, 15, 2, 9),
        inner_mm=Slider(1.0, 8.0, 0.5, 3.0, "middle tile, ± mm (log.)"),
        tilings=Choice((1, 2, 4, 8), "offset tilings"),
    )


def infrared_panel() -> Any:
    """Return the infrared explorer."""
    return panel(
        infrared_explorer,
        distance_mm=Slider(76, 160, 1, 105, "distance, mm"),
        bearing_deg=Slider(-40, 40, 1, 0, "bearing, degrees"),
        reflectance=Slider(0.1, 2.0, 0.1, 1.0, "reflectance of the cup"),
        ambient=Slider(0, 4000, 100, 0, "ambient light, counts"),
        route=Choice(("ir-metric", "ir-raw"), "tiles of"),
    )


def learning_panel(history: History) -> Any:
    """Return the learning explorer of a run, at its end first."""

    def draw(block: int, follower: int, show: str) -> Figure:
        return learning_explorer(history, block=block - 1, follower=follower, show=show)

    blocks = len(history.updates)
    return panel(
        draw,
        block=Slider(1, blocks, 1, blocks, "block (250 s each)"),
        show=Choice(("all", "visits", "values", "actions", "confidence")),
        follower=Choice(tuple(range(1, history.config.followers + 1)), "table of follower"),
    )
