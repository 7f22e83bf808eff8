"""The stubs have the names, parameters and defaults of the package."""

import __future__

import ast
import inspect

import pytest
from conftest import ROOT

import sharp_bench as sb

STUB = ROOT / "bench/python/sharp_bench/__init__.pyi"
TREE = ast.parse(STUB.read_text())
NAMES = {}
exec(compile(TREE, STUB, "exec", flags=__future__.annotations.compiler_flag), NAMES)
PUBLIC = [node.name for node in TREE.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))]
CLASSES = [name for name in PUBLIC if isinstance(NAMES[name], type)]
FUNCTIONS = [name for name in PUBLIC if name not in CLASSES]


def agree(stub, function):
    stated, found = (inspect.signature(one).parameters.values() for one in (stub, function))
    # `self` has no kind that matters.
    stated, found = ([p for p in all if p.name != "self"] for all in (stated, found))
    assert [(p.name, p.kind) for p in stated] == [(p.name, p.kind) for p in found]
    # A default that is computed shows as `...` on both sides.
    assert [p.default for p in stated] == [p.default for p in found]


def test_public_names():
    assert sorted(PUBLIC) == sorted(sb.__all__)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions(name):
    agree(NAMES[name], getattr(sb, name))


@pytest.mark.parametrize("name", CLASSES)
def test_classes(name):
    stub, found = vars(NAMES[name]), vars(getattr(sb, name))
    stated, there = ({member for member in one if not member.startswith("_")} for one in (stub, found))
    assert stated == there
    if {"__init__", "__new__"} & set(stub):
        agree(NAMES[name], getattr(sb, name))
    for member in stated:
        is_property = isinstance(stub[member], property)
        assert is_property == inspect.isdatadescriptor(found[member])
        if not is_property:
            agree(getattr(NAMES[name], member), getattr(getattr(sb, name), member))
