"""GOSPA versus its definition, and by hand."""

import itertools

import numpy as np
import pytest
from checks import INF, NAN, rng
from scipy import optimize
from scipy.spatial.distance import cdist

from tertia.metrics import gospa


def by_definition(x, y, c, p, alpha):
    """GOSPA, trying every way to pair the smaller set."""
    if len(x) > len(y):
        x, y = y, x
    cut = np.minimum(cdist(x, y), c) if len(x) else np.empty((0, len(y)))
    best = min(
        sum(cut[i, j] ** p for i, j in enumerate(order))
        for order in itertools.permutations(range(len(y)), len(x))
    )
    return (best + c**p / alpha * (len(y) - len(x))) ** (1 / p)


class TestGospa:
    @pytest.mark.parametrize(("n", "m"), [(0, 0), (0, 3), (3, 0), (1, 1), (3, 3), (2, 5), (5, 2)])
    @pytest.mark.parametrize("p", [1, 2, 3.5])
    @pytest.mark.parametrize("alpha", [0.5, 1, 2])
    def test_against_the_definition(self, n, m, p, alpha):
        for seed in range(5):
            generator = rng(3, n, m, seed)
            dimensions = 2 + seed % 2
            x = generator.uniform(0, 20, (n, dimensions))
            y = generator.uniform(0, 20, (m, dimensions))
            found = gospa(x, y, 9.0, p, alpha)
            assert found.distance == pytest.approx(by_definition(x, y, 9.0, p, alpha))
            parts = found.localisation + found.missed + found.false
            assert found.distance == pytest.approx(parts ** (1 / p))

    def test_parts_by_hand(self):
        """As Stone Soup: 3 and 4 metres off, one missed, two false; half of 10² each."""
        truth = [[0, 0], [100, 0], [200, 0]]
        found = gospa([[3, 0], [100, 4], [300, 0], [400, 0]], truth, 10)
        assert found.localisation == pytest.approx(25)
        assert found.missed == pytest.approx(50)
        assert found.false == pytest.approx(100)
        assert found.distance == pytest.approx(np.sqrt(175))
        assert repr(found) == "Gospa(13.2288: localisation 25, missed 50, false 100)"

    def test_as_many_thousands_against_scipy(self):
        generator = rng(4)
        y = generator.uniform(0, 1e5, (1500, 2))
        x = y[:1400] + generator.normal(0, 400, (1400, 2))
        found = gospa(x, y, 1000.0)
        cost = np.minimum(cdist(x, y), 1000.0) ** 2
        least = cost[optimize.linear_sum_assignment(cost)].sum() + 100 * 1000.0**2 / 2
        assert found.distance == pytest.approx(np.sqrt(least), rel=1e-12)

    @pytest.mark.parametrize("unit", [1e-100, 1e100])
    def test_in_any_unit(self, unit):
        x, y = rng(5).uniform(0, 9, (2, 6, 2))
        assert gospa(unit * x, unit * y, 4 * unit, 1.5).distance == pytest.approx(
            unit * gospa(x, y, 4, 1.5).distance
        )

    def test_is_a_metric(self):
        generator = rng(6)
        for _ in range(200):
            x, y, z = (generator.uniform(0, 10, (generator.integers(0, 5), 2)) for _ in range(3))
            a, b, c = (gospa(*pair, 4).distance for pair in ((x, y), (y, z), (x, z)))
            assert c <= a + b + 1e-12
            assert a == pytest.approx(gospa(y, x, 4).distance)
        assert gospa(x, x, 4).distance == 0

    @pytest.mark.parametrize(
        ("arguments", "kind", "message"),
        [
            (([1, 2], [[1, 2]], 1), ValueError, r"estimates has shape \(2,\)"),
            (([[1, 2]], [[1]], 1), ValueError, r"truth has shape \(1, 1\)"),
            (([[1, 2]], [[1, 2, 3]], 1), ValueError, r"and truth \(1, 3\)"),
            (([[1, NAN]], [[1, 2]], 1), ValueError, r"estimates\[0, 1\] is nan"),
            (([[1, 2]], [[1, 2]], 0), ValueError, "cutoff is 0"),
            (([[1, 2]], [[1, 2]], INF), ValueError, "cutoff is inf"),
            (([[1, 2]], [[1, 2]], 1, 0.5), ValueError, "p is 0.5"),
            (([[1, 2]], [[1, 2]], 1, NAN), ValueError, "p is nan"),
            (([[1, 2]], [[1, 2]], 1, 2, 0), ValueError, "alpha is 0"),
            (([[1, 2]], [[1, 2]], 1, 2, 2.1), ValueError, "alpha is 2.1"),
            (([[1, 2]], [[1, 2]], "x"), TypeError, "cutoff is 'x'"),
        ],
    )
    def test_errors(self, arguments, kind, message):
        with pytest.raises(kind, match=message):
            gospa(*arguments)
