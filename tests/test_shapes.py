"""Shapes are types, in every public signature and field of what computes, and all tests check them."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from jaxtyping import TypeCheckError

import neugrasp
from neugrasp.geometry.camera import Camera
from neugrasp.model.rendering import Rays
from neugrasp.training.losses import rotation_distance
from shape_checker import PACKAGES

ROOT = Path(neugrasp.__file__).parent
KINDS = {"Bool", "Float", "Float32", "Float64", "Int", "Int8", "Int32", "Int64", "Shaped", "UInt8"}
"""Of jaxtyping, as far as they are used."""
SHAPELESS = {"Tensor", "NDArray", "Array", "ndarray"}
OF_ANY_SHAPE = {"Callable", "dict", "Mapping"}
"""Weights by their names have any shape, and what a callable takes is checked where it is made."""
EXCUSED = "neugrasp.geometry.workspace"
"""Its tensors are named and not checked: simulation uses the cube without torch."""


def modules() -> list[str]:
    """All that is checked, as module names."""
    files = [
        file
        for package in PACKAGES
        for path in [ROOT.joinpath(*package.split(".")[1:])]
        for file in (sorted(path.rglob("*.py")) if path.is_dir() else [path.with_suffix(".py")])
    ]
    return [f"neugrasp.{'.'.join(file.relative_to(ROOT).with_suffix('').parts)}" for file in files]


MODULES = [name.removesuffix(".__init__") for name in modules()]


def source(module: str) -> ast.Module:
    found = inspect.getsourcefile(importlib.import_module(module))
    assert found
    return ast.parse(Path(found).read_text(encoding="utf-8"))


def public_annotations(tree: ast.AST, within: str = "") -> Iterator[tuple[str, ast.expr]]:
    """Of public functions their parameters and results, of public classes their fields and methods."""
    for node in ast.iter_child_nodes(tree):
        name = getattr(node, "name", "")
        if name.startswith("_") and not name.startswith("__"):
            continue
        if isinstance(node, ast.ClassDef):
            yield from public_annotations(node, f"{name}.")
        elif isinstance(node, ast.AnnAssign) and within:
            yield f"{within}{ast.unparse(node.target)}", node.annotation
        elif isinstance(node, ast.FunctionDef):
            arguments = node.args
            for one in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, arguments.vararg):
                if one is not None and one.annotation is not None:
                    yield f"{within}{name}({one.arg})", one.annotation
            if node.returns is not None:
                yield f"{within}{name}", node.returns


def without_shape(annotation: ast.AST) -> bool:
    """Whether an array or a tensor stands outside of a type that names its shape."""
    if isinstance(annotation, ast.Subscript):
        kind = ast.unparse(annotation.value)
        if kind in OF_ANY_SHAPE or kind in KINDS:
            return False
    if isinstance(annotation, ast.Name | ast.Attribute):
        return ast.unparse(annotation).split(".")[-1] in SHAPELESS
    return any(
        without_shape(child) for child in ast.iter_child_nodes(annotation) if isinstance(child, ast.expr)
    )


def test_what_has_no_shape_is_seen():
    for text, bare in {
        "Tensor | None": True,
        "tuple[NDArray[np.float32], int]": True,
        'Float[Tensor, "n 3"] | None': False,
        'tuple[Bool[np.ndarray, "n"], ...]': False,
        "dict[str, Tensor]": False,
    }.items():
        assert without_shape(ast.parse(text, mode="eval").body) is bare, text


@pytest.mark.parametrize("module", MODULES)
def test_public_arrays_and_tensors_have_a_shape(module: str):
    bare = [name for name, annotation in public_annotations(source(module)) if without_shape(annotation)]
    assert not bare, f"{module}: name the shapes of {', '.join(bare)}"


@pytest.mark.parametrize("module", [name for name in MODULES if name != EXCUSED])
def test_what_shapes_are_made_of_is_there_at_run_time(module: str):
    """Else the checker would pass over them in silence."""
    names = vars(importlib.import_module(module))
    for _, annotation in public_annotations(source(module)):
        if any(kind.id in KINDS for kind in ast.walk(annotation) if isinstance(kind, ast.Name)):
            eval(ast.unparse(annotation), names)


def test_a_wrong_shape_ends_a_test():
    with pytest.raises(TypeCheckError, match="rotation_distance"):
        rotation_distance(torch.zeros(3, 4), torch.zeros(2, 4))
    with pytest.raises(TypeCheckError, match="near"):
        Rays(torch.zeros(3, 3), torch.zeros(3, 3), torch.zeros(2), torch.zeros(3))
    with pytest.raises(TypeCheckError, match="world_from_camera"):
        Camera(np.eye(3), np.eye(3), 4, 3)
