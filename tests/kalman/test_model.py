"""The model of the motion: transition and noise."""

import pickle

import numpy as np
import pytest
from checks import close
from kalman.scenes import BOTH, EXACT, PRINTED
from reference import kalman as reference

from tertia.kalman import SingerModel


class TestModel:
    STEPS = (0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.01, 0.1, 0.5, 0.9, 0.999, 1.0, 1.001, 1.5)
    STEPS += (2.0, 3.0, 5.0, 10.0, 50.0)

    @pytest.mark.parametrize("t", [1e-6, 0.7, 5.0, 1e9])
    @pytest.mark.parametrize("x", STEPS)
    def test_exact_against_van_loan(self, x, t):
        """Every element to the last digits, at any alpha T."""
        model = SingerModel(t, x / t, 0.003, exact=True)
        f, q = reference.singer(t, model.alpha, model.acceleration_sigma)
        np.testing.assert_allclose(model.transition(), f.astype(float), rtol=3e-14)
        np.testing.assert_allclose(model.process_noise(), q.astype(float), rtol=3e-14)

    @pytest.mark.parametrize("x", STEPS[:10])
    def test_as_printed(self, x):
        model = SingerModel(5.0, x / 5.0, 0.003)
        f, q = reference.printed(5.0, model.alpha, model.acceleration_sigma)
        np.testing.assert_allclose(model.transition(), f.astype(float), rtol=1e-15, atol=2e-16)
        np.testing.assert_allclose(model.process_noise(), q.astype(float), rtol=1e-15)

    def test_as_in_the_specification(self):
        model = SingerModel(4.0, 0.05, 2.0)
        np.testing.assert_array_equal(model.transition(), [[1, 4, 8], [0, 1, 4], [0, 0, 0.8]])
        np.testing.assert_allclose(model.process_noise(), np.diag([0, 0, 4 * 0.36]), rtol=1e-15)
        assert model.transition(2.0)[2, 2] == close(0.9)
        assert model.transition(0.0) == close(np.eye(3))
        assert not model.process_noise(0.0).any()

    @pytest.mark.parametrize("x", STEPS[1:])
    def test_noise_is_positive_definite(self, x):
        q = SingerModel(5.0, x / 5.0, 0.003, exact=True).process_noise()
        sigma = np.sqrt(np.diagonal(q))
        # white jerk at one end, white acceleration at the other
        assert np.linalg.eigvalsh(q / np.outer(sigma, sigma)).min() > 1e-3

    @pytest.mark.parametrize("exact", [False, True])
    def test_limits(self, exact):
        kinematic = [[1, 5, 12.5], [0, 1, 5], [0, 0, 1]]
        model = SingerModel(5.0, 0.0, 0.003, exact=exact)
        np.testing.assert_array_equal(model.transition(), kinematic)
        assert not model.process_noise().any()
        still = SingerModel(5.0, 0.05, 0.0, exact=exact)
        moving = SingerModel(5.0, 0.05, 0.003, exact=exact)
        assert not still.process_noise().any()
        np.testing.assert_array_equal(still.transition(), moving.transition())

    @pytest.mark.parametrize("alpha", [0.0, 1e-9, 0.01, 0.19, 0.21, 1.0, 5.0])
    def test_exact_steps_compose(self, alpha):
        model = SingerModel(5.0, alpha, 0.003, exact=True)
        for first, second in [(5.0, 5.0), (0.1, 9.9), (1e-6, 3.0), (2.0, 0.0)]:
            (f1, q1), (f2, q2), (f, q) = (
                (model.transition(t), model.process_noise(t))
                for t in (first, second, first + second)
            )
            np.testing.assert_allclose(f2 @ f1, f, rtol=1e-13)
            np.testing.assert_allclose(f2 @ q1 @ f2.T + q2, q, rtol=1e-13)

    def test_the_printed_model_keeps_the_variance_of_the_acceleration(self):
        for model in BOTH.values():
            f, q = model.transition(), model.process_noise()
            assert f[2, 2] ** 2 * 9e-6 + q[2, 2] == close(9e-6)

    def test_is_a_value(self):
        assert SingerModel(5, 0.05, 0.003) == PRINTED
        assert hash(SingerModel(5, 0.05, 0.003)) == hash(PRINTED)
        assert pickle.loads(pickle.dumps(EXACT)) == EXACT
        assert repr(EXACT) == (
            "SingerModel(dt=5.0, alpha=0.05, acceleration_sigma=0.003, exact=True)"
        )
        with pytest.raises(AttributeError):
            PRINTED.dt = 4.0
