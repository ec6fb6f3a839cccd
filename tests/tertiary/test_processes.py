"""Trackers in processes of their own, and a centre."""

import sys

import numpy as np
import pytest
from places import EXAMPLES

from tertia.tertiary import SystemTracks

EXAMPLE = EXAMPLES / "two_trackers_one_centre.py"


@pytest.fixture
def example(monkeypatch):
    # processes that are spawned import it by its name
    monkeypatch.syspath_prepend(EXAMPLE.parent)
    module = __import__(EXAMPLE.stem)
    yield module
    sys.modules.pop(EXAMPLE.stem, None)


def test_two_processes_and_a_centre_show_what_one_process_does(example):
    apart, together = example.of_processes(), example.of_one_process()
    assert len(apart) == len(together) == 60
    assert apart[-1].count >= 28
    assert np.any(np.all(apart[-1].members >= 0, axis=1))
    for one, other in zip(apart, together, strict=True):
        for name in SystemTracks.__slots__:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
