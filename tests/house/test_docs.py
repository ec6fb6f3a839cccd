"""The pages: what they show runs, in the order of each page, and what they name exists."""

import ast
import contextlib
import io
import re
import runpy
import shlex
import subprocess
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from places import ROOT
from typer.testing import CliRunner

from tertia import cli

_WRITTEN = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs").glob("how-to/*.md")]
PAGES = ["README.md", *sorted(str(one.relative_to(ROOT)) for one in _WRITTEN)]
BLOCK = re.compile(
    r"(?:^<!-- not run: (?P<reason>.+) -->\n)?^```(?P<language>\w+).*\n(?P<code>(?:.*\n)*?)^```$",
    re.M,
)


@dataclass
class Piece:
    """A block of Python, or one command of a block for the shell."""

    page: str
    line: int
    language: str
    code: str
    reason: str | None

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"

    @property
    def missing(self) -> str | None:
        """Why it cannot run here."""
        if self.reason:
            return self.reason
        if self.language == "python":
            for package in imported(self.code):
                if find_spec(package) is None:
                    return f"needs the package {package}"
        elif read := first_argument(self.code):
            return None if Path(read).exists() else f"there is no {read}"
        return None


def pieces() -> Iterator[Piece]:
    for page in PAGES:
        text = (ROOT / page).read_text(encoding="utf-8")
        for block in BLOCK.finditer(text):
            line = text.count("\n", 0, block.start("code")) + 1
            language, code = block["language"], block["code"]
            if language == "python":
                yield Piece(page, line, language, code, block["reason"])
            # with the lines below that it prints
            for command in re.findall(r"^tertia (?:.*\\\n)*.*$(?:\n#.*)*", code, re.M):
                offset = code[: code.index(command)].count("\n")
                joined = command.replace("\\\n", " ")
                yield Piece(page, line + offset, language, joined, block["reason"])


def imported(code: str) -> set[str]:
    """Packages that a block imports."""
    names = set()
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add((node.module or "").partition(".")[0])
    return names


def first_argument(command: str) -> str | None:
    """The file that a command reads, if it reads any: `tertia track plots.csv ...`."""
    words = shlex.split(command, comments=True)[2:]
    return words[0] if words and re.fullmatch(r"[^-].*\.\w+", words[0]) else None


@dataclass
class Session:
    """What is left of the pieces before: names and files, page by page."""

    folder: Path
    names: dict[str, Any] = field(default_factory=dict)
    done: set[int] = field(default_factory=set)

    def run(self, piece: Piece) -> None:
        self.done.add(piece.line)
        if piece.language == "python":
            self.python(piece)
        else:
            command(piece.code)

    def python(self, piece: Piece) -> None:
        tree = ast.parse(piece.code, piece.page)
        ast.increment_lineno(tree, piece.line - 1)
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile(tree, piece.page, "exec"), self.names)
        if told := promised(piece.code):
            assert [line.strip() for line in out.getvalue().splitlines()] == told


def promised(code: str) -> list[str]:
    """What a block says that it prints: comments at the end of a print, and on the lines below."""
    told, follows = [], False
    for line in code.splitlines():
        if match := re.fullmatch(r" *print\(.*?\)(?:  # (.+))?", line):
            told += [match[1]] if match[1] else []
            follows = True
        elif follows and (match := re.fullmatch(r" *# ?(.*)", line)):
            told.append(match[1].strip())
        else:
            follows = False
    return told


def printed_below(text: str) -> list[str]:
    """What a command prints among other lines: comments on the lines below it."""
    return [line.strip("# ") for line in text.splitlines()[1:] if line.startswith("#")]


def command(text: str) -> None:
    if re.search(r"[|<>$]", text):  # pipes and the like are for a shell
        path = {"PATH": f"{sysconfig.get_path('scripts')}:/usr/bin:/bin"}
        done = subprocess.run(["sh", "-c", text], env=path, capture_output=True, check=True)
        assert not done.stderr
        return
    words = shlex.split(text, comments=True)[1:]
    found = CliRunner().invoke(cli.app, words, catch_exceptions=False)
    assert found.exit_code == 0
    printed = [line.strip() for line in found.stdout.splitlines()]
    assert set(printed_below(text)) <= set(printed)
    assert re.fullmatch(r"(\d+ of \d+ measurements missing\n)?", found.stderr)
    written = [Path(word) for word in words if re.fullmatch(r"\w+\.(csv|png)", word)]
    assert all(path.stat().st_size > (1000 if path.suffix == ".png" else 200) for path in written)


ALL = list(pieces())


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Session]:
    made = {}
    for page in PAGES:
        folder = tmp_path_factory.mktemp(Path(page).stem)
        (folder / "examples").symlink_to(ROOT / "examples")
        made[page] = Session(folder)
    return made


@pytest.mark.parametrize("piece", ALL, ids=str)
def test_what_the_pages_show_runs(
    piece: Piece, sessions: dict[str, Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    session = sessions[piece.page]
    monkeypatch.chdir(session.folder)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    if missing := piece.missing:
        pytest.skip(missing)
    for before in ALL[: ALL.index(piece)]:  # left to do only if a piece is asked for alone
        if before.page == piece.page and before.line not in session.done and not before.missing:
            session.run(before)
    session.run(piece)


def test_the_pages_have_what_is_looked_for() -> None:
    count = {name: sum(piece.language == name for piece in ALL) for name in ("python", "sh")}
    assert count["python"] >= 14
    assert count["sh"] >= 10
    assert promised("print(1)  # 1\n# 2\nx = 3  # no\n# no\n") == ["1", "2"]
    assert printed_below("tertia track x.csv  # a\n#   1 track\n# b") == ["1 track", "b"]
    assert imported("import a.b\nfrom c.d import e") == {"a", "c"}
    assert first_argument("tertia track plots.csv --output x.csv") == "plots.csv"
    assert first_argument("tertia simulate --output x.csv") is None


@pytest.mark.parametrize("page", PAGES)
def test_tests_that_pages_name_exist(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    for file, name in re.findall(r"\b((?:\w+/)?test_\w+\.py)::(\w+(?:::\w+)?)", text):
        body = ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8")).body
        for part in name.split("::"):
            (found,) = (node for node in body if getattr(node, "name", "") == part)
            body = found.body
        assert part.startswith("test_")


def test_every_complaint_has_a_row_a_source_and_a_verdict() -> None:
    text = (ROOT / "docs" / "complaints.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \d+ \| .*\(#.+\) \| (.+) \| (.*) \|$", text, re.M)
    parts = re.split(r"^## ", text, flags=re.M)[1:]
    assert len(rows) == len(parts) == 15
    for (verdict, shown), part in zip(rows, parts, strict=True):
        assert re.search(r"https://github\.com/\S+/(?:issues|pull)/\d+", part), part
        assert ("test" in shown) <= ("test_" in part), part
        assert ("not yet" in verdict) == ("Not yet" in part), part


def test_every_page_is_once_in_the_navigation() -> None:
    site = runpy.run_path(str(ROOT / "docs" / "build_site.py"))
    entries = [entry for one in site["concepts"](site["sources"]()) for entry in one.items()]
    groups = {title: found for title, found in entries if isinstance(found, list)}
    listed = [found for _, found in entries if isinstance(found, str)]
    listed += [page for group in groups.values() for one in group for page in one.values()]
    written = {path.name for path in (ROOT / "docs").glob("*.md")}
    assert sorted(listed) == sorted(written - (site["START"] | site["MORE"]).keys())
    assert groups["Tracker"][0] == {"Overview": "tracker.md"}
    assert {"Tracks with flight plans": "tracker-plans.md"} in groups["Tracker"]


def test_the_gallery_has_every_picture_once() -> None:
    site = runpy.run_path(str(ROOT / "docs" / "build_site.py"))
    pictures = {path.name for path in (ROOT / "docs" / "img").glob("*.png")}
    assert set(site["figures"]()) == pictures
    text = site["gallery"]()
    assert sorted(re.findall(r"\(img/(.+?)\)", text)) == sorted(pictures)
    assert text.count("def ") >= len(pictures)
