"""The source's filter: vectors of exact rational arithmetic, and what each misprint would do."""

import numpy as np
import pytest
from checks import NAN, close
from kalman.scenes import PRINTED, R, plots
from reference import kalman as reference

from tertia.kalman import AngleFilter, SingerModel, filter_series, smooth_series, steady_state


class TestVectors:
    """V1 and V2 of exact rational arithmetic: T = 4, alpha = 1/20, D = 4e-6."""

    MODEL = SingerModel(4.0, 0.05, np.sqrt(4e-6 / 0.36).item())
    MEAN = (10.0, 0.5, 0.01)
    COVARIANCE = ((0.01, 0.002, 0.0001), (0.002, 0.0025, 0.0002), (0.0001, 0.0002, 0.0001))
    UPDATED = (12.0979338842975, 0.544214876033058, 0.00828099173553719)
    UPDATED_UPPER = (
        0.00896694214876033,
        0.00210743801652893,
        0.000140495867768595,
        0.00140082644628099,
        0.000193388429752066,
        4.88925619834711e-05,
    )
    Z1 = (NAN, 10.41, 10.77, 11.25, 11.60, 12.05)
    Z2 = (NAN, 10.30, 10.95, 11.10, NAN, 12.30)
    X1 = (12.0446279972368, 0.105582735705442, 0.000216216126618942)
    X2 = (12.2592271936905, 0.13674248490462, 0.00168603541404649)

    def test_one_step_of_a_series(self):
        z, start = [NAN, 12.1], (self.MEAN, self.COVARIANCE)
        result = filter_series(z, R, self.MODEL, initial=start)
        assert result.mean[1] == close(self.UPDATED)
        assert result.upper[1] == close(self.UPDATED_UPPER)
        assert result.innovation[1] == close(0.02, 1e-12 * 12 / 0.02)
        assert result.innovation_variance[1] == close(0.0968)
        assert result.gain[1] == close([0.896694214876033, 0.210743801652893, 0.0140495867768595])
        np.testing.assert_array_equal(result.mean[0], self.MEAN)
        np.testing.assert_array_equal(result.covariance[0], self.COVARIANCE)

    def test_one_step_of_a_filter(self):
        track = AngleFilter(self.MODEL, R)
        track.set_state(self.MEAN, self.COVARIANCE)
        track.predict()
        assert track.mean == close([12.08, 0.54, 0.008])
        upper = [0.0868, 0.0204, 0.00136, 0.0057, 0.00048, 6.8e-5]
        assert track.covariance[np.triu_indices(3)] == close(upper)
        assert track.update(12.1) == close(self.UPDATED[0])
        assert track.mean == close(self.UPDATED)
        assert track.covariance[np.triu_indices(3)] == close(self.UPDATED_UPPER)

    def test_one_step_of_the_reference(self):
        f, q = (reference.as_floats(m)[0] for m in reference.transitions(self.MODEL, [4.0]))
        x, p = reference.predict(np.array(self.MEAN), np.array(self.COVARIANCE), f, q)
        x, p, *_ = reference.update(x, p, 12.1, R)
        assert x == close(self.UPDATED)
        assert p[np.triu_indices(3)] == close(self.UPDATED_UPPER)

    @pytest.mark.parametrize(
        ("z", "first", "r", "expected"), [(Z1, 10.0, 0.01, X1), (Z2, 10.1, 0.04, X2)]
    )
    def test_a_radar(self, z, first, r, expected):
        start = [first, 0.0, 0.0], np.diag([r, 0.04, 0.0001])
        assert filter_series(z, r, self.MODEL, initial=start).mean[-1] == close(expected)
        assert smooth_series(z, r, self.MODEL, initial=start).mean[-1] == close(expected)
        last = filter_series(z, r, self.MODEL, initial=start, store="final")
        assert last.mean == close(expected)
        track = AngleFilter(self.MODEL, r)
        track.set_state(*start)
        for plot in z[1:]:
            track.step(plot)
        assert track.mean == close(expected)

    def test_both_radars_in_one_filter(self):
        """Two plots at a time: a step that takes none."""
        z = np.column_stack([self.Z1, self.Z2]).ravel()[2:]
        r = 1 / (1 / 0.01 + 1 / 0.04)
        start = [(10.0 * 4 + 10.1) / 5, 0.0, 0.0], np.diag([r, 0.04, 0.0001])
        result = filter_series(
            [NAN, *z],
            [1.0, *np.tile([0.01, 0.04], 5)],
            self.MODEL,
            initial=start,
            time=[0.0, *np.repeat(4.0 * np.arange(1, 6), 2)],
        )
        expected = [12.0848675793787, 0.11301839263859, 0.000656027754028872]
        assert result.mean[-1] == close(expected)
        assert result.covariance[-1, 0, 0] == close(0.00644947056534109)


class TestMisprints:
    """Of (18): some show in the steady state, one in the transient alone."""

    PRIOR = np.diag([R, 0.04, 0.0001])
    STEPS = 400

    def gains(self, misprint=None):
        f, q = (reference.as_floats(m)[0] for m in reference.transitions(PRINTED, [PRINTED.dt]))
        return reference.misprinted_gains(f, q, R, self.PRIOR, self.STEPS, misprint)

    def found(self):
        z = np.r_[NAN, plots(self.STEPS)]
        result = filter_series(z, R, PRINTED, initial=(np.zeros(3), self.PRIOR))
        return result.gain[1:], result.covariance[-1]

    def test_the_right_gains_from_the_first_to_the_last(self):
        gains, covariance = self.gains()
        found, last = self.found()
        np.testing.assert_allclose(found, gains, rtol=1e-11)
        np.testing.assert_allclose(last, covariance, rtol=1e-11)
        assert found[-1] == pytest.approx([0.754, 0.102, 0.0048], abs=5e-4)
        assert steady_state(PRINTED, R)[0] == close(gains[-1], 1e-11)

    def test_a_transposed_matrix_shows_in_the_transient_alone(self):
        gains, covariance = self.gains("1 - alpha T in the first corner")
        found, _ = self.found()
        np.testing.assert_allclose(found[-1], gains[-1], rtol=1e-11)
        assert np.max(np.abs(gains / found - 1)) > 0.1
        assert np.max(np.abs(covariance - covariance.T)) > 1e-5

    def test_a_wrong_index_shows_in_the_steady_gain(self):
        gains, _ = self.gains("index 022 for 012")
        assert gains[-1] == pytest.approx([0.741, 0.116, 0.0053], abs=5e-4)
        assert np.max(np.abs(gains[-1] / self.found()[0][-1] - 1)) > 0.1
