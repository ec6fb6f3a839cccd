"""The blocks of the page on embedding run, and print what it says."""

import re

import pytest
from places import ROOT

PAGE = ROOT / "docs" / "embedding.md"
BLOCK = re.compile(r"(<!-- not run: [^\n]*-->\n)?```python\n(.*?)```", re.DOTALL)
BLOCKS = [code for note, code in BLOCK.findall(PAGE.read_text(encoding="utf-8")) if not note]


@pytest.mark.parametrize("code", BLOCKS, ids=lambda code: code.split("\n")[0])
def test_blocks_of_the_page_run(code, tmp_path, monkeypatch, capsys):
    for library in ("dask", "pandas", "pyarrow", "sklearn", "stonesoup"):
        if re.search(rf"^(from|import) {library}\b", code, re.MULTILINE):
            pytest.importorskip(library)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(PAGE), "exec"), {})
    printed = capsys.readouterr().out
    for told in re.findall(r"^print\(.*\)  # (.*)$", code, re.MULTILINE):
        assert told in printed


def test_every_part_of_the_page_has_a_block():
    parts = PAGE.read_text(encoding="utf-8").split("\n## ")[1:]
    assert [part.split("\n")[0] for part in parts if "```python" not in part] == []
    assert len(BLOCKS) >= 6
