"""Every table of the pages belongs to the code that is here: a fresh run of few repetitions agrees.

`make figures` keeps the tables of few repetitions in `tests/house/tables` when it makes those of
the pages. Where they differ from a fresh run, the tables of the page are stale.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT

KEPT = Path(__file__).parent / "tables"
TABLE = re.compile(r"<!-- table: (.+?) -->\n")
NUMBER = re.compile(r"[-+−]?\d*\.?\d+(?:e[-+]?\d+)?")
# times, which no other machine repeats
MEASURED = "performance.md"
PAGES = sorted(
    path.name
    for path in (ROOT / "docs").glob("*.md")
    if path.name != MEASURED and TABLE.search(path.read_text("utf-8"))
)
# of a figure: rounding differs between machines, and a draw at a limit may fall on either side
RELATIVE, ABSOLUTE = 0.02, 1e-3


def figures(text: str) -> list[float]:
    """Return all numbers of a text."""
    return [float(number.replace("−", "-")) for number in NUMBER.findall(text)]


def differing(kept: str, fresh: str) -> list[str]:
    """Return lines of which words or figures differ."""
    if len(kept.splitlines()) != len(fresh.splitlines()):
        return ["another number of lines"]
    return [
        f"{old}\n{new}"
        for old, new in zip(kept.splitlines(), fresh.splitlines(), strict=True)
        if NUMBER.sub("#", old) != NUMBER.sub("#", new)
        or any(
            abs(a - b) > ABSOLUTE + RELATIVE * abs(a)
            for a, b in zip(figures(old), figures(new), strict=True)
        )
    ]


@pytest.fixture(scope="module")
def fresh(request: pytest.FixtureRequest) -> dict[str, str]:
    """Tables of few repetitions of the pages to be tested, all made by one process."""
    names = [item.name for item in request.session.items]
    pages = [page for page in PAGES if any(f"this_code[{page}]" in name for name in names)]
    command = [sys.executable, str(ROOT / "docs" / "figures.py"), "--small", *pages]
    made = subprocess.run(command, check=True, capture_output=True, encoding="utf-8").stdout
    _, *parts = re.split(r"^page: (.+)\n", made, flags=re.MULTILINE)
    return dict(zip(parts[::2], parts[1::2], strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_tables_are_those_of_this_code(page: str, fresh: dict[str, str]) -> None:
    kept = (KEPT / page).read_text("utf-8")
    wrong = differing(kept, fresh[page])
    assert not wrong, f"run `python docs/figures.py {page}`:\n" + "\n".join(wrong)


@pytest.mark.parametrize("page", PAGES)
def test_tables_of_a_page_are_those_that_are_kept(page: str) -> None:
    named = TABLE.findall((ROOT / "docs" / page).read_text("utf-8"))
    assert sorted(named) == sorted(
        re.findall(r"^table: (.+)$", (KEPT / page).read_text("utf-8"), re.M)
    )


def test_a_stale_figure_is_found() -> None:
    assert differing("| a | 1.00 |", "| a | 1.05 |")
    assert differing("| a | 1 |", "| b | 1 |")
    assert not differing("| a | 1.000 |", "| a | 1.001 |")
