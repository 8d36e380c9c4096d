"""What a piece of the package depends on: its own files, found by following imports, and a hash of
them.

Compiled code, finished trials and stored runs are only good for as long as what they were made by
stays the same. Nobody keeps a list: imports are followed, also those inside functions, and words of
the form "workbench.room.module:name", by which tables name what they load late.

>>> [path.name for path in files("workbench.robot.motors")]
['compiled.py', 'geometry.py', 'motors.py', 'sources.py']

Contract: files are read once per process; an edit shows at the next start.
"""

import ast
import functools
import hashlib
import importlib
import inspect
import re
from collections.abc import Callable, Iterable
from importlib.metadata import PackageNotFoundError, version as _version
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).resolve().parent
LIBRARIES = ("mujoco", "numba", "numpy", "scipy")  # whose version decides what a run does
_NAME = PACKAGE.name
_IMPORTS = re.compile(
    rf"^[ \t]*from[ \t]+({_NAME}[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n#]+)|^[ \t]*import[ "
    rf"\t]+({_NAME}[\w.]+)"
    rf"|[\"']({_NAME}(?:\.\w+)+):\w+[\"']",
    re.MULTILINE,
)


@functools.cache
def version(library: str) -> str:
    """Return the version of an installed library, "unknown" where its description is not installed
    with it.
    """
    try:
        return _version(library)
    except PackageNotFoundError:
        return "unknown"


def file_of(module: str) -> Path | None:
    """Return the file of a module of the package, None if it has none of that name."""
    if module.split(".")[0] != _NAME:
        return None
    place = PACKAGE.joinpath(*module.split(".")[1:])
    if place.is_dir():
        place = place / "__init__.py"
        return place if place.is_file() else None
    place = place.with_suffix(".py")
    return place if place.is_file() else None


def files(*modules: str) -> tuple[Path, ...]:
    """Return the files of modules and of everything in the package that they import, sorted.

    Raises:
        ValueError: there is no such module.
    """
    found: dict[Path, None] = {}
    waiting = []
    for module in modules:
        path = file_of(module)
        if path is None:
            raise ValueError(f"module {module!r}; expected one of the package {_NAME!r}")
        waiting.append(path)
    while waiting:
        path = waiting.pop()
        if path not in found:
            found[path] = None
            waiting += _imported(path)
    return tuple(sorted(found))


@functools.cache
def digest(module: str) -> str:
    """Return a short hash of the bytes of ``files(module)``."""
    total = hashlib.sha256()
    for path in files(module):
        total.update(path.relative_to(PACKAGE).as_posix().encode() + _hash(path))
    return total.hexdigest()[:16]


def digest_of(function: Callable[..., Any]) -> str:
    """Return a short hash of everything that a function of the package depends on: code, and
    versions of libraries.

    Of the function's own module that is what the function uses, so that a plot in the same file
    does not matter; of others it is the whole module and what it imports. Comments and the layout
    of code do not matter.
    """
    own = importlib.import_module(function.__module__)
    tree = ast.parse(inspect.getsource(own))
    nodes, imported = _used(tree, function.__name__)
    total = hashlib.sha256(f"{function.__module__}.{function.__qualname__}".encode())
    for node in nodes:
        total.update(ast.dump(node).encode())
    for path in files(*imported):
        if path != file_of(own.__name__):
            total.update(path.relative_to(PACKAGE).as_posix().encode() + _dump(path))
    for library in LIBRARIES:
        total.update(f"{library}=={version(library)}".encode())
    return total.hexdigest()[:16]


def _used(tree: ast.Module, name: str) -> tuple[list[ast.AST], list[str]]:
    """Return the statements of a module that one of its names needs, in order, and the package's
    modules that they import.
    """
    binds: dict[str, list[ast.stmt]] = {}
    always = []  # what runs on import without giving a name
    for statement in tree.body:
        names = _bound(statement)
        for bound in names:
            binds.setdefault(bound, []).append(statement)
        if not names and not (
            isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
        ):
            always.append(statement)
    needed: list[ast.stmt] = []
    waiting = [*binds.get(name, []), *always]
    while waiting:
        statement = waiting.pop()
        if statement in needed:
            continue
        needed.append(statement)
        for node in ast.walk(statement):
            if isinstance(node, ast.Name):
                waiting += binds.get(node.id, [])
    ordered: list[ast.AST] = [statement for statement in tree.body if statement in needed]
    modules = {module for statement in ordered for module in _modules(ast.unparse(statement))}
    return ordered, sorted(modules)


def _bound(statement: ast.stmt) -> list[str]:
    """Return the names that a statement of a module gives."""
    if isinstance(statement, (ast.FunctionDef, ast.ClassDef)):
        return [statement.name]
    if isinstance(statement, (ast.Import, ast.ImportFrom)):
        return [(alias.asname or alias.name).split(".")[0] for alias in statement.names]
    if isinstance(statement, (ast.Assign, ast.AnnAssign, ast.AugAssign)):
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        return [
            node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)
        ]
    return []


@functools.cache
def _imported(path: Path) -> tuple[Path, ...]:
    found = (file_of(module) for module in _modules(path.read_text(encoding="utf-8")))
    return tuple(file for file in found if file is not None)


def _modules(text: str) -> Iterable[str]:
    """Return the modules of the package that a text imports or names."""
    for match in _IMPORTS.finditer(text):
        origin, names, plain, named = match.groups()
        if plain or named:
            yield plain or named
            continue
        own = False
        for item in re.sub(r"#[^\n]*", "", names).strip("()").split(","):
            word = item.split()
            if word and file_of(f"{origin}.{word[0]}") is not None:
                yield f"{origin}.{word[0]}"
            else:
                own = own or bool(word)
        if own and file_of(origin) is not None and origin != _NAME:
            yield origin


@functools.cache
def _hash(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).digest()


@functools.cache
def _dump(path: Path) -> bytes:
    return hashlib.sha256(ast.dump(ast.parse(path.read_text(encoding="utf-8"))).encode()).digest()
