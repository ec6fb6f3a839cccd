"""How many measurements it takes, against draws and quadrature."""

import bisect

import numpy as np
import pytest
from checks import rng, transposed
from weights.cases import (
    CASES,
    CONVENTIONS,
    covariances,
    exact_scalar_loss,
    losses,
    mean_and_error,
    sampled,
)

from tertia import simulate, weights


def ill_matched(sensors, m, seed):
    """Axes in any directions and of lengths from .1 to 10."""
    random = rng(seed)
    axes = np.linalg.qr(random.normal(size=(sensors, m, m)))[0]
    s = axes * 10.0 ** random.uniform(-2, 2, size=(sensors, 1, m)) @ transposed(axes)
    return (s + transposed(s)) / 2


def independent_loss(s, n, seed, trials=10_000):
    random = rng(seed)
    drawn = [simulate.wishart(covariance, n - 1, batch=trials, rng=random) for covariance in s]
    return mean_and_error(losses(s, np.stack(drawn, axis=1)))


@pytest.mark.parametrize("m", [1, 2, 3, 4])
class TestRequiredSamples:
    @pytest.mark.parametrize("bound", [0.05, 0.2])
    @pytest.mark.parametrize("sensors", [2, 3, 4])
    def test_keeps_its_promise(self, m, sensors, bound):
        for seed in range(2):
            s = ill_matched(sensors, m, seed)
            n = weights.required_samples(s, bound, trials=4000)
            mean, error = independent_loss(s, n, seed + 100)
            assert mean < bound + 3 * error

    @pytest.mark.parametrize("bound", [0.05, 0.2])
    def test_promises_no_more_than_it_must(self, m, bound):
        """With two measurements in ten fewer, the loss is above."""
        for seed in range(3):
            s = ill_matched(2, m, seed)
            n = int(0.8 * weights.required_samples(s, bound, trials=4000))
            if 2 * (n - 1) <= m + 1:
                continue
            mean, error = independent_loss(s, n, seed + 200)
            assert mean > bound - 3 * error

    def test_rule_for_two_sensors(self, m):
        """Without knowing the covariances, for a loss of 5 %."""
        n = 15 * m + 6 if m <= 3 else int(np.ceil(1 + 22 * (m + 3) ** 2 / 16))
        # to first order the worst with common axes
        worst = [np.diag([5.0 - m] + [1e-4] * (m - 1)), np.diag([3.0 + m] + [1e-8] * (m - 1))]
        cases = [ill_matched(2, m, seed) for seed in range(5)]
        for s in [*cases, worst, [np.eye(m), 3 * np.eye(m)], [np.eye(m), np.eye(m)]]:
            mean, error = independent_loss(s, n, 300)
            assert mean < 0.05 + 3 * error

    def test_rule_for_many_sensors(self, m):
        """That for two is not enough for them."""
        n = 1 + 22 * (m + 1)
        cases = [ill_matched(sensors, m, seed) for sensors in (3, 4) for seed in range(3)]
        for s in [*cases, np.stack([np.eye(m)] * 8)]:
            mean, error = independent_loss(s, n, 400)
            assert mean < 0.05 + 3 * error
        for_two = int(np.ceil(1 + 22 * (m + 3) ** 2 / 16))
        mean, error = independent_loss(np.stack([np.eye(m)] * 8), for_two, 500)
        assert mean > 0.05 + 3 * error

    def test_first_order_is_the_formula_inverted(self, m):
        s = [covariances(m, seed=m)[0]] * 2
        for bound in (0.31, 0.052, 1.3e-3, 1.1e-6):
            n = weights.required_samples(s, bound, method="first-order")
            assert n == int(np.ceil((m + 1) / (2 * bound))) + 1

    @pytest.mark.parametrize("convention", CONVENTIONS)
    def test_conventions(self, m, convention):
        s = ill_matched(2, m, 7)
        n = weights.required_samples(s, 0.1, convention=convention)
        mean, error = mean_and_error(losses(s, sampled(s, n, 10_000, 8, convention)))
        assert mean < 0.1 + 3 * error


class TestRequiredSamplesOfOthers:
    @pytest.mark.parametrize("s", [(1.0, 1.0), (1.0, 10.0), (1.0, 1e4)])
    @pytest.mark.parametrize("bound", [0.5, 0.1, 0.01])
    def test_against_the_exact_loss_of_scalars(self, s, bound):
        """Never fewer than the exact number, and 5 % more at most."""
        found = weights.required_samples(np.reshape(s, (2, 1, 1)), bound)
        exact = bisect.bisect_left(
            range(2, 1000), -bound, key=lambda n: -exact_scalar_loss(s, (n - 1, n - 1))
        )
        assert exact + 2 <= found <= 1.05 * (exact + 2) + 1

    def test_any_bound_can_be_kept(self):
        assert weights.required_samples(CASES["equal"], 1e6) == 3
        assert 1_500_000 < weights.required_samples(CASES["equal"], 1e-6, trials=1000) < 1_700_000

    def test_batches_and_seeds(self):
        s = np.stack([ill_matched(2, 2, seed) for seed in range(6)]).reshape(2, 3, 2, 2, 2)
        found = weights.required_samples(s, 0.1, trials=1000, rng=5)
        assert found.shape == (2, 3)
        assert found.dtype.kind == "i"
        for place in np.ndindex(2, 3):
            one = weights.required_samples(s[place], 0.1, trials=1000, rng=5)
            assert isinstance(one, int)
            assert one == found[place]

    def test_many_sensors_and_a_loose_bound(self):
        """The search must not try an n that leaves no weights."""
        n = weights.required_samples(np.stack([np.eye(4)] * 5), 2.0)
        assert 4 < n < 12
