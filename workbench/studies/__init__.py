"""The questions, and what was measured to answer them.

``draw`` and ``decide`` come with all studies; the published tables alone need none of them.
"""

from typing import TYPE_CHECKING, Any

from workbench.studies.published import load_study as load_study

if TYPE_CHECKING:
    from workbench.studies.tables import decide as decide, draw as draw


def __getattr__(name: str) -> Any:
    if name in ("draw", "decide"):
        from workbench.studies import tables

        return getattr(tables, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
