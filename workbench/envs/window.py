"""Pictures that move, for render_mode "human": in a window of matplotlib's, or below the cell of a
notebook.

Contract: where there is neither (no display, no notebook) it says so once and shows nothing.
"""

import warnings
from typing import Any

from numpy.typing import NDArray


class Window:
    """One picture that is drawn anew; a copy has a window of its own."""

    def __init__(self) -> None:
        self._image: Any = None
        self._cell: Any = None
        self._pause = False

    def show(self, pixels: NDArray[Any]) -> None:
        """Show a picture, (height, width, 3) of uint8."""
        from matplotlib import pyplot as plt

        if self._image is None:
            figure, ax = plt.subplots(figsize=(6.4, 4.8))
            ax.set_axis_off()
            figure.subplots_adjust(0, 0, 1, 1)
            self._image = ax.imshow(pixels)
            self._open(plt.get_backend().lower())
        self._image.set_data(pixels)
        if self._cell is not None:
            self._cell.update(self._image.figure)
        elif self._pause:
            plt.pause(0.001)

    def _open(self, backend: str) -> None:
        from matplotlib import pyplot as plt
        from matplotlib.backends.registry import BackendFilter, backend_registry

        figure = self._image.figure
        if "inline" in backend:
            from IPython.display import display

            plt.close(figure)  # else the cell shows it once more at its end
            self._cell = display(figure, display_id=True)
        elif backend in backend_registry.list_builtin(BackendFilter.INTERACTIVE):
            self._pause = True
        else:
            warnings.warn(
                f"render_mode = 'human' with matplotlib's backend {backend!r}, which has no "
                "window: run it in a notebook or with a display, or use 'rgb_array'",
                stacklevel=4,
            )

    def close(self) -> None:
        """Close it; the next picture opens another."""
        if self._image is not None:
            from matplotlib import pyplot as plt

            plt.close(self._image.figure)
        self._image = self._cell = None

    def __getstate__(self) -> dict[str, Any]:
        return {"_image": None, "_cell": None, "_pause": False}
