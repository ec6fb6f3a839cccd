"""Concepts import those to their left, on every floor; nothing imports in circles; files are short.

`base <- screening <- bearing <- weights <- sensors, geo <- location <- kalman <- smoothing <-
trajectory <- fusion <- association <- flightplan <- registration <- tracker <- tertiary`, and
outside `simulate, metrics <- plot, tables, io, interop <- report <- cli`. In Python `registration`
is right of the tracker, because it takes recordings, and makes tracks of them first. `geo` is
beside the sensors: it makes sensors in Python, and their plots go through it.
"""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest
from places import ROOT

CORE, BINDINGS = ROOT / "rust/tertia/src", ROOT / "rust/tertia-python/src"
PYTHON = ROOT / "python/tertia"
ORDER = [
    {"base"},
    {"screening"},
    {"bearing"},
    {"weights"},
    {"sensors", "geo"},
    {"location"},
    {"kalman"},
    {"smoothing"},
    {"trajectory"},
    {"fusion"},
    {"association"},
    {"flightplan"},
    {"registration"},
    {"tracker"},
    {"tertiary"},
    {"simulate", "metrics"},
    {"plot", "tables", "io", "interop", "asterix"},
    {"report"},
    {"cli"},
]
RANK = {name: rank for rank, names in enumerate(ORDER) for name in names}
Graph = dict[str, set[str]]


def concept(module: str) -> str:
    """The concept of a module below the root; what is private or of the root itself is the base."""
    first = module.split(".", maxsplit=1)[0]
    return first if first in RANK else "base"


def rank(module: str, floor: str) -> float:
    name = concept(module)
    if floor == "python" and name == "registration":
        return RANK["tracker"] + 0.5
    return RANK[name]


# Python


def python_modules() -> dict[str, Path]:
    names = {}
    for path in PYTHON.rglob("*.py"):
        parts = path.relative_to(PYTHON).with_suffix("").parts
        names[".".join(part for part in parts if part != "__init__")] = path
    # the root only names its modules, and starts the command line
    return {name: path for name, path in names.items() if name not in {"", "__main__"}}


def python_imports(path: Path, known: dict[str, Path]) -> set[str]:
    """Modules of the library that a file imports, wherever it does so but for types alone."""
    found = set()
    for node in without_types(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name for name in inner if name.removeprefix("tertia.") in known}
            if any(name.removeprefix("tertia.") not in known for name in inner):
                found.add(str(node.module))
    own = {name.removeprefix("tertia.") for name in found if name.startswith("tertia.")}
    return own & known.keys()


def without_types(tree: ast.AST) -> Iterator[ast.AST]:
    for node in ast.iter_child_nodes(tree):
        is_for_types = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        if not is_for_types:
            yield node
            yield from without_types(node)


def python_graph() -> Graph:
    known = python_modules()
    return {name: python_imports(path, known) - {name} for name, path in known.items()}


# Rust


def rust_modules(top: Path) -> dict[str, Path]:
    paths = {path: path.relative_to(top).with_suffix("").parts for path in top.rglob("*.rs")}
    return {".".join(parts): path for path, parts in paths.items() if parts != ("lib",)}


def rust_code(path: Path) -> str:
    """A file without its comments, its tests, and the paths that say who may use an item."""
    text = re.split(
        r"^#\[cfg\(test\)\]\n(?:pub\S* )?mod tests", path.read_text("utf-8"), flags=re.M
    )
    return re.sub(r"//.*|\bpub\(in [\w:]+\)", "", text[0])


def leaves(tree: str) -> Iterator[str]:
    """Paths of a `use`: `a::{b, c::{d, e}}` is a::b, a::c::d, a::c::e."""
    head, brace, rest = tree.partition("{")
    if not brace:
        yield tree.split(" as ", maxsplit=1)[0].strip()
        return
    depth, part = 0, ""
    for letter in rest[: rest.rindex("}")] + ",":
        depth += (letter == "{") - (letter == "}")
        if letter == "," and depth == 0:
            if part.strip():
                yield from (f"{head.strip()}{leaf}" for leaf in leaves(part.strip()))
            part = ""
        else:
            part += letter


def rust_graph(top: Path) -> Graph:
    """Edges from a module to those whose items it names; a re-export leads to where the item is."""
    known = rust_modules(top)
    uses: dict[str, list[str]] = {}
    exports: dict[str, dict[str, str]] = defaultdict(dict)
    for name, path in known.items():
        code = rust_code(path)
        trees = re.findall(r"^\s*((?:pub(?:\([^)]*\))? )?)use ([^;]+);", code, flags=re.M)
        uses[name] = []
        for public, tree in trees:
            for leaf in leaves(tree):
                target = absolute(leaf, name, known)
                if target and public:
                    exports[name][target.rsplit(".", 1)[-1]] = target
                elif target:
                    uses[name].append(target)
        body = re.sub(r"^\s*(?:pub(?:\([^)]*\))? )?use [^;]+;", "", code, flags=re.M)
        for leaf in re.findall(r"\b(?:crate|super|self)(?:::\w+)+|\b[a-z_]\w*(?:::\w+)+", body):
            target = absolute(leaf, name, known)
            if target:
                uses[name].append(target)
    return {
        name: {resolve(target, known, exports) for target in targets} - {name}
        for name, targets in uses.items()
    }


