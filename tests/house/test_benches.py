"""What benches leave in the repository: counts of instructions, and places for tables."""

import re

import pytest
from places import ROOT

BENCHES = ROOT / "benches"
pytestmark = pytest.mark.skipif(not BENCHES.exists(), reason="the sources are not there")


def test_every_kernel_has_a_count() -> None:
    example = (BENCHES / "instructions.rs").read_text(encoding="utf-8")
    listed = re.findall(r'^    \("([\w ]+)", ', example, re.MULTILINE)
    lines = (BENCHES / "instructions.txt").read_text(encoding="utf-8").splitlines()
    assert [line.rsplit(maxsplit=1)[0] for line in lines] == listed
    assert len(listed) == 17
    assert all(int(line.split()[-1].replace(",", "")) > 100_000 for line in lines)


def test_every_table_of_the_run_has_a_place() -> None:
    script = (BENCHES / "performance.py").read_text(encoding="utf-8")
    for name, path in (("PAGE", "docs/performance.md"), ("FRONT", "README.md")):
        tables = re.findall(rf'^    \({name}, "(\w+)"\): \w+,$', script, re.MULTILINE)
        page = (ROOT / path).read_text(encoding="utf-8")
        assert tables == re.findall(r"<!-- table: (.+) -->", page)
        assert len(tables) == page.count("<!-- end -->") > 0
