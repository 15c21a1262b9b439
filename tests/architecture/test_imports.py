"""The house rules that a reader of the source can check: who imports whom, and how long things are."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = "musatpy"

EVERYONE = {"errors", "extras", "units", "fortran", "files", "specs", "draws", "arrays", "figures", "probability"}
# Room -> the rooms whose modules it may import, besides EVERYONE and itself.
MAY_IMPORT: dict[str, set[str]] = {
    "arrays": set(),
    "errors": set(),
    "extras": set(),
    "units": set(),
    "fortran": set(),
    "files": set(),
    "specs": set(),
    "draws": set(),
    "probability": set(),
    "figures": set(),
    "pointfiles": set(),
    "interchange": {"pointfiles", "geometry"},
    "memory": set(),
    "model": set(),
    "geometry": set(),
    "refraction": {"geometry"},
    "orientation": {"model", "geometry", "refraction"},
    "adjustment": {
        "model",
        "geometry",
        "refraction",
        "orientation",
        "sea",
        "reduction",
    },  # of the sea, the waves of a deck
    "blunders": {"model", "geometry", "orientation", "adjustment", "statistics", "jobs"},
    "pipeline": {"model", "reduction", "blunders", "adjustment", "statistics"},
    "formats": {"model", "geometry", "refraction", "systems", "sea", "statistics"},
    "systems": {"model", "geometry"},
    "statistics": {"model", "geometry", "systems"},
    "records": {"model", "geometry", "systems"},
    "comparison": {"model", "geometry", "records"},
    "orienting": {"model", "geometry", "orientation", "adjustment", "statistics", "reduction", "jobs"},
    "surfaces": set(),
    "soundings": {"statistics", "pointfiles", "geometry", "interchange"},
    "compilation": {
        "model",
        "statistics",
        "systems",
        "geometry",
        "refraction",
        "reduction",
        "adjustment",
        "pointfiles",
        "surfaces",
        "soundings",
        "interchange",
        "sea",
        "records",
    },
    "reports": {
        "model",
        "formats",
        "statistics",
        "comparison",
        "records",
        "jobs",
        "sea",
        "orientation",
        "orienting",
        "compilation",
        "surfaces",
        "soundings",
    },
    "notebook": {"model", "statistics", "reports"},
    "simulation": {"model", "geometry", "sea", "formats"},  # of the sea, linear theory and what cannot be
    "reduction": {"model", "geometry", "statistics"},
    "jobs": {"model", "formats", "geometry", "adjustment", "reduction", "statistics"},
    "keypunch": {"formats", "pointfiles"},
    "sfm": {
        "model",
        "geometry",
        "systems",
        "reduction",
        "refraction",
        "pointfiles",
        "interchange",
        "records",
        "formats",
    },
    "depth": {"model", "geometry", "refraction", "records", "pointfiles"},
    "sea": {"model", "geometry", "refraction", "systems", "records", "depth", "pointfiles"},
    "correction": {
        "model",
        "geometry",
        "refraction",
        "reduction",
        "adjustment",
        "sfm",
        "records",
        "compilation",
        "depth",
        "interchange",
        "pointfiles",
        "sea",
        "soundings",
    },
    "runs": {
        "memory",
        "model",
        "formats",
        "pipeline",
        "statistics",
        "comparison",
        "records",
        "reports",
        "jobs",
    },
    "as11_comparisons": {"as11_runs", "compilation", "geometry", "reports", "soundings"},
    "as11_runs": {
        "model",
        "formats",
        "compilation",
        "adjustment",
        "interchange",
        "plots",
        "reports",
        "runs",
        "statistics",
    },
    "orient_runs": {"model", "formats", "orientation", "orienting", "reports", "runs"},
    "plots": {  # of reports, the schemas of records, and the tables of a solution
        "model",
        "geometry",
        "records",
        "statistics",
        "soundings",
        "interchange",
        "pointfiles",
        "reports",
    },
    "page": {"model", "geometry", "records", "statistics", "reports", "listings", "soundings", "plots"},
    "gis": {"geometry", "records", "interchange", "plots"},  # of plots, footprints
    "shown_runs": {"runs", "reports", "statistics", "geometry", "interchange", "plots", "gis", "page"},
    "listings": {"records", "reports"},
    "examples": set(),
    "campaign": {
        "memory",
        "model",
        "formats",
        "jobs",
        "runs",
        "as11_runs",
        "listings",
        "page",
        "shown_runs",
    },
    "cli": {
        "memory",
        "campaign",
        "examples",
        "model",
        "keypunch",
        "formats",
        "runs",
        "orient_runs",
        "as11_comparisons",
        "as11_runs",
        "correction",
        "sfm",
        "compilation",
        "soundings",
        "simulation",
        "jobs",
        "reports",
        "page",
        "listings",
        "depth",
        "sea",
        "pointfiles",
        "plots",
        "shown_runs",
        "geometry",
    },
    "__main__": {"cli"},
}
# (room, other room) -> the only modules of the other that it may import.
ONLY = {
    ("cli", "geometry"): {"musatpy.geometry.areas"},  # those of options
    ("correction", "soundings"): {"musatpy.soundings.s44"},
    ("adjustment", "reduction"): {"musatpy.reduction.distortion", "musatpy.reduction.refined_block"},  # lenses
    ("simulation", "formats"): {"musatpy.formats.refractive_index"},  # the refractive index of what a WTC card says
    ("formats", "statistics"): {"musatpy.statistics.gates"},  # when a height contradicts a flag
}
# The public names, each imported when it is first asked for; the package itself may be imported by anyone for its
# version, because importing it loads nothing (a test below).
FRONT_DOOR = "__init__"

# What `musat run` must not load: it would cost more than the adjustment of a strip.
HEAVY = ("scipy.sparse", "scipy.optimize", "scipy.stats", "pandas", "xarray", "matplotlib", "dask")
SHORT_FILE = 500
SHORT_FUNCTION = 60


@cache
def parsed(source: str) -> ast.Module:
    return ast.parse(source)


@cache
def nodes_of(source: str) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(parsed(source)))


def room_of(module: str) -> str:
    """Return the room of a dotted module name: `model` of `musatpy.model.block`."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else FRONT_DOOR


