"""Pictures of audits."""

import numpy as np
import pytest
from checks import rng
from matplotlib.figure import Figure

from tertia import audit, plot


def test_shares_of_all_and_of_the_strata():
    error = rng(1).standard_normal((300, 2))
    found = audit(error, 1.0, strata={"part": np.repeat(["a", "b"], 150)})
    ax = plot.audit(found, ax=Figure().subplots())
    assert ax.get_title() == f"sigmas {found.verdict}"
    assert ax.get_legend_handles_labels()[1] == ["honest", "part a", "part b", "all"]
    (drawn,) = (line for line in ax.lines if line.get_label() == "part a")
    shares = [one.value for one in found.strata["part a"].coverage.values()]
    np.testing.assert_array_equal(drawn.get_ydata(), shares)


def test_another_type_is_refused():
    with pytest.raises(TypeError, match="result is 3"):
        plot.audit(3)


@pytest.mark.parametrize("size", [0.0, 50.0])
@pytest.mark.parametrize("count", [1, 40])
def test_all_or_none_inside(size, count):
    """Bounds of a share include the share, and so can be drawn."""
    error = size * rng(1).standard_normal((count, 2))
    result = audit(error, np.eye(2), probability=(0.5, 0.9))
    share = result.coverage[0.5]
    assert share.value in {0.0, 1.0}
    assert share.low <= share.value <= share.high
    plot.audit(result, ax=Figure().subplots())
