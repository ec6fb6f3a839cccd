"""Which tests compare with the reference in NumPy."""

from collections.abc import Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any

import pytest

REFERENCE = "reference"


def is_compared(item: pytest.Item) -> bool:
    """Whether a test uses the reference, itself or by functions of its module."""
    if not isinstance(item, pytest.Function):
        return False
    seen: set[CodeType] = set()
    parameters = item.callspec.params.values() if hasattr(item, "callspec") else ()
    return any(uses(value, seen) for value in (item.function, *parameters))


def uses(value: Any, seen: set[CodeType]) -> bool:
    """Whether a value is of the reference, or is or contains a function that uses it."""
    module = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", "")
    if str(module).split(".", maxsplit=1)[0] == REFERENCE:
        return True
    if isinstance(value, dict):
        return any(uses(one, seen) for one in value.values())
    if isinstance(value, list | tuple):
        return any(uses(one, seen) for one in value)
    function = getattr(value, "__wrapped__", value)
    if not isinstance(function, FunctionType) or function.__code__ in seen:
        return False
    seen.add(function.__code__)
    names = {name for code in codes(function.__code__) for name in code.co_names}
    used = (function.__globals__.get(name) for name in names)
    # functions of other modules, as of the library, are not searched
    return any(uses(one, seen) for one in used if is_own(one, function))


def is_own(value: Any, function: FunctionType) -> bool:
    """Whether a value is a function of the same module, something of the reference, or a list."""
    if isinstance(value, ModuleType | dict | list | tuple):
        return True
    module = str(getattr(value, "__module__", ""))
    return module == function.__module__ or module.split(".", maxsplit=1)[0] == REFERENCE


def codes(code: CodeType) -> Iterator[CodeType]:
    """Yield the code of a function and of those within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from codes(constant)
