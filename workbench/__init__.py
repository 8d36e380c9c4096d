"""Formation control with Greedy-GQ(λ) on simulated e-puck robots. ``import workbench as wb``; see
the README. The verbs:

    learn, learn_seeds          followers learn                    evaluate     follow greedily
    play                        watch, or drive the leader         follow       the whole motion
    learn_own, evaluate_own     objects of your own                compare      runs, with intervals
    load_run, load_robot        what is stored                     sweep        trials on many cores
    open_robot                  a robot on a wire                  prepare      compile ahead

Names are loaded when they are first used (PEP 562), so that a program pays for what it needs; the
list is ``__init__.pyi``.
"""

import importlib
import importlib.util
import re
import sys
from importlib.abc import MetaPathFinder
from pathlib import Path
from typing import Any

_LISTED = re.findall(
    r"^from (\.\S+) import \w+ as (\w+)$",
    Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"),
    re.M,
)
_WHERE = {name: module for module, name in _LISTED}
__all__ = list(_WHERE)


def _introduce() -> None:
    """Tell gymnasium of the environments, where a program uses it; to import it here would cost
    everybody its time.
    """
    if "gymnasium" in sys.modules:
        from .envs.registration import register

        register()
    else:
        sys.meta_path.insert(0, _WhenGymnasiumComes())


class _WhenGymnasiumComes(MetaPathFinder):
    """Introduces the environments once a program has imported gymnasium."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        """Find gymnasium as everybody does, and do more when it is loaded."""
        if name != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_introduce(module: Any) -> None:
                load(module)
                _introduce()

            spec.loader.exec_module = load_and_introduce  # type: ignore[method-assign]
        return spec


def __getattr__(name: str) -> object:
    """Load a public name, or a room, and keep it."""
    if name in _WHERE:
        found = getattr(importlib.import_module(_WHERE[name], __name__), name)
    else:
        try:
            return importlib.import_module(f".{name}", __name__)
        except ModuleNotFoundError as error:
            if error.name != f"{__name__}.{name}":
                raise
            from .fields import did_you_mean

            raise AttributeError(
                f"module {__name__!r} has no attribute {name!r}{did_you_mean(name, __all__)}",
                name=name,
                obj=sys.modules[__name__],  # Python adds what it is like
            ) from None
    globals()[name] = found
    return found


_introduce()


def __dir__() -> list[str]:
    return sorted({*__all__, "__all__", "__doc__", "__file__", "__name__", "__path__"})
