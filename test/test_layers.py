"""Direction of imports between the layers of the package, and between their folders."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "tactile_localizer"

ROS = {
    "rclpy",
    "ament_index_python",
    "launch",
    "launch_ros",
    "rcl_interfaces",
    "builtin_interfaces",
    "rosgraph_msgs",
}

MAY_IMPORT_LAYERS = {
    "core": {"core"},
    "io": {"core", "io"},
    "sim": {"core", "io", "sim"},
    "offline": {"core", "io", "sim", "offline"},
    "ros": {"core", "io", "sim", "offline", "ros", "msg", "srv"},
    "demo": {"core", "io", "sim", "offline", "ros", "demo", "msg", "srv"},
    "cli": {"core", "io", "sim", "offline", "demo", "cli"},
}
"""Layers that each layer may import; ``errors``, ``scene`` and ``resources`` are below all of them."""

MAY_IMPORT_FOLDERS: dict[str, dict[str, set[str]]] = {
    "core": {
        "geometry": set(),
        "scan": {"geometry"},
        "likelihood": {"geometry", "scan", ""},
        "filters": {"geometry", "scan", "likelihood"},
        "decision": {"geometry", "scan", "likelihood", "filters"},
        "calibration": {"geometry", "scan", "likelihood", "filters", "decision", ""},
        "": {"geometry", "scan", "likelihood", "filters", "decision", "calibration"},
    },
    "io": {
        "": set(),
        "can": {""},
        "bags": {""},
        "csv": {""},
        "scans": {"", "csv"},
    },
    "offline": {
        "": set(),
        "figures": {""},
        "reports": {"", "figures"},
    },
    "ros": {
        "base": set(),
        "conversions": {"base"},
        "subscriptions": {"base", "conversions"},
        "publishers": {"base", "conversions"},
        "diagnostics": {"base", ""},
        "": {
            "base",
            "conversions",
            "subscriptions",
            "publishers",
            "diagnostics",
        },
    },
}
"""Folders that each folder of a layer may import; ``""`` stands for the modules of the layer itself."""

FOLDERS = [(layer, folder) for layer, folders in MAY_IMPORT_FOLDERS.items() for folder in folders]


def modules(layer: str) -> list[Path]:
    return sorted((PACKAGE / layer).rglob("*.py"))


def imported(path: Path, lazily: bool = True) -> set[str]:
    """Full names that a module imports; with ``lazily`` also inside functions."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names: set[str] = set()
    nodes = ast.walk(tree) if lazily else iter(tree.body)
    for node in nodes:
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: expected absolute imports, found a relative one"
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def is_ros(name: str) -> bool:
    top = name.split(".")[0]
    return top in ROS or top.endswith(("_msgs", "_srvs"))


def layer_of(name: str) -> str | None:
    """The layer that a full name belongs to, if it is one of the package's layers."""
    parts = name.split(".")
    known = set(MAY_IMPORT_LAYERS) | {"msg", "srv"}
    return parts[1] if parts[0] == "tactile_localizer" and len(parts) > 1 and parts[1] in known else None


@pytest.mark.parametrize("layer", MAY_IMPORT_LAYERS)
def test_a_layer_imports_only_the_layers_below_it(layer: str) -> None:
    wrong = {
        f"{path.relative_to(PACKAGE)} imports {name}"
        for path in modules(layer)
        for name in imported(path)
        if (found := layer_of(name)) is not None and found not in MAY_IMPORT_LAYERS[layer]
    }
    assert modules(layer), f"{layer}: expected modules, found none"
    assert wrong == set()


def folder_of(layer: str, name: str) -> str | None:
    """The folder of a layer that a full name belongs to; ``None`` if it is not in the layer."""
    parts = name.split(".")
    if parts[:2] != ["tactile_localizer", layer]:
        return None
    return parts[2] if len(parts) > 2 and parts[2] in MAY_IMPORT_FOLDERS[layer] else ""


@pytest.mark.parametrize("layer", MAY_IMPORT_FOLDERS)
def test_every_folder_of_a_layer_is_listed(layer: str) -> None:
    folders = {path.parent.name for path in PACKAGE.glob(f"{layer}/*/__init__.py")}
    assert folders == set(MAY_IMPORT_FOLDERS[layer]) - {""}


@pytest.mark.parametrize(("layer", "folder"), FOLDERS)
def test_a_folder_imports_only_the_folders_below_it(layer: str, folder: str) -> None:
    allowed = MAY_IMPORT_FOLDERS[layer][folder] | {folder}
    path = PACKAGE / layer / folder
    paths = sorted(path.rglob("*.py") if folder else path.glob("*.py"))
    wrong = {
        f"{path.relative_to(PACKAGE)} imports {name}"
        for path in paths
        for name in imported(path)
        if (found := folder_of(layer, name)) is not None and found not in allowed
    }
    assert paths, f"{layer}/{folder}: expected modules, found none"
    assert wrong == set()


def test_the_core_imports_only_numpy_scipy_and_the_standard_library() -> None:
    allowed = {"numpy", "scipy", "tactile_localizer"} | set(sys.stdlib_module_names)
    wrong = {
        f"{path.name} imports {name}"
        for path in modules("core")
        for name in imported(path)
        if name.split(".")[0] not in allowed
    }
    assert wrong == set()


@pytest.mark.parametrize("layer", ["core", "io", "sim", "offline"])
def test_only_the_ros_layers_import_ros(layer: str) -> None:
    wrong = {
        f"{path.name} imports {name}" for path in modules(layer) for name in imported(path) if is_ros(name)
    }
    assert wrong == set()


def test_the_command_line_starts_without_ros() -> None:
    wrong = {
        f"{path.name} imports {name}"
        for path in modules("cli")
        for name in imported(path, lazily=False)
        if is_ros(name) or layer_of(name) in {"demo", "ros"}
    }
    assert wrong == set()


def test_every_folder_of_the_package_is_a_layer() -> None:
    assert {path.parent.name for path in PACKAGE.glob("*/__init__.py")} == set(MAY_IMPORT_LAYERS)


def test_the_core_reads_no_clock_and_has_no_global_random_state() -> None:
    clocks = {"time", "datetime", "random"}
    wrong = {
        f"{path.name} imports {name}"
        for path in modules("core")
        for name in imported(path)
        if name.split(".")[0] in clocks
    }
    assert wrong == set()


def test_no_package_is_named_like_generated_interfaces() -> None:
    assert [name for name in ("msg", "srv", "action") if (PACKAGE / name).exists()] == []


def test_files_have_at_most_five_hundred_lines() -> None:
    long = {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if len(path.read_text(encoding="utf-8").splitlines()) > 500
    }
    assert long == set()


def test_functions_fit_on_a_screen() -> None:
    long = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                assert node.end_lineno is not None
                lines = node.end_lineno - node.lineno + 1 - len((ast.get_docstring(node) or "").splitlines())
                if lines > 60:
                    long.add(f"{path.relative_to(PACKAGE)}: {node.name}, {lines} lines beside its docstring")
    assert long == set()
