"""What counts instructions: kernels and what is recorded of them."""

import re

import pytest
from places import ROOT

EXAMPLE, RECORDED = (ROOT / "benches" / f"instructions.{kind}" for kind in ("rs", "txt"))


@pytest.mark.skipif(not EXAMPLE.exists(), reason="the sources are not there")
def test_every_kernel_has_a_count() -> None:
    listed = re.findall(r'^    \("([\w ]+)", ', EXAMPLE.read_text(encoding="utf-8"), re.MULTILINE)
    lines = RECORDED.read_text(encoding="utf-8").splitlines()
    assert [line.rsplit(maxsplit=1)[0] for line in lines] == listed
    assert len(listed) == 12
    assert all(int(line.split()[-1].replace(",", "")) > 100_000 for line in lines)
