"""Public names are on a page, and the vocabulary has no name that is not in the code."""

import importlib
import inspect
import pkgutil
import re
import runpy

import pytest
from places import ROOT

import tertia

PAGES = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md"))
VOCABULARY = (ROOT / "docs" / "vocabulary.md").read_text(encoding="utf-8")
SOURCES = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "python").rglob("*.py*"))
MODULES = sorted(
    one.name for one in pkgutil.iter_modules(tertia.__path__) if not one.name.startswith("_")
)


@pytest.mark.parametrize("name", [name for name in MODULES if name not in ("cli", "interop")])
def test_public_names_are_listed_and_functions_on_a_page(name: str) -> None:
    module = importlib.import_module(f"tertia.{name}")
    site = runpy.run_path(str(ROOT / "docs" / "build_site.py"))
    (row,) = (line for line in site["listing"]().splitlines() if f"({name}.md)" in line)
    assert re.findall(r"`(\w+)`", row) == module.__all__
    functions = [one for one in module.__all__ if inspect.isroutine(getattr(module, one))]
    assert [one for one in functions if not re.search(rf"\b{one}\b", PAGES)] == []


def test_what_the_vocabulary_names_is_in_the_code() -> None:
    tables = "\n".join(line for line in VOCABULARY.splitlines() if line.startswith("| `"))
    terms = {term for row in tables.splitlines() for term in re.findall(r"`(\w+[^\W_])`", row)}
    assert len(terms) > 50
    assert sorted(term for term in terms if not re.search(rf"\b{term}\b", SOURCES)) == []


def test_the_vocabulary_has_each_term_once() -> None:
    rows = re.findall(r"^\| (`[^|]*?) \|", VOCABULARY, flags=re.MULTILINE)
    terms = [term for row in rows for term in row.split(", ")]
    assert len(terms) > 50
    assert sorted(term for term in set(terms) if terms.count(term) > 1) == []


def test_no_page_speaks_a_name_that_was_given_up() -> None:
    given_up = "TrackFusion|FusionResult|TrackSmooth|PolynomialSmooth|known_sigma|plan_prior"
    pages = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md"]
    texts = {path.name: path.read_text(encoding="utf-8") for path in pages}
    found = {name: re.findall(rf"\b({given_up})\b", text) for name, text in texts.items()}
    assert {name: words for name, words in found.items() if words} == {}
