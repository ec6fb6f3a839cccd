"""For the reference: what compiled classes say of themselves, which their stub does not."""

import importlib
import inspect
from typing import Any

import griffe


class Compiled(griffe.Extension):
    """Take the texts of the classes of `tertia._core` from the classes."""

    def on_package(self, *, pkg: griffe.Module, **_: Any) -> None:
        """Fill in what is missing, once the package is read."""
        core = importlib.import_module(f"{pkg.name}._core")
        for name, found in pkg["_core"].classes.items():
            made = getattr(core, name)
            _describe(found, made)
            for member, part in found.members.items():
                _describe(part, getattr(made, member, None))


def _describe(found: Any, made: object) -> None:
    if text := inspect.getdoc(made):
        found.docstring = griffe.Docstring(text, parent=found)
