"""Panels: sliders and choices around a pure function that draws, and the same picture where there
is no page.

    panel(tile_explorer, spacing=Choice(("uniform", "logarithmic")), distance_tiles=Slider(3, 15, 2,
    9))

``tile_panel``, ``infrared_panel`` and ``learning_panel`` are those of the notebooks. With
WORKBENCH_STATIC=1 a panel is the picture of its first values, the static twin that stored and
exported notebooks show.

Contract: callbacks hold no science: they call the function with the controls' values and show what
it returns, or its error.
"""

import asyncio
import base64
import html
from collections.abc import Callable
from typing import Any, NamedTuple

from IPython.display import Image
from matplotlib.figure import Figure

from workbench import paths
from workbench.plots.figures import hasty_png, png
from workbench.view.explorers import History, infrared_explorer, learning_explorer, tile_explorer

Draw = Callable[..., Figure]
WIDTH = 700  # pixels
REST_S = 0.3  # after which the picture is drawn with care


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
    last = draw(**first)
    shown = Shown(format="png", value=png(last), layout={"max_width": f"{WIDTH}px"})
    said = HTML()
    rest = _Rest()

    def change(_: object) -> None:
        values = {name: part.value for name, part in parts.items()}

        def careful() -> None:
            nonlocal last
            last = draw(**values)
            shown.value = png(last)

        try:
            # while a slider moves the layout stays
            quick = hasty_png(draw(**values), last, WIDTH) if rest.possible else None
            if quick is None:
                careful()
            else:
                shown.value = quick
                rest.then(careful)
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


class _Rest:
    """Something to do once controls rest, where a kernel's event loop runs."""

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

    def then(self, what: Callable[[], None]) -> None:
        """Do it once nothing else has been asked for REST_S."""
        if self._waiting is not None:
            self._waiting.cancel()
        self._waiting = asyncio.get_running_loop().call_later(REST_S, what)


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
        show=Choice(("all", "visits", "values", "actions")),
        follower=Choice(tuple(range(1, history.config.followers + 1)), "table of follower"),
    )
