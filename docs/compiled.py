"""For the reference: the docstrings of compiled classes, which their stub does not have."""

import importlib
import inspect
from typing import Any

import griffe


class Compiled(griffe.Extension):
    """Take the docstrings of the classes of `tertia._core` from the compiled classes."""

    def on_package(self, *, pkg: griffe.Module, **_: Any) -> None:
        """Fill in docstrings, once the package is read."""
        core = importlib.import_module(f"{pkg.name}._core")
        for name, found in pkg["_core"].classes.items():
            made = getattr(core, name, None)
            if made is None:  # what the stub imports for its annotations
                continue
            _describe(found, made)
            for member, part in found.members.items():
                _describe(part, getattr(made, member, None))


def _describe(found: Any, made: object) -> None:
    if text := inspect.getdoc(made):
        found.docstring = griffe.Docstring(text, parent=found)
