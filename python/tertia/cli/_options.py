"""Options that several commands have."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

By: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(metavar="COLUMN", help="One estimate per value of this; may be repeated."),
]
Period: TypeAlias = Annotated[
    float, typer.Option(help="Period of the measurements; 0: they do not wrap.")
]
PlotFile: TypeAlias = Annotated[
    Path | None,
    typer.Option("--plot", metavar="FILE", help="Draw the record (.png, .svg, .pdf, ...)."),
]
