"""Pictures of fused estimates: every ellipse is that of its covariance."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import scipy.stats
from matplotlib import pyplot as plt
from pictures import labels, line

from tertia import fusion, plot

X = [[10.0, 20.0, 5.0], [13.0, 21.0, 4.0]]
S = [
    [[4.0, 1.0, 0.5], [1.0, 2.0, 0.0], [0.5, 0.0, 1.0]],
    [[1.0, -0.5, 0.0], [-0.5, 3.0, 1.0], [0.0, 1.0, 2.0]],
]


@pytest.mark.parametrize("components", [(0, 1), (2, 0), [1, 2]])
@pytest.mark.parametrize("probability", [0.5, 0.95])
def test_fused(components: Sequence[int], probability: float) -> None:
    result = fusion.fuse(X, S)
    ax = plot.fused(X, S, result, components=components, probability=probability)
    quantile = scipy.stats.chi2.ppf(probability, 2)
    drawn = [("estimate 0", X[0], S[0]), ("estimate 1", X[1], S[1])]
    pair = list(components)
    for label, centre, covariance in [*drawn, ("fused", result.mean, result.covariance)]:
        points = line(ax, label)
        expected = np.asarray(centre)[pair]
        assert points[0].tolist() == expected.tolist()
        assert np.isnan(points[1]).all()
        off = points[2:] - expected
        inverse = np.linalg.inv(np.asarray(covariance)[np.ix_(pair, pair)])
        np.testing.assert_allclose((off @ inverse * off).sum(axis=1), quantile, rtol=1e-12)
        # all the way round
        np.testing.assert_allclose(points[2], points[-1], rtol=1e-12)
        np.testing.assert_allclose(points[2:-1].mean(axis=0), expected, rtol=1e-12)
    assert (ax.get_xlabel(), ax.get_ylabel()) == (f"component {pair[0]}", f"component {pair[1]}")
    assert labels(ax) == ["estimate 0", "estimate 1", "fused"]
    widths = [a.get_linewidth() for a in ax.get_lines()]
    assert widths[-1] > max(widths[:-1])


def test_fused_title_aspect_and_legend() -> None:
    result = fusion.fuse(X, S)
    ax = plot.fused(X, S, result, probability=0.6827)
    assert ax.get_title() == "12.49 ± 0.85, 21.1 ± 1.0; p-value 0.45"
    legend = ax.get_legend()
    assert legend is not None
    assert legend.get_title().get_text() == "68.27 % ellipses"
    assert ax.get_aspect() == 1.0
    _, given = plt.subplots()
    assert plot.fused(X, S, result, equal=False, legend=False, ax=given) is given
    assert (given.get_aspect(), given.get_legend()) == ("auto", None)
    assert len(plt.get_fignums()) == 2
    ax.figure.canvas.draw()


def test_fused_of_many_estimates() -> None:
    six, seven = np.tile(S[0], (6, 1, 1)), np.tile(S[0], (7, 1, 1))
    x = np.arange(21.0).reshape(7, 3)
    ax = plot.fused(x[:6], six, fusion.fuse(x[:6], six))
    assert labels(ax) == [*(f"estimate {k}" for k in range(6)), "fused"]
    looks = [(a.get_color(), a.get_marker()) for a in ax.get_lines()]
    assert len({c for c, _ in looks}) == len({m for _, m in looks}) == 7
    ax = plot.fused(x, seven, fusion.fuse(x, seven))
    assert labels(ax) == ["estimate", "fused"]
    assert len(ax.get_lines()) == 8


def test_fused_with_a_scalar() -> None:
    result = fusion.fuse_scalar([3, 4], np.eye(2), [0.6, 0.8], 5.2, 0.1)
    ax = plot.fused([[3, 4]], [np.eye(2)], result)
    assert labels(ax) == ["estimate 0", "fused"]
    assert ax.get_title() == "3.12 ± 0.80, 4.16 ± 0.61; p-value 0.84"


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_fused_of_components_of_different_size(scale: float) -> None:
    units = np.array([1.0, scale, 1.0])
    x, s = X * units, S * np.outer(units, units)
    ax = plot.fused(x, s, fusion.fuse(x, s), equal=False)
    plain = plot.fused(X, S, fusion.fuse(X, S))
    for label in labels(ax):
        expected = line(plain, label) * units[:2]
        np.testing.assert_allclose(line(ax, label), expected, rtol=1e-12)


def test_fused_of_singular_covariances() -> None:
    crossed = np.array([[[4.0, 4.0], [4.0, 4.0]], [[1.0, -1.0], [-1.0, 1.0]]])
    result = fusion.FusedEstimate(np.zeros(2), np.eye(2), crossed, 0.0, "given", 0.0, 2, 1.0)
    points = line(plot.fused(np.zeros((2, 2)), crossed, result), "estimate 0")[2:]
    # a line
    np.testing.assert_allclose(points[:, 0], points[:, 1], rtol=1e-12)
    np.testing.assert_allclose(points.max(), 2 * np.sqrt(-2 * np.log(0.05)), rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (
            {"estimates": [X, X]},
            ValueError,
            r"estimates has shape \(2, 2, 3\), but result has 3 components; \(K, 3\) can be drawn",
        ),
        ({"estimates": np.empty((0, 3))}, ValueError, r"estimates has shape \(0, 3\)"),
        ({"estimates": [[1, 2], [3, 4]]}, ValueError, r"estimates has shape \(2, 2\)"),
        (
            {"covariances": S[0]},
            ValueError,
            r"covariances has shape \(3, 3\); for estimates of shape \(2, 3\) it must be \(2, 3",
        ),
        (
            {"result": fusion.fuse([X], [S])},
            ValueError,
            r"result has a batch of shape \(1,\); only one estimate can be drawn",
        ),
        ({"components": (0, 3)}, ValueError, r"components\[1\] is 3; result has 3 components"),
        ({"components": (-1, 0)}, ValueError, r"components\[0\] is -1; it must be between 0"),
        ({"components": (1, 1)}, ValueError, "components are both 1; they must be distinct"),
        ({"components": (0, 1, 2)}, ValueError, "components is .*; it must be two numbers"),
        ({"components": 1}, ValueError, "components is 1; it must be two numbers"),
        ({"components": (0, 1.5)}, TypeError, r"components\[1\] is 1.5"),
        ({"probability": 1.0}, ValueError, "probability is 1.0; it must be between 0 and 1"),
        ({"probability": float("nan")}, ValueError, "probability is nan"),
        ({"probability": "high"}, TypeError, "probability"),
        ({"equal": "no"}, TypeError, "equal is 'no'"),
        ({"estimates": [[np.nan, 1, 2], X[1]]}, ValueError, r"estimates\[0, 0\] is nan"),
        (
            {"covariances": [S[0], np.diag([1.0, -1.0, 1.0])]},
            ValueError,
            r"covariances\[1\] has a variance that is not positive in the components drawn",
        ),
        (
            {"covariances": [np.eye(3) + 2 * np.eye(3)[::-1], S[1]], "components": (0, 2)},
            ValueError,
            r"covariances\[0\] is indefinite in the components drawn",
        ),
    ],
)
def test_errors_of_fused(arguments: dict[str, Any], error: type[Exception], message: str) -> None:
    right: dict[str, Any] = {"estimates": X, "covariances": S, "result": fusion.fuse(X, S)}
    with pytest.raises(error, match=message):
        plot.fused(**(right | arguments))
    assert not plt.get_fignums()