def absolute(leaf: str, module: str, known: dict[str, Path]) -> str | None:
    """A path from the root of the crate, None if it leads out of it."""
    parts, here = leaf.split("::"), module.split(".")
    if parts[0] == "crate":
        return ".".join(parts[1:]) or None
    if parts[0] in {"super", "self"}:
        here = here[:-1] if parts[0] == "super" else here
        while parts[1:] and parts[1] == "super":
            parts, here = parts[1:], here[:-1]
        return ".".join([*here, *parts[1:]])
    inner = ".".join([*here, *parts])
    return inner if f"{module}.{parts[0]}" in known else None


def resolve(target: str, known: dict[str, Path], exports: dict[str, dict[str, str]]) -> str:
    """The module in which an item is."""
    parts = target.split(".")
    for end in range(len(parts), 0, -1):
        module = ".".join(parts[:end])
        if module in known:
            item = parts[end] if end < len(parts) else None
            if item in exports[module] and exports[module][item] != target:
                return resolve(exports[module][item], known, exports)
            return module
    return "base"


def binding_graph() -> Graph:
    """As the core's, and the concepts of the core that a file names."""
    graph = rust_graph(BINDINGS)
    for name, path in rust_modules(BINDINGS).items():
        code = rust_code(path)
        trees = [
            leaf for tree in re.findall(r"use (tertia::[^;]+);", code) for leaf in leaves(tree)
        ]
        named = [*trees, *re.findall(r"\btertia(?:::\w+)+", code)]
        graph[name] |= {path.split("::")[1] for path in named if "::" in path}
    return graph


GRAPHS = {"python": python_graph, "core": lambda: rust_graph(CORE), "bindings": binding_graph}


@pytest.mark.parametrize("floor", GRAPHS)
def test_concepts_import_those_to_their_left(floor):
    wrong = [
        f"{name} imports {target}"
        for name, targets in GRAPHS[floor]().items()
        for target in targets
        if rank(target, floor) > rank(name, floor)
    ]
    assert sorted(wrong) == []


@pytest.mark.parametrize("floor", GRAPHS)
def test_no_modules_import_each_other_in_circles(floor):
    graph = rust_graph(BINDINGS) if floor == "bindings" else GRAPHS[floor]()
    assert circles(graph) == []


def test_no_parts_of_a_concept_import_each_other_in_circles():
    """Parts are folders such as `tracker/motion`, with the file of the same name beside."""
    graph: Graph = defaultdict(set)
    for name, targets in rust_graph(CORE).items():
        if not name.endswith(".tests"):
            graph[part(name)] |= {part(target) for target in targets} - {part(name)}
    assert circles(graph) == []


@pytest.mark.parametrize("concept", ["location", "trajectory", "tracker"])
def test_parts_of_a_concept_stand_in_the_order_that_its_file_tells(concept):
    told = re.findall(
        r"^//! \| `(\w+)` \|", (CORE / f"{concept}.rs").read_text("utf-8"), flags=re.M
    )
    modules = rust_modules(CORE)
    assert sorted(told) == sorted(
        name.split(".")[1]
        for name in modules
        if name.startswith(f"{concept}.") and name.count(".") == 1
    )
    place = {f"{concept}.{name}": i for i, name in enumerate(told)}
    wrong = [
        f"{name} uses {target}"
        for name, targets in rust_graph(CORE).items()
        for target in targets
        if not name.endswith(".tests")
        and place.get(part(target), 0) > place.get(part(name), len(told))
    ]
    assert wrong == []


def part(module: str) -> str:
    return ".".join(module.split(".")[:2])


def circles(graph: Graph) -> list[list[str]]:
    """Sets of modules each of which can be reached from all others of its set."""
    reached: Graph = {}
    for name in graph:
        seen, open_ = set(), [name]
        while open_:
            for target in graph.get(open_.pop(), set()) - seen:
                seen.add(target)
                open_.append(target)
        reached[name] = seen
    sets = {frozenset(b for b in reached[a] if a in reached.get(b, ())) for a in graph}
    return sorted(sorted(one) for one in sets if one)


@pytest.mark.parametrize(
    ("top", "suffix", "most"), [(PYTHON, "py", 600), (CORE, "rs", 500), (BINDINGS, "rs", 500)]
)
def test_files_are_short(top, suffix, most):
    lengths = {
        path.relative_to(top).as_posix(): len(path.read_text("utf-8").splitlines())
        for path in top.rglob(f"*.{suffix}")
    }
    assert lengths
    assert {name: length for name, length in lengths.items() if length > most} == {}


def test_the_checks_see_what_they_look_for():
    assert list(leaves("a::{b, c::{d, self as e}}")) == ["a::b", "a::c::d", "a::c::self"]
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"d"}}) == [["b", "c"], ["d"]]
    graph = rust_graph(CORE)
    assert "base.moments" in graph["screening.others"]
    assert "screening.leave_one_out" in graph["bearing.rules"]
    assert "_arrays" in python_graph()["bearing"]
