"""Put the pages of the site into build/pages, for `mkdocs build`: `make docs`.

The README is the start page. The pages of the folder are copied, and so are files that they link
to. A new page appears under 'Concepts' by itself (`tracker-plans.md` below `tracker.md`), a new
module in the reference, and a new decision below 'Decisions'.
"""

import ast
import json
import os
import re
import shutil
from pathlib import Path

DOCS = Path(__file__).parent
ROOT = DOCS.parent
BUILD = ROOT / "build"
PAGES = BUILD / "pages"
PACKAGE = ROOT / "python" / "tertia"
# pages that are not about one concept, and what they are called
START = {
    "index.md": "Start",
    "guide.md": "Guide by task",
    "coming_from.md": "Coming from other libraries",
    "vocabulary.md": "Vocabulary",
    "gallery.md": "Gallery",
}
MORE = {
    "performance.md": "Performance",
    "accuracy.md": "Accuracy",
    "honesty.md": "Coverage of the error bars",
    "papers.md": "What the papers got right",
    "complaints.md": "Complaints",
    "architecture.md": "Architecture",
    "contributing.md": "Contributing",
    "changelog.md": "Changelog",
}
FROM_ROOT = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
LINK = re.compile(r"(?<=\]\()([^)#:\s]+)(?=[)#])")


def sources() -> dict[str, Path]:
    """Find the pages: their names on the site, and where they are written."""
    pages = {page: ROOT / name for name, page in FROM_ROOT.items()}
    written = sorted(
        path for at in ("", "decisions/", "how-to/") for path in DOCS.glob(f"{at}*.md")
    )
    return pages | {path.relative_to(DOCS).as_posix(): path for path in written}


def _index_first(name: str) -> tuple[bool, str]:
    return not name.endswith("index.md"), name


def on_site(target: Path) -> str:
    """Return where on the site a file of the repository is."""
    name = target.relative_to(ROOT).as_posix()
    return FROM_ROOT.get(name, name.removeprefix("docs/"))


def page(path: Path) -> str:
    """Return the text of a page with links for the site, and copy the files that it links to."""

    def link(match: re.Match[str]) -> str:
        target = (path.parent / match[0]).resolve()
        if not target.is_file():
            return match[0]  # mkdocs reports it
        if target.suffix != ".md":
            copy = PAGES / on_site(target)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(target, copy)
        return os.path.relpath(on_site(target), Path(on_site(path)).parent).replace(os.sep, "/")

    return LINK.sub(link, path.read_text("utf-8"))


def figures() -> dict[str, tuple[str, str]]:
    """Return which function of which study makes each picture, as `figures.py` says."""
    tree = ast.parse((DOCS / "figures.py").read_text("utf-8"))
    (table,) = (
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "FIGURES"
    )
    assert isinstance(table, ast.Dict)
    made = {}
    for name, function in zip(table.keys, table.values, strict=True):
        assert isinstance(name, ast.Constant)
        study, _, called = ast.unparse(function).partition(".")
        made[str(name.value)] = study, called
    return made


def code(study: str, called: str) -> tuple[str, str]:
    """Return the first line of the docstring of a function of a study, and its code."""
    text = (DOCS / "studies" / f"{study}.py").read_text("utf-8")
    (found,) = (
        node
        for node in ast.parse(text).body
        if isinstance(node, ast.FunctionDef) and node.name == called
    )
    said = (ast.get_docstring(found) or called).splitlines()[0]
    return said, ast.get_source_segment(text, found) or ""


def gallery() -> str:
    """Write a page of all pictures, with the code that makes them and the pages that show them."""
    lines = [
        "# Gallery",
        "",
        "Every picture of these pages, with the code that makes it; `make figures` makes them all",
        "from fixed seeds. [`tertia.plot`](reference/plot.md) makes pictures of one's own data.",
    ]
    texts = {name: path.read_text("utf-8") for name, path in sources().items()}
    for name, (study, called) in figures().items():
        said, text = code(study, called)
        shown = [page for page, text in texts.items() if f"img/{name}" in text]
        places = ", ".join(f"[{heading(texts[page])}]({page})" for page in shown)
        lines += ["", f"## {said.removesuffix('.')}", "", f"![{said}](img/{name})", ""]
        lines += [f"Shown in {places}." if places else "", ""]
        lines += [f'??? example "`docs/studies/{study}.py`, `{called}`"', "", "    ```python"]
        lines += [f"    {line}".rstrip() for line in text.splitlines()]
        lines += ["    ```"]
    return "\n".join(lines) + "\n"


