"""The shape of the package: who may import whom, how long a module may be, what an import costs."""

from __future__ import annotations

import ast
import importlib
import json
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import flashtemp

ROOT = Path(__file__).parents[2]
TOWER = [  # from the ground; a package imports itself and what stands before it, packages of one floor not each other
    ["errors"],
    ["display", "meshes"],
    ["physics"],
    ["model"],
    ["solver", "camera"],
    ["runs"],
    ["comparison"],
    ["discovery"],
    ["viz"],
    ["api"],
    ["lab"],
    ["cli"],
    ["__main__"],
]
FLOOR = {name: floor for floor, names in enumerate(TOWER) for name in names}
DISCOVERY = [  # the same inside discovery; modules that lie in no group are shared by all and may import from all
    ["hypotheses"],
    ["prediction"],
    ["estimation"],
    ["measurement_errors"],
    ["selection"],
    ["diagnostics"],
]
GROUP_FLOOR = {name: floor for floor, names in enumerate(DISCOVERY) for name in names}
MOST = 15  # entries at the top of flashtemp/
LONGEST = 500  # lines of a module
SCREEN = 60  # lines of a function; its complexity is linted


def modules() -> dict[str, Path]:
    """Every module of the package by its dotted name."""
    files = [*(ROOT / "flashtemp").rglob("*.py"), *(ROOT / "meshes").glob("*.py"), *(ROOT / "viz").rglob("*.py")]
    dotted = {}
    for file in files:
        parts = list(file.relative_to(ROOT).with_suffix("").parts)
        parts = parts if parts[0] == "flashtemp" else ["flashtemp", *parts]
        dotted[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return dotted


MODULES = modules()
INSIDE = [m for m in sorted(MODULES) if m != "flashtemp"]


@cache
def parse_file(file: Path) -> ast.Module:
    return ast.parse(file.read_text())


@cache
def imports(file: Path, lazy: bool = True) -> frozenset[str]:
    """Dotted modules that a file imports; without `lazy` only those imported with the module."""

    def walk(node):
        for child in ast.iter_child_nodes(node):
            inside = isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
            if lazy or not inside:
                yield child
                yield from walk(child)

    found = set()
    for node in walk(parse_file(file)):
        if isinstance(node, ast.Import):
            found.update(a.name for a in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file.name}: relative import"
            full = {a.name: f"{node.module}.{a.name}" for a in node.names}
            found.update(name if name in MODULES else node.module for name in full.values())
    return frozenset(found)


def layer(module: str) -> str:
    """The name in LAYERS of a module of the package."""
    return module.split(".")[1]


def own(file: Path, lazy: bool = True) -> set[str]:
    """Modules of this package that a file imports."""
    return {m for m in imports(file, lazy) if m.startswith("flashtemp.")}


def may_import(module: str) -> set[str]:
    """Packages that a module may import from."""
    floor = FLOOR[layer(module)]  # a new package needs a place in the tower
    return {layer(module), *(name for name, f in FLOOR.items() if f < floor)}


def test_imports_only_from_below():
    above = {m: {n for n in own(MODULES[m]) if layer(n) not in may_import(m)} for m in INSIDE}
    assert {m: names for m, names in above.items() if names} == {}


def discovery_group(module: str) -> str | None:
    """The folder of discovery that a module lies in, if any."""
    inside = MODULES[module].relative_to(ROOT).parts if module in MODULES else ()
    return inside[2] if inside[:2] == ("flashtemp", "discovery") and len(inside) > 3 else None


GROUPED = [m for m in sorted(MODULES) if discovery_group(m)]


@pytest.mark.parametrize("module", GROUPED)
def test_groups_of_discovery_import_only_from_below(module):
    floor = GROUP_FLOOR[discovery_group(module)]  # a new group needs a place in DISCOVERY
    others = {discovery_group(m) for m in own(MODULES[module])} - {discovery_group(module), None}
    assert {g for g in others if GROUP_FLOOR[g] >= floor} == set()


def test_the_listing_stays_short():
    top = {f.name for f in (ROOT / "flashtemp").iterdir() if not f.name.startswith(("__pycache__", "."))}
    assert len(top) <= MOST, sorted(top)


def test_no_module_imports_the_package_itself():
    for module, file in MODULES.items():
        assert "flashtemp" not in set(imports(file)) or layer(module) in ("__main__", "api"), module


def test_no_circles():
    graph = {m: own(f) for m, f in MODULES.items() if m != "flashtemp"}
    assert list(TopologicalSorter(graph).static_order())


def test_drawing_stays_at_the_edge():
    """pyvista and matplotlib only in viz and runs.vtk; nobody imports viz while it is itself being imported."""
    for module in (m for m in INSIDE if layer(m) != "viz"):
        if module != "flashtemp.runs.results.vtk":
            tops = {m.split(".")[0] for m in imports(MODULES[module])}
            assert tops.isdisjoint({"pyvista", "matplotlib", "vtk", "vtkmodules"}), module
        assert not any(layer(m) == "viz" for m in own(MODULES[module], lazy=False)), module


def test_length():
    assert [m for m in INSIDE if len(MODULES[m].read_text().splitlines()) > LONGEST] == []


def test_functions_fit_on_a_screen():
    functions = [(m, n) for m in INSIDE for n in ast.walk(parse_file(MODULES[m])) if isinstance(n, ast.FunctionDef)]
    assert [(m, f.name) for m, f in functions if f.end_lineno - f.lineno + 1 > SCREEN] == []


@pytest.mark.parametrize("folder", ["meshes", "viz"])
def test_no_second_copy_from_the_root(folder):
    """From the project's root a bare `import meshes` would load the folder a second time."""
    done = subprocess.run([sys.executable, "-c", f"import {folder}"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode != 0
    assert f"import flashtemp.{folder}, not {folder}" in done.stderr


def test_public_names():
    assert len(flashtemp.__all__) <= 40
    assert flashtemp.__all__ == sorted({*flashtemp._HOME, "physics"})
    for name in flashtemp.__all__:
        assert getattr(flashtemp, name) is not None


def test_editors_see_what_programs_get():
    """What type checkers read stands beside the table of lazy imports: neither may lag behind."""
    tree = ast.parse(Path(flashtemp.__file__).read_text())
    seen = next(node for node in tree.body if isinstance(node, ast.If))
    homes = {a.name: n.module.removeprefix("flashtemp.") for n in seen.body for a in n.names}
    assert homes == flashtemp._HOME | {"physics": "flashtemp"}


@pytest.mark.parametrize("name", sorted({*flashtemp.__all__} - {"physics"}))
def test_public_name_is_never_a_module(name):
    """Importing the submodule of the same name must not hide the function behind it."""
    importlib.import_module("flashtemp.model.case")
    assert callable(getattr(flashtemp, name))


def fresh(code: str) -> dict:
    """What a fresh process prints as JSON."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


IMPORT = """
import sys, time
began = time.perf_counter()
import flashtemp
{more}
took = time.perf_counter() - began
import json
print(json.dumps({{"took": took, "modules": [m for m in sys.modules if "." not in m]}}))
"""


def test_import_is_cheap():
    tries = [fresh(IMPORT.format(more="")) for _ in range(3)]
    assert min(t["took"] for t in tries) < 0.6
    assert {"numba", "matplotlib", "pyvista", "xarray", "scipy"}.isdisjoint(tries[0]["modules"])


def test_loading_a_case_draws_nothing():
    answer = fresh(IMPORT.format(more="flashtemp.load"))
    assert {"matplotlib", "pyvista", "vtkmodules", "xarray", "h5py"}.isdisjoint(answer["modules"])
