"""Which tests compare with the reference in NumPy."""

from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import pytest

TESTS = f"{Path(__file__).parent}/"
REFERENCE = f"{TESTS}reference/"


def is_compared(item: pytest.Item) -> bool:
    """Whether a test uses the reference, itself or by functions of the tests."""
    if not isinstance(item, pytest.Function):
        return False
    seen: set[CodeType] = set()
    parameters = item.callspec.params.values() if hasattr(item, "callspec") else ()
    methods = (getattr(item.cls, name, None) for name in names_in(item.function))
    return any(uses(value, seen) for value in (item.function, *parameters, *methods))


def uses(value: Any, seen: set[CodeType]) -> bool:
    """Whether a value is of the reference, or is or contains a function that uses it."""
    if isinstance(value, dict):
        return any(uses(one, seen) for one in value.values())
    if isinstance(value, type):
        return uses([one for one in vars(value).values() if isinstance(one, FunctionType)], seen)
    if isinstance(value, list | tuple):
        return any(uses(one, seen) for one in value)
    function = getattr(value, "__wrapped__", value)
    if not isinstance(function, FunctionType) or function.__code__ in seen:
        return False
    code = function.__code__
    seen.add(code)
    if code.co_filename.startswith(REFERENCE):
        return True
    # functions of the library are not searched
    own = code.co_filename.startswith(TESTS)
    return own and any(uses(one, seen) for one in named(function))


def named(function: FunctionType) -> Iterator[Any]:
    """Yield what a function may use by its name, also as a part of a module."""
    names = names_in(function)
    for name in names:
        value = function.__globals__.get(name)
        if isinstance(value, ModuleType):
            if (getattr(value, "__file__", None) or "").startswith(TESTS):
                yield from (getattr(value, part, None) for part in names)
        else:
            yield value


def names_in(function: FunctionType) -> set[str]:
    """Return the names that a function reads."""
    return {name for code in codes(function.__code__) for name in code.co_names}


def codes(code: CodeType) -> Iterator[CodeType]:
    """Yield the code of a function and of those within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from codes(constant)