def modules() -> list[str]:
    """List the public modules."""
    files = [path for path in PACKAGE.glob("*.py") if path.name != "__init__.py"]
    folders = [path.parent for path in PACKAGE.glob("*/__init__.py")]
    names = [path.stem for path in files + folders]
    return sorted(name for name in names if not name.startswith("_") and name != "cli")


def compiled(name: str) -> list[str]:
    """List the names that a module takes from the compiled core unchanged."""
    files = [PACKAGE / f"{name}.py", *sorted((PACKAGE / name).glob("*.py"))]
    text = "".join(path.read_text("utf-8") for path in files if path.is_file())
    return re.findall(r"^(\w+) = _core\.\1$", text, re.M)


def reference(name: str) -> str:
    """Write the page of a module."""
    text = f"# `tertia.{name}`\n\n::: tertia.{name}\n"
    # signatures of compiled classes are in the stub, not where the texts are parsed
    options = (
        "show_root_heading: true, show_root_toc_entry: true, docstring_options: {warnings: false}"
    )
    return text + "".join(
        f"\n::: tertia._core.{thing}\n    options: {{{options}}}\n" for thing in compiled(name)
    )


def public(name: str) -> list[str]:
    """List the public names of a module."""
    path = PACKAGE / f"{name}.py"
    tree = ast.parse(
        (path if path.is_file() else PACKAGE / name / "__init__.py").read_text("utf-8")
    )
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return list(ast.literal_eval(node.value))
    return []


def listing() -> str:
    """Write a page with the public names of all modules."""
    lines = ["# Reference", "", "All public names; each page has their documentation.", ""]
    lines += ["| module | names |", "|---|---|"]
    for name in modules():
        names = ", ".join(f"`{one}`" for one in public(name))
        lines.append(f"| [`tertia.{name}`]({name}.md) | {names} |")
    return "\n".join(lines) + "\n"


def heading(text: str) -> str:
    """Return the title of a page: its first line, up to a colon."""
    return text.splitlines()[0].removeprefix("# ").partition(":")[0]


def concepts(pages: dict[str, Path]) -> list[dict[str, str | list[dict[str, str]]]]:
    """Order the pages of the concepts; `tracker-plans.md` and the like are below `tracker.md`."""
    names = [name for name in sorted(pages) if name not in START | MORE and "/" not in name]
    title = {name: heading(pages[name].read_text("utf-8")) for name in names}
    below = {
        name: [other for other in names if other.startswith(f"{name.removesuffix('.md')}-")]
        for name in names
    }
    nested = {other for others in below.values() for other in others}
    return [
        {title[name]: [{"Overview": name}, *({title[other]: other} for other in below[name])]}
        if below[name]
        else {title[name]: name}
        for name in names
        if name not in nested
    ]


def write(name: str, text: str) -> None:
    """Write a page of the site."""
    path = PAGES / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, "utf-8")


def main() -> None:
    """Write the pages, and the configuration with their order."""
    shutil.rmtree(PAGES, ignore_errors=True)
    pages = sources()
    for name, path in pages.items():
        write(name, page(path))
    write("gallery.md", gallery())
    shutil.copytree(DOCS / "img", PAGES / "img", dirs_exist_ok=True)
    shutil.copy(DOCS / "site.css", PAGES)
    write("reference/index.md", listing())
    for name in modules():
        write(f"reference/{name}.md", reference(name))
    decisions = [name for name in sorted(pages) if name.startswith("decisions/0")]
    tasks = [name for name in sorted(pages, key=_index_first) if name.startswith("how-to/")]
    nav = [
        *({title: name} for name, title in START.items()),
        {"How do I …": [{heading(pages[name].read_text("utf-8")): name} for name in tasks]},
        {"Concepts": concepts(pages)},
        {"Reference": ["reference/index.md", *(f"reference/{name}.md" for name in modules())]},
        {"More": [{title: name} for name, title in MORE.items()]},
        {"Decisions": ["decisions/index.md", *decisions]},
    ]
    base = (DOCS / "mkdocs.yml").read_text("utf-8")
    (BUILD / "mkdocs.yml").write_text(f"{base}nav: {json.dumps(nav)}\n", "utf-8")


if __name__ == "__main__":
    main()
