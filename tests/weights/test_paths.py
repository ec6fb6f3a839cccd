"""What holds for every function of covariances: batches, layouts, threads."""

import numpy as np
import pytest
from checks import assert_near, rng
from reference import weights as reference
from weights.cases import covariances

from tertia import fusion, weights


def estimates_for(s):
    """Some estimates for covariances of this shape."""
    return rng(9).normal(size=np.shape(s)[-3:-1])


GROUPS = {
    "weight_matrices": (weights.weight_matrices, reference.weights),
    "fused_covariance": (weights.fused_covariance, reference.fused_covariance),
    "combined value": (
        lambda s, **kw: fusion.fuse(estimates_for(s), s, **kw).mean,
        lambda s: reference.combine(estimates_for(s), s)[0],
    ),
    "combined covariance": (
        lambda s, **kw: fusion.fuse(estimates_for(s), s, **kw).covariance,
        reference.fused_covariance,
    ),
    "combined weights": (
        lambda s, **kw: fusion.fuse(estimates_for(s), s, **kw).weights,
        reference.weights,
    ),
    "combined statistic": (
        lambda s, **kw: np.asarray(fusion.fuse(estimates_for(s), s, **kw).statistic),
        lambda s: reference.combine(estimates_for(s), s)[2],
    ),
    "jacobian": (weights.jacobian, lambda s: reference.jacobian(s, len(s) - 1)),
    "jacobian of the first": (
        lambda s, **kw: weights.jacobian(s, 0, **kw),
        lambda s: reference.jacobian(s, 0),
    ),
    "left factors": (
        lambda s, **kw: weights.jacobian_operator(s, 0, **kw).left,
        reference.weights,
    ),
    "right factors": (
        lambda s, **kw: weights.jacobian_operator(s, 0, **kw).right,
        lambda s: np.array(
            [
                np.linalg.inv(s[j]) @ (reference.weights(s)[0] - np.eye(len(s[0])) * (j == 0))
                for j in range(len(s))
            ]
        ),
    ),
    "weight_covariance": (
        lambda s, **kw: weights.weight_covariance(s, 31, **kw),
        lambda s: reference.weight_covariance(s, [1 / 30] * len(s), len(s) - 1),
    ),
    "weight_bias": (
        lambda s, **kw: weights.weight_bias(s, 31, 0, **kw),
        lambda s: reference.bias(s, [1 / 30] * len(s), 0),
    ),
    "first-order error": (
        lambda s, **kw: weights.fusion_loss(s, 31, method="first-order", **kw).mean_squared_error,
        lambda s: reference.mean_squared_error(s, [1 / 30] * len(s)),
    ),
    "simulated error": (
        lambda s, **kw: (
            weights.fusion_loss(s, 31, method="monte-carlo", trials=50, **kw).mean_squared_error
        ),
        None,
    ),
    "simulated loss": (
        lambda s, **kw: np.asarray(
            weights.fusion_loss(s, 31, method="monte-carlo", trials=50, **kw).loss
        ),
        None,
    ),
    "standard error": (
        lambda s, **kw: np.asarray(
            weights.fusion_loss(s, 31, method="monte-carlo", trials=50, **kw).loss_sigma
        ),
        None,
    ),
    "required_samples": (
        lambda s, **kw: np.asarray(weights.required_samples(s, 0.5, trials=50, **kw)),
        None,
    ),
}


def scalar_for(s):
    """Some estimate, derivatives, measurement and sigma for a covariance of this shape."""
    x, h = rng(8).normal(size=(2, np.shape(s)[-1]))
    return x, h, 0.3, 0.7


def added(s, **kw):
    x, h, z, sigma = scalar_for(s)
    return fusion.fuse_scalar(x, s, h, z, sigma, **kw)


def added_by_inversion(s):
    x, h, z, sigma = scalar_for(s)
    return reference.combine_scalar(x, s, h, z, sigma)


SINGLE = {
    "covariance_of_covariance": (
        lambda s, **kw: weights.covariance_of_covariance(s, 0.2, **kw),
        lambda s: reference.elements_of_covariance_of_covariance(s, 0.2),
    ),
    "value with a scalar": (
        lambda s, **kw: added(s, **kw).mean,
        lambda s: added_by_inversion(s)[0],
    ),
    "covariance with a scalar": (
        lambda s, **kw: added(s, **kw).covariance,
        lambda s: added_by_inversion(s)[1],
    ),
    "gain of a scalar": (
        lambda s, **kw: added(s, **kw).weights,
        lambda s: added_by_inversion(s)[1] @ scalar_for(s)[1] / 0.7**2,
    ),
    "statistic of a scalar": (
        lambda s, **kw: np.asarray(added(s, **kw).statistic),
        lambda s: added_by_inversion(s)[2],
    ),
}
PATHS = {**GROUPS, **SINGLE}
AGREEING = [name for name in PATHS if PATHS[name][1]]


def argument(name, m=3, seed=0, batch=()):
    s = covariances(m, 3, seed, batch)
    return s[..., 0, :, :].copy() if name in SINGLE else s


@pytest.mark.parametrize("name", PATHS)
class TestEveryPath:
    @pytest.mark.parametrize("m", [2, 3, 11])
    @pytest.mark.parametrize("batch", [(1,), (4,), (2, 3)])
    def test_a_batch_is_its_elements(self, name, m, batch):
        function = PATHS[name][0]
        s = argument(name, m, 1, batch)
        whole = function(s)
        for place in np.ndindex(batch):
            np.testing.assert_array_equal(whole[place], function(s[place]))

    def test_no_batch_at_all(self, name):
        function = PATHS[name][0]
        one, none = argument(name), argument(name, batch=(0, 2))
        assert function(none).shape == (0, 2, *function(one).shape)

    def test_threads_do_not_change_a_bit(self, name):
        function = PATHS[name][0]
        s = argument(name, seed=5, batch=(150,))
        alone = function(s, n_threads=1)
        for n_threads in (2, 5, None):
            np.testing.assert_array_equal(function(s, n_threads=n_threads), alone)

    def test_threads_report_the_first_bad_element(self, name):
        s = argument(name, seed=6, batch=(150,))
        s[[70, 120], ..., 0, 1] = s[[70, 120], ..., 1, 0] = 1e3
        for n_threads in (1, 4):
            with pytest.raises(np.linalg.LinAlgError, match=r"covariances?\[70.*indefinite|\[70\]"):
                PATHS[name][0](s, n_threads=n_threads)


@pytest.mark.parametrize(
    ("name", "m"),
    # the reference of the bias takes m² Jacobians of order m²
    [(name, m) for name in AGREEING for m in (1, 2, 3, 4, 5, 7, 11) if m < 7 or "bias" not in name],
)
def test_every_path_agrees_with_the_reference(name, m):
    function, formula = PATHS[name]
    s = argument(name, m, seed=10 + m, batch=(2,))
    found = function(s)
    for place in range(2):
        assert_near(found[place], formula(s[place]))
