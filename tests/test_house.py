"""The house: imports point downwards, rooms stay small, functions short, lines narrow."""

import ast
import importlib
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

from workbench import paths, sources

ROOMS = (  # from the roof to the ground; a room may import from its own and from those after it
    "__main__ bench peers publishing notebooks",
    "studies",
    "view",
    "envs",
    "plots",
    "measures",
    "logs",
    "lab",
    "formation",
    "arena",
    "learning robot",  # these two know nothing of each other
    "fields compiled functions markup paths sources __init__",
)
MODULES = sorted(sources.PACKAGE.rglob("*.py"))


def _floor(module):
    """Return how high a module lies, and its room."""
    room = module.split(".")[1] if "." in module else "__init__"
    [floor] = [k for k, rooms in enumerate(ROOMS) if room in rooms.split()]
    return floor, room


def _module(path):
    return ".".join(("workbench", *path.relative_to(sources.PACKAGE).with_suffix("").parts))


@pytest.mark.parametrize("path", MODULES, ids=_module)
def test_no_import_points_upwards_also_not_inside_a_function(path):
    floor, room = _floor(_module(path))
    text = path.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            for module in sources._modules(ast.unparse(node)):
                other, theirs = _floor(module)
                alike = floor == other in (0, len(ROOMS) - 1)  # files without a room
                assert other > floor or theirs == room or alike, f"{_module(path)} imports {module}"


def test_no_room_has_more_than_a_fifth_of_the_lines():
    lines: dict[str, int] = {}
    for path in MODULES:
        parts = path.relative_to(sources.PACKAGE).parts
        room = parts[0] if len(parts) > 1 else "roof and ground"
        lines[room] = lines.get(room, 0) + len(path.read_text(encoding="utf-8").splitlines())
    shares = {room: count / sum(lines.values()) for room, count in lines.items()}
    assert max(shares.values()) <= 0.2, sorted(shares.items(), key=lambda item: -item[1])[:3]


LOOP = {"formation_step", "act"}  # the compiled loop's two


def test_functions_are_short_and_take_few_arguments():
    long, many = [], []
    for path in MODULES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.FunctionDef):
                continue
            name = f"{_module(path)}:{node.name}"
            document = ast.get_docstring(node, clean=False) or ""
            first = node.body[0].lineno if not document else node.body[0].end_lineno + 1
            if node.end_lineno - first + 1 > 40 and node.name.strip("_") not in LOOP:
                long.append(name)
            arguments = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
            own = [a for a in arguments if a.arg not in ("self", "cls")]
            if len(own) > 10:
                many.append(name)
    assert not long
    assert not many


def test_lines_are_at_most_a_hundred_columns_wide():
    listed = subprocess.run(
        ["git", "ls-files", "*.py"], cwd=paths.ROOT, capture_output=True, text=True, check=False
    )
    for name in listed.stdout.splitlines():
        for number, line in enumerate(Path(paths.ROOT, name).read_text().splitlines(), 1):
            assert len(line) <= 100, f"{name}:{number}"


def test_nothing_imports_a_study_but_studies():
    for path in MODULES:
        if "studies" in path.parts or path.stem in ("__main__", "publishing", "bench"):
            continue
        text = path.read_text(encoding="utf-8")
        assert "workbench.studies" not in text, path


def test_every_folder_of_the_package_is_installed():
    project = tomllib.loads((paths.ROOT / "pyproject.toml").read_text())
    told = set(project["tool"]["setuptools"]["packages"]) - {"workbench.data"}
    folders = {path.parent for path in sources.PACKAGE.rglob("__init__.py")}
    root = sources.PACKAGE.parent
    assert told == {".".join(folder.relative_to(root).parts) for folder in folders}


ROOM_NAMES = "arena envs formation lab learning logs measures plots studies view workbench".split()
SUBROOMS = {"senses": "formation.senses", "laws": "formation.laws", "drives": "arena.drives"}
SUBROOMS |= {"wire": "robot.wire", "validation": "studies.validation", "camera": "arena.camera"}


def _resolves(name):
    """Whether a dotted name in a docstring is something of the package."""
    first, *rest = name.split(".")
    full = ".".join([SUBROOMS.get(first, first), *rest]).removeprefix("workbench.")
    parts = full.split(".")
    for length in range(len(parts), -1, -1):
        try:
            found = importlib.import_module(".".join(["workbench", *parts[:length]]))
        except ImportError:
            continue
        for part in parts[length:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def test_docstrings_name_modules_and_functions_that_are_there():
    firsts = "|".join([*ROOM_NAMES, "senses", "laws", "drives", "wire", "validation"])
    pattern = re.compile(rf"``((?:{firsts})(?:\.\w+)+)``")
    gone = [
        f"{_module(path)}: {name}"
        for path in MODULES
        for name in pattern.findall(path.read_text(encoding="utf-8"))
        if not _resolves(name)
    ]
    assert not gone
