"""What all pictures share."""

import sys
from collections.abc import Callable

import numpy as np
import pytest

from tertia import fusion, plot, screening
from tertia.fusion import fuse_series
from tertia.kalman import SingerModel

Y = [12.4, 11.8, 40.0, 12.1, 12.9, 11.5, 20.0, 12.2, 12.0, 11.9]


@pytest.mark.parametrize(
    "draw",
    [
        lambda: plot.consistency([1.0]),
        lambda: plot.fused(np.eye(2), [np.eye(2)] * 2, fusion.fuse(np.eye(2), [np.eye(2)] * 2)),
        lambda: plot.fused_series([Y], fuse_series([Y], 1.0, SingerModel(1.0, 0.05, 0.01))),
        lambda: plot.screening(Y, screening.leave_one_out(Y)),
    ],
)
def test_missing_matplotlib(draw: Callable[[], object], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r"needs Matplotlib: pip install 'tertia\[plot\]'"):
        draw()


@pytest.mark.parametrize(
    ("value", "sigma", "expected"),
    [
        (358.4772, 0.3051, ("358.48", "0.31")),
        (358.4772, 0.0996, ("358.48", "0.10")),
        (358.4772, 3.051, ("358.5", "3.1")),
        (358.4772, 30.51, ("358", "31")),
        (12345.6, 456.0, ("12346", "456")),
        (0.123456, 0.00012, ("0.12346", "0.00012")),
        (10.1, 0.0, ("10.1", "0")),
    ],
)
def test_rounding_to_sigma(value: float, sigma: float, expected: tuple[str, str]) -> None:
    assert plot.rounded(value, sigma) == expected
