"""What a public function raises stands in its description, where the reference shows it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import neugrasp
from neugrasp import errors

ROOT = Path(neugrasp.__file__).parent
PACKAGES = ("detection", "geometry", "kernels", "model", "training")
FILES = [ROOT / "metrics.py", *(file for name in PACKAGES for file in sorted((ROOT / name).rglob("*.py")))]
KINDS = {name for name, one in vars(errors).items() if isinstance(one, type)} | {"ValueError"}
MAKERS = {"refuse": "InputError"}
"""Functions that make an error for their callers to raise."""


def raised_by(function: ast.FunctionDef) -> set[str]:
    """The kinds of error that its body raises itself, or as which `told_as` tells them."""
    for decorator in function.decorator_list:
        if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "told_as":
            return {ast.unparse(decorator.args[0])}
    calls = (node.exc for node in ast.walk(function) if isinstance(node, ast.Raise) and node.exc is not None)
    names = {ast.unparse(call.func if isinstance(call, ast.Call) else call).split(".")[-1] for call in calls}
    return {MAKERS.get(name, name) for name in names} & KINDS


def unsaid(tree: ast.AST, about: str = "") -> Iterator[str]:
    """Public functions, and classes by what makes them, that raise an error which their description lacks."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from unsaid(node, ast.get_docstring(node) or "")
        if isinstance(node, ast.FunctionDef):
            makes = node.name in ("__init__", "__post_init__")
            if node.name.startswith("_") and not makes:
                continue
            told = (ast.get_docstring(node) or "") + (about if makes else "")
            yield from (
                f"{node.name} ({kind})" for kind in sorted(raised_by(node)) if f"`{kind}`" not in told
            )


def test_what_is_unsaid_is_seen():
    code = "class A:\n '''Raises `InputError`.'''\n def __init__(self): raise InputError('')\n"
    assert not list(unsaid(ast.parse(code)))
    assert list(unsaid(ast.parse("def f(x): raise x.refuse('a')"))) == ["f (InputError)"]
    assert list(unsaid(ast.parse("@told_as(DataError)\ndef f(x): return x"))) == ["f (DataError)"]


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_errors_of_public_functions_are_described(file: Path):
    assert not list(unsaid(ast.parse(file.read_text(encoding="utf-8"))))
