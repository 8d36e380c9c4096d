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

import base64
import html
from collections.abc import Callable
from typing import Any, NamedTuple

from IPython.display import Image
from matplotlib.figure import Figure

from workbench import paths
from workbench.plots.figures import png
from workbench.view.explorers import History, infrared_explorer, learning_explorer, tile_explorer

Draw = Callable[..., Figure]


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
    first = {
        name: control.options[0] if isinstance(control, Choice) else control.value
        for name, control in controls.items()
    }
    if paths.STATIC:
        return _picture(draw, first)
    from ipywidgets import HTML, Image as Shown, VBox

    parts = {name: _widget(name, control) for name, control in controls.items()}
    shown = Shown(format="png", value=_picture(draw, first).data, layout={"max_width": "700px"})
    said = HTML()

    def change(_: object) -> None:
        try:
            shown.value = _picture(draw, {name: part.value for name, part in parts.items()}).data
            said.value = ""
        except (
            ArithmeticError,
            ValueError,
        ) as error:  # a combination that cannot be: the message says what would
            said.value = f"<span style='color:#a00'>{html.escape(str(error))}</span>"

    for part in parts.values():
        part.observe(change, names="value")

    class Panel(VBox):
        """Controls and a picture, which a stored notebook keeps."""

        def _repr_mimebundle_(self, **options: Any) -> Any:
            data = dict(super()._repr_mimebundle_(**options))
            picture = base64.b64encode(shown.value).decode()
            return data | {"image/png": picture}, {"image/png": {"width": 700}}

    return Panel([*parts.values(), said, shown])


def _picture(draw: Draw, values: dict[str, Any]) -> Image:
    return Image(png(draw(**values)), width=700)


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
        continuous_update=False,
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
