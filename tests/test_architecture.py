"""Imports run one way and never in a circle; those for type checkers and those inside functions count too."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("cli", "report", "jobs", "gap", "robot", "vjm", "fea", "cad", "data", "files", "errors")
"""From the top to the bottom."""
APART = {("vjm", "fea"), ("vjm", "cad")}
"""Pairs of which the upper one does not import the lower one either."""
SHOWING = {"rich", "matplotlib", "pyvista", "vtk", "jinja2"}
FACADE = "stiffscope"


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts if parts[0] == FACADE else (FACADE, *parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {
    module_of(path): ast.parse(path.read_text(encoding="utf-8"))
    for folder in (FACADE, "cad", "fea", "vjm", "data")
    for path in (ROOT / folder).rglob("*.py")
}


def imported(module: str) -> set[str]:
    """Every module that a module imports, anywhere in it; of ours by their full names."""
    found = set()
    for node in ast.walk(MODULES[module]):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if name in MODULES else node.module for name in names}
    return found


GRAPH = {module: imported(module) for module in MODULES}


@pytest.mark.xfail(strict=True, reason="gap.effects and gap.state, fea.experiment and fea.tables import each other")
def test_no_circles():
    ours = {module: {name for name in names if name in MODULES} - {module} for module, names in GRAPH.items()}
    TopologicalSorter(ours).prepare()


ROBOT = pytest.param("robot", marks=pytest.mark.xfail(strict=True, reason="vocabulary and effects are still in gap"))


@pytest.mark.parametrize("room", [ROBOT if room == "robot" else room for room in ROOMS])
def test_rooms_import_those_below_only(room):
    below = ROOMS[ROOMS.index(room) :]
    allowed = {f"{FACADE}.{name}" for name in below if (room, name) not in APART}
    for module in MODULES:
        if module.split(".")[1:2] == [room]:
            ours = {name for name in GRAPH[module] if name.split(".")[0] == FACADE}
            strange = {name for name in ours if ".".join(name.split(".")[:2]) not in allowed}
            assert strange == set(), f"{module} imports {strange}"


def test_only_the_report_draws():
    for module, names in GRAPH.items():
        shown = {name.split(".")[0] for name in names} & SHOWING
        assert shown == set() or module.startswith(f"{FACADE}.report"), f"{module} imports {shown}"


def test_every_file_says_what_it_holds():
    assert [module for module, tree in MODULES.items() if not ast.get_docstring(tree)] == []
