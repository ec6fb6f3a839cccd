"""Tables into the pages, pictures beside them."""

import os
import re
from collections.abc import Iterable
from pathlib import Path

from matplotlib.figure import Figure

DOCS = Path(__file__).parents[1]
# tables of few repetitions
KEPT = DOCS.parent / "tests" / "house" / "tables"
# Okabe and Ito: distinct for colour-blind readers
BLUE, GREEN, ORANGE, PURPLE, SKY = "#0072B2", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
GREY = "#888888"
# recordings that do not belong to the project
DATA = Path(os.environ.get("TERTIA_DATA", DOCS.parents[1] / "shared" / "data"))
# of the runs of each study that are made; the tests make few, to see whether tables are stale
SHARE = float(os.environ.get("TERTIA_STUDY_SHARE", "1"))


def repetitions(full: int, least: int = 2) -> int:
    """Return how often a study repeats what it repeats so often for the pages."""
    return max(least, round(SHARE * full))


def write(page: str, name: str, text: str) -> None:
    """Put a table between its marks in a page."""
    path = DOCS / page
    marks = rf"(<!-- table: {name} -->\n).*?(<!-- end -->)"
    replaced, found = re.subn(
        marks, lambda m: f"{m[1]}{text}{m[2]}", path.read_text("utf-8"), flags=re.DOTALL
    )
    if found != 1:
        raise ValueError(f"{page} has {found} places for the table {name}, not 1")
    path.write_text(replaced, "utf-8")


def table_of(page: str, name: str) -> str:
    """Return a table as it stands in a page, or as it is kept: of a recording not at hand."""
    if SHARE < 1:
        path, marks = KEPT / page, rf"^table: {name}\n(.*?\n)(?=\n|\Z)"
    else:
        path, marks = DOCS / page, rf"<!-- table: {name} -->\n(.*?)<!-- end -->"
    found = re.search(marks, path.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    if found is None:
        raise ValueError(f"{page} has no table {name}")
    return found[1]


def markdown(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Format a table."""
    head = list(head)
    lines = [head, ["---"] * len(head), *map(list, rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def save(figure: Figure, name: str) -> None:
    """Save a picture for the pages."""
    path = DOCS / "img" / name
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=110)