def imported(nodes: Iterable[ast.AST], module: str) -> Iterator[str]:
    """Yield the dotted names of all that `nodes` of a module import: typing-only, relative and by call too."""
    package = module.split(".")
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level] if node.level else []
            origin = ".".join([*base, *([node.module] if node.module else [])])
            if origin == PACKAGE:
                # a name of the package is a room, or one of its own names
                yield from (f"{PACKAGE}.{a.name}" if a.name in MAY_IMPORT else PACKAGE for a in node.names)
            else:
                yield from (f"{origin}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call):
            yield from _by_name(node)


def _by_name(call: ast.Call) -> Iterator[str]:
    function = call.func
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    if name in ("import_module", "__import__") and call.args and isinstance(call.args[0], ast.Constant):
        yield str(call.args[0].value)


def breaches(source: str, module: str) -> list[str]:
    """Return what a module imports of the package and may not."""
    room = room_of(module)
    if room == FRONT_DOOR:
        return []
    allowed = {FRONT_DOOR, room, *EVERYONE, *MAY_IMPORT.get(room, set())}
    names = {name for name in imported(nodes_of(source), module) if _is_ours(name)}
    found = {room_of(name) for name in names} - allowed
    for name in names:
        only = ONLY.get((room, room_of(name)))
        if only is not None and not any(f"{name}.".startswith(f"{one}.") for one in only):
            found.add(room_of(name))
    return sorted(f"{module}: {room} imports {other}" for other in found)


def _is_ours(name: str) -> bool:
    return name.split(".")[0] == PACKAGE


def heavy_at_the_top(source: str, module: str) -> list[str]:
    """Return the heavy packages that a module loads when it is imported (imports inside functions may)."""
    if not any(heavy.split(".")[-1] in source for heavy in HEAVY):
        return []  # most, and quickly
    names = imported(_run_on_import(parsed(source)), module)
    return [name for name in names if any(f"{name}.".startswith(f"{heavy}.") for heavy in HEAVY)]


def _run_on_import(node: ast.AST) -> Iterator[ast.AST]:
    yield node
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from _run_on_import(child)


def long_functions(source: str, module: str) -> list[str]:
    """Return `module.function: length` of every function that is too long, its docstring not counted."""
    found = []
    for node in nodes_of(source):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node, clean=False)
            length = node.end_lineno - node.lineno + 1 - (text.count("\n") + 1 if text else 0)
            name = f"{module}.{node.name}"
            if length > SHORT_FUNCTION:
                found.append(f"{name}: {length} lines")
    return found


def modules() -> dict[str, Path]:
    """Return every module of the package by its dotted name."""
    paths = sorted((ROOT / "src").rglob("*.py"))
    return {".".join(path.relative_to(ROOT / "src").with_suffix("").parts): path for path in paths}


MODULES = modules()


def test_no_two_rooms_need_each_other() -> None:
    TopologicalSorter(MAY_IMPORT).prepare()  # raises CycleError, which says the circle


