"""The rules of docs/architecture.md that a machine can check."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "src" / "neugrasp"
FILES = sorted(PACKAGE.rglob("*.py"))
LONGEST = 300
TABLES = {"simulation/blender_materials.py", "simulation/materials.py"}
"""Tables of materials may be longer."""

LAYERS = [
    {"errors", "progress"},
    {"output", "terminal", "bucket"},
    {"geometry", "run_folder"},
    {"observation", "grasp", "gripper", "parallel"},
    {"execution"},
    {"metrics", "pictures", "change_mask", "srgb", "kernels"},
    {"model", "simulation", "data"},
    {"detection", "training", "baselines", "doctor", "importers"},
    {"robot", "client"},
    {"evaluation"},
    {"report", "exporters", "viewer"},
    {"demo", "operation"},
    {"bench", "figures", "server", "ros"},
    {"cli"},
    {"__main__"},
]
"""Every part may import from the layers above its own, and from itself."""
NEIGHBOURS = {
    ("gripper", "grasp"),
    ("simulation", "data"),
    ("training", "detection"),
    ("baselines", "detection"),
    ("baselines", "training"),
}
"""(importer, imported) pairs within one layer. Simulation and learning meet in `data` only."""
FROM_STRANGERS = {"neugrasp.data.user_files", "neugrasp.data.strict_json", "neugrasp.data.fields"}
"""Known to every part: how files and JSON are read. They know the errors and one another, nothing else."""


def part_of(file: Path) -> str:
    """The top-level part of the package that a file belongs to."""
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


@cache
def nodes_of(file: Path) -> tuple[ast.AST, ...]:
    """All of a file, parsed once for all rules."""
    return tuple(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))


@cache
def imports(file: Path) -> tuple[str, ...]:
    """Full names of all modules that a file imports, wherever in it and also by `require`."""
    return tuple(_imports(file))


def _imports(file: Path) -> Iterator[str]:
    for node in nodes_of(file):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Call) and getattr(node.func, "id", None) == "require":
            yield from (argument.value for argument in node.args[:1] if isinstance(argument, ast.Constant))


def level(part: str) -> int:
    levels = [i for i, layer in enumerate(LAYERS) if part in layer]
    assert levels, f"{part} has no place in LAYERS"
    return levels[0]


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_imports_go_downwards(file: Path):
    if file == PACKAGE / "__init__.py":
        return
    part = part_of(file)
    for module in imports(file):
        if not module.startswith("neugrasp.") or module in FROM_STRANGERS:
            continue
        other = module.split(".")[1]
        if other == part:
            continue
        allowed = level(other) < level(part) or (part, other) in NEIGHBOURS
        assert allowed, f"{file.name} imports {module}"


@pytest.mark.parametrize("module", sorted(FROM_STRANGERS))
def test_reading_needs_the_errors_only(module: str):
    file = PACKAGE / "data" / f"{module.split('.')[-1]}.py"
    known = {name for name in imports(file) if name.startswith("neugrasp")}
    assert known - FROM_STRANGERS <= {"neugrasp.errors"}


@pytest.mark.parametrize(
    ("module", "home"),
    [
        ("pybullet", "simulation/physics.py"),
        ("bpy", "simulation/blender.py"),
        ("tyro", "cli.py"),
        ("viser", "viewer/viser_scene.py"),
        ("cv2", "importers/markers.py robot/hand_eye.py robot/opencv_camera.py"),
        ("sklearn", "figures/embedding.py"),
        ("uvicorn", "server/listening.py"),
        ("ray", "parallel/cluster.py"),
        ("fsspec", "bucket.py"),
        ("prometheus_client", "server/meters.py"),
        ("pydantic", "server/schemas.py"),
        ("httpx", "client/client.py"),
        ("fcl", "robot/collision.py"),
        ("ompl", "robot/free_way.py"),
        ("airo_models", "simulation/arm_urdf.py"),
        ("rtde_control", "robot/ur_controller.py"),
        ("rtde_receive", "robot/ur_controller.py"),
        ("pyrealsense2", "robot/realsense.py"),
    ],
)
def test_heavy_modules_have_one_home(module: str, home: str):
    users = {
        str(file.relative_to(PACKAGE))
        for file in FILES
        for name in imports(file)
        if name == module or name.startswith(module + ".")
    }
    assert users <= set(home.split())


def test_images_and_volumes_are_sampled_in_one_file():
    users = {str(file.relative_to(PACKAGE)) for file in FILES if "grid_sample(" in file.read_text()}
    assert users == {"geometry/sampling.py"}


def test_only_the_program_prints():
    for file in FILES:
        calls = [node for node in nodes_of(file) if isinstance(node, ast.Call)]
        if file.name != "cli.py":
            assert not any(getattr(call.func, "id", None) == "print" for call in calls), file


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_files_can_be_read_in_one_sitting(file: Path):
    name = str(file.relative_to(PACKAGE))
    assert name in TABLES or len(file.read_text().splitlines()) <= LONGEST


HEAVY = {"pybullet", "pybullet_data", "bpy", "trimesh", "matplotlib", "tensorboard", "tyro", "viser"}
HEAVY |= {"cv2", "sklearn", "fastapi", "pydantic", "uvicorn", "httpx", "fcl", "ompl", "airo_models", "ray"}
HEAVY |= {"rtde_control", "rtde_receive", "pyrealsense2"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("neugrasp", HEAVY),
        ("neugrasp.detection.contract", HEAVY),
        ("neugrasp.training.trainer", HEAVY - {"tensorboard"}),
        ("neugrasp.data.records", {*HEAVY, "torch"}),
        ("neugrasp.importers.import_scene", {*HEAVY, "torch"}),
        ("neugrasp.exporters.exporting", {*HEAVY, "torch"}),
        ("neugrasp.client", {*HEAVY, "torch"}),
        ("neugrasp.server.run", {*HEAVY, "torch"}),
        ("neugrasp.ros.node", {*HEAVY, "torch"}),
        ("neugrasp.simulation.generate", {"torch", "bpy", "matplotlib"}),
    ],
)
def test_importing_loads_nothing_heavy(module: str, absent: set[str]):
    code = (
        f"import sys, {module}\n"
        f"loaded = {absent!r} & set(sys.modules)\n"
        f"sys.exit('{module} loads ' + ', '.join(sorted(loaded)) if loaded else 0)"
    )
    result = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


MODES = [["r"], ["w"], ["a"]]


def is_text(call: ast.Call) -> bool:
    """Whether a call of this name reads or writes text."""
    modes = [*call.args, *(word.value for word in call.keywords if word.arg == "mode")]
    return not any(isinstance(mode, ast.Constant) and "b" in str(mode.value) for mode in modes)


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_text_is_utf_8_on_every_system(file: Path):
    """Windows takes another encoding where none is named; `Path` methods, `os.fdopen`."""
    for call in (node for node in nodes_of(file) if isinstance(node, ast.Call)):
        name = getattr(call.func, "attr", None)
        owner = getattr(getattr(call.func, "value", None), "id", "")
        wanted = name in ("write_text", "fdopen") or (name == "read_text" and len(call.args) == 0)
        # A method `open` with a mode of text, such as that of a path.
        wanted |= name == "open" and [getattr(mode, "value", None) for mode in call.args] in MODES
        if wanted and owner != "os" and is_text(call):
            assert any(word.arg == "encoding" for word in call.keywords), f"{file.name}:{call.lineno}"


EXTRAS = {"pybullet_utils", "torch.utils.tensorboard", "wandb"}
"""What functions may import: packages of an extra, each where it is needed."""
GUARDED = {"__main__.py"}
"""It imports the program where Ctrl-C in the first second is caught."""


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_nothing_is_hidden_in_functions(file: Path):
    """An import in a function hides a circle, or says that a module is in the wrong place."""
    if file.name in GUARDED:
        return
    hidden = [
        module
        for function in nodes_of(file)
        if isinstance(function, ast.FunctionDef)
        for module in _imported_in(function)
    ]
    assert [m for m in hidden if m not in EXTRAS and m.split(".")[0] not in EXTRAS] == []


def test_there_are_no_circles():
    """Types count: whoever needs another module's type needs the module."""
    names = {_name(file): file for file in FILES}
    needs = {name: {m for m in _named(file) if m in names and m != name} for name, file in names.items()}
    while free := [name for name, needed in needs.items() if not needed & needs.keys()]:
        for name in free:
            del needs[name]
    assert not needs, f"these need one another: {sorted(needs)}"


def _named(file: Path) -> Iterator[str]:
    """Modules that a file imports, also those that `from package import module` names."""
    for node in nodes_of(file):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _name(file: Path) -> str:
    parts = ("neugrasp", *file.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts).removesuffix(".__init__")


def _imported_in(function: ast.FunctionDef) -> Iterator[str]:
    for node in ast.walk(function):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