def test_the_source_was_found():
    assert {room_of(name) for name in MODULES} == {*MAY_IMPORT, FRONT_DOOR}


def test_modules_keep_the_rules():
    found = []
    for name, path in MODULES.items():
        source = path.read_text(encoding="utf-8")
        found += breaches(source, name) + long_functions(source, name)
        found += [f"{name} loads {heavy}" for heavy in heavy_at_the_top(source, name)]
        found += [f"{name} has over {SHORT_FILE} lines"] * (source.count("\n") > SHORT_FILE)
    assert found == []


def _loaded_by(code: str) -> set[str]:
    code = f"import sys\n{code}\nprint(*sys.modules)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(ran.stdout.split())


def test_the_front_door_loads_nothing():
    loaded = _loaded_by("import musatpy")
    assert {name for name in loaded if _is_ours(name)} == {PACKAGE}


def test_a_run_loads_nothing_heavy():
    deck = ROOT / "fixtures" / "st_thomas" / "st_thomas.crd"
    loaded = _loaded_by(
        f"from musatpy.runs import run_deck; import tempfile; run_deck({str(deck)!r}, tempfile.mkdtemp())"
    )
    assert f"{PACKAGE}.adjustment.musat2a" in loaded
    assert not loaded & set(HEAVY)
    assert not {name for name in loaded if room_of(name) == "systems" and _is_ours(name)}
    assert f"{PACKAGE}.geometry.projected" not in loaded


# --- the checks themselves can fail ---


@pytest.mark.parametrize(
    ("module", "source", "found"),
    [
        ("musatpy.model.block", "from musatpy.geometry import geodesy", "geometry"),
        ("musatpy.model.block", "import musatpy.formats.musat", "formats"),
        ("musatpy.model.block", "from musatpy import runs", "runs"),
        ("musatpy.model.block", "def late():\n    from musatpy.reports.table import Table", "reports"),
        ("musatpy.model.block", "from ..statistics import quality", "statistics"),
        ("musatpy.model.block", "if TYPE_CHECKING:\n    from musatpy.cli import main", "cli"),
        ("musatpy.model.block", "from importlib import import_module\nimport_module('musatpy.cli.run')", "cli"),
        ("musatpy.simulation.scene_keys", "from musatpy.formats import musat", "formats"),
        ("musatpy.newroom.thing", "from musatpy.model import Block", "model"),
    ],
)
def test_a_breach_is_found(module, source, found):
    assert breaches(source, module) == [f"{module}: {room_of(module)} imports {found}"]


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("musatpy.model.block", "from musatpy.model.tables import freeze\nfrom . import arrays"),
        ("musatpy.model.block", "import musatpy\nfrom musatpy import __version__, units"),
        ("musatpy.refraction.flat", "from ..geometry.geodesy import Frame\nimport numpy as np"),
        ("musatpy.cli.run", "def command():\n    from musatpy.runs import run_deck"),
        ("musatpy.simulation.scene_keys", "from musatpy.formats.refractive_index import index_of"),
    ],
)
def test_what_is_allowed_is_no_breach(module, source):
    assert breaches(source, module) == []


@pytest.mark.parametrize("line", ["import pandas", "from scipy import sparse", "import scipy.sparse.linalg as la"])
def test_a_heavy_import_is_found_at_the_top_only(line):
    late = f"def slow():\n    {line}"
    assert heavy_at_the_top(late, "musatpy.runs") == []
    assert heavy_at_the_top(f"try:\n    {line}\nexcept ImportError:\n    pass", "musatpy.runs")
    assert heavy_at_the_top(line, "musatpy.runs")


def test_a_long_function_is_found():
    body = "\n".join(["    x = 1"] * SHORT_FUNCTION)
    assert long_functions(f"def f():\n{body}", "m") == [f"m.f: {SHORT_FUNCTION + 1} lines"]
    documented = f'def f():\n    """One.\n\n    Two.\n    """\n{body[10:]}'
    assert long_functions(documented, "m") == []


def test_no_files_need_each_other() -> None:
    """A module needs what it imports at its top; what it imports when it is called is there by then."""
    needs = {name: at_the_top(MODULES[name].read_text(encoding="utf-8"), name) for name in MODULES}
    TopologicalSorter({name: other - {name} for name, other in needs.items()}).prepare()


def at_the_top(source: str, module: str) -> set[str]:
    """Return the modules that a module imports when it is loaded."""
    top = [node for node in parsed(source).body if isinstance(node, ast.Import | ast.ImportFrom)]
    return {name.rpartition(".")[0] if name not in MODULES else name for name in imported(top, module)} & set(
        MODULES
    )
