"""What is kept of a series, arrays of any kind, batches, threads."""

import itertools

import numpy as np
import pytest
from checks import INF, NAN, rng
from kalman.scenes import EXACT, GIVEN, PRINTED, R, assert_states, plots
from tolerances import EXACT_STATE

from tertia.kalman import filter_series, smooth_series


class TestStore:
    @pytest.mark.parametrize("shape", [(), (1,), (9,), (2, 20)])
    @pytest.mark.parametrize("start", [None, GIVEN], ids=["unknown", "given"])
    def test_what_is_kept_is_the_same(self, shape, start):
        z = plots(*shape, 60, seed=1)
        z[..., 30:33] = NAN
        everything, means, last = (
            filter_series(z, R, PRINTED, initial=start, period=360.0, store=store)
            for store in ("all", "mean", "final")
        )
        np.testing.assert_array_equal(means.mean, everything.mean)
        np.testing.assert_array_equal(last.mean, everything.mean[..., -1, :])
        np.testing.assert_array_equal(last.covariance, everything.covariance[..., -1, :, :])
        np.testing.assert_array_equal(last.sigma, everything.sigma[..., -1, :])
        for other in (means, last):
            np.testing.assert_array_equal(other.log_likelihood, everything.log_likelihood)
            np.testing.assert_array_equal(other.count, everything.count)
            assert other.innovation.size == other.innovation_variance.size == 0
        assert means.covariance.size == 0
        assert last.mean.shape == (*shape, 3)
        assert last.covariance.shape == (*shape, 3, 3)
        if shape == ():
            assert isinstance(last.log_likelihood, float)
            assert isinstance(last.count, int)

    @pytest.mark.parametrize("store", ["mean", "final"])
    def test_a_gain_that_is_not_kept(self, store):
        """Empty like the innovations, or an error that says what to do."""
        result = filter_series(plots(20), R, PRINTED, store=store)
        try:
            assert result.gain.size == 0
        except (ValueError, AttributeError) as error:
            assert "store" in str(error)  # noqa: PT017 - either is right

    def test_variances_are_kept_as_given(self):
        z = plots(2, 3, 8)
        for shape in [(), (8,), (3, 1), (2, 3, 8)]:
            r = rng(1).uniform(0.01, 0.02, shape)
            kept = filter_series(z, r, PRINTED).measurement_variance
            np.testing.assert_array_equal(kept, np.broadcast_to(np.atleast_1d(r), z.shape))
            assert not kept.flags.writeable

    def test_a_single_row_is_one_series_or_refused(self):
        """Whatever is allowed for the plots of one series gives one result."""
        z = plots(5)
        expected = filter_series(z, R, PRINTED)
        try:
            found = filter_series(z, np.full((1, 5), R), PRINTED)
        except ValueError as error:
            assert "measurement_variance" in str(error)  # noqa: PT017 - either is right
        else:
            np.testing.assert_array_equal(found.mean, expected.mean)

    def test_results_are_printed_usefully(self):
        z = plots(10)
        result = filter_series(z, R, PRINTED)
        told = f"8 innovations, log-likelihood {result.log_likelihood:.6g}"
        note = ", systematic error not included)"
        assert repr(result) == f"FilteredSeries(mean of shape (10, 3), {told}{note}"
        both = filter_series([z, z], R, PRINTED)
        assert repr(both) == f"FilteredSeries(mean of shape (2, 10, 3){note}"
        assert repr(smooth_series(z, R, PRINTED)) == f"SmoothedSeries(mean of shape (10, 3){note}"


class TestArrays:
    """What arrays may look like."""

    Z = plots(6, 12, seed=3)

    def same(self, z, expected_z=None, **options):
        for function in (filter_series, smooth_series):
            found = function(z, R, EXACT, **options)
            expected = function(self.Z if expected_z is None else expected_z, R, EXACT, **options)
            np.testing.assert_array_equal(found.mean, expected.mean)
            np.testing.assert_array_equal(found.upper, expected.upper)

    def test_lists(self):
        self.same(self.Z.tolist(), time=(5.0 * np.arange(12)).tolist())
        start = GIVEN[0].tolist(), GIVEN[1].tolist()
        found = filter_series(self.Z, [[R]] * 6, EXACT, initial=start)
        expected = filter_series(self.Z, R, EXACT, initial=GIVEN)
        np.testing.assert_array_equal(found.mean, expected.mean)

    def test_missing_plots_in_other_words(self):
        gap = self.Z.copy()
        gap[2, 5] = NAN
        objects = self.Z.astype(object)
        objects[2, 5] = None
        self.same(objects, gap)
        self.same(np.ma.array(self.Z, mask=np.isnan(gap)), gap)

    @pytest.mark.parametrize("shape", [(0,), (2, 0), (0, 3)])
    def test_no_series(self, shape):
        z = np.empty((*shape, 10))
        result = filter_series(z, R, PRINTED)
        assert result.mean.shape == (*shape, 10, 3)
        assert result.covariance.shape == (*shape, 10, 3, 3)
        assert result.log_likelihood.shape == result.count.shape == shape
        assert smooth_series(z, R, PRINTED).covariance.shape == (*shape, 10, 3, 3)
        assert filter_series(z, R, PRINTED, store="final").mean.shape == (*shape, 3)

    @pytest.mark.parametrize("store", ["all", "mean", "final"])
    @pytest.mark.parametrize("rows", [1, 7, 64, 301])
    def test_threads_do_not_change_a_bit(self, rows, store):
        z = plots(rows, 90, seed=4)
        z[:, 40:43] = NAN
        z[::5, ::7] = NAN
        times = np.cumsum(rng(5).uniform(1, 9, 90))
        for options in ({}, {"time": times}, {"initial": GIVEN, "period": 360.0}):
            alone = filter_series(z, R, PRINTED, n_threads=1, store=store, **options)
            back = smooth_series(z, R, PRINTED, n_threads=1, **options)
            for n_threads in (2, 5, None):
                many = filter_series(z, R, PRINTED, n_threads=n_threads, store=store, **options)
                for name in ("mean", "upper", "innovation", "innovation_variance"):
                    np.testing.assert_array_equal(getattr(many, name), getattr(alone, name))
                np.testing.assert_array_equal(many.log_likelihood, alone.log_likelihood)
                np.testing.assert_array_equal(many.count, alone.count)
                if store == "all":
                    smooth = smooth_series(z, R, PRINTED, n_threads=n_threads, **options)
                    np.testing.assert_array_equal(smooth.mean, back.mean)
                    np.testing.assert_array_equal(smooth.upper, back.upper)

    @pytest.mark.parametrize("rows", [2, 3, 8, 33, 130])
    @pytest.mark.parametrize("start", [None, GIVEN], ids=["unknown", "given"])
    def test_a_series_does_not_depend_on_its_neighbours(self, rows, start):
        """Some with gaps, some late, some empty, some with noise of their own."""
        z = plots(rows, 70, seed=6)
        z[::3, 20:24] = NAN
        z[1::7, :5] = NAN
        z[5::11] = NAN
        z[4::9, 60:] = NAN
        own = R * rng(7).uniform(0.5, 2, (rows, 1))
        for r in (np.full((rows, 1), R), own, np.broadcast_to(R, z.shape)):
            options = {"initial": start, "period": 360.0}
            together = filter_series(z, r, PRINTED, **options)
            smooth = smooth_series(z, r, PRINTED, **options)
            for row in range(rows):
                alone = filter_series(z[row], r[row], PRINTED, **options)
                expected = alone.mean, alone.covariance
                found = together.mean[row], together.covariance[row]
                assert_states(found, expected, EXACT_STATE, 360.0)
                assert together.count[row] == alone.count
                likelihood = pytest.approx(alone.log_likelihood, rel=1e-12)
                assert together.log_likelihood[row] == likelihood
                back = smooth_series(z[row], r[row], PRINTED, **options)
                expected = back.mean, back.covariance
                assert_states((smooth.mean[row], smooth.covariance[row]), expected, 1e-12, 360.0)

    WIDE = (np.zeros(3), np.diag([1e9, 1e9, 1e-5]))

    @pytest.mark.parametrize("rows", [3, 4, 15, 16, 17, 40])
    @pytest.mark.parametrize("start", [None, GIVEN, WIDE], ids=["unknown", "given", "wide"])
    @pytest.mark.parametrize("period", [None, 360.0])
    def test_complete_series_share_their_gains(self, rows, start, period):
        """And all that comes of it, whatever one of them misses."""
        z = plots(rows, 60, seed=6)
        times = np.cumsum(rng(8).uniform(1, 9, 60))
        noises = R, R * rng(7).uniform(0.5, 2, 60)
        for r, steps in itertools.product(noises, (None, times)):
            options = {"initial": start, "period": period, "time": steps}
            together = filter_series(z, r, EXACT, **options)
            missing = np.concatenate([z, z[:1]])
            missing[-1, 30] = NAN
            others = filter_series(missing, r, EXACT, **options)
            for row in range(rows):
                alone = filter_series(z[row], r, EXACT, **options)
                for result in (together, others):
                    found = result.mean[row], result.covariance[row]
                    assert_states(found, (alone.mean, alone.covariance), EXACT_STATE, period)
                    for name in ("innovation", "innovation_variance"):
                        np.testing.assert_allclose(
                            getattr(result, name)[row], getattr(alone, name), rtol=1e-12, atol=1e-10
                        )
                    assert result.count[row] == alone.count
                    likelihood = pytest.approx(alone.log_likelihood, rel=1e-11)
                    assert result.log_likelihood[row] == likelihood
            means = filter_series(z, r, EXACT, store="mean", **options)
            np.testing.assert_array_equal(means.mean, together.mean)
            last = filter_series(z, r, EXACT, store="final", **options)
            np.testing.assert_array_equal(last.mean, together.mean[:, -1])
            np.testing.assert_array_equal(last.upper, together.upper[:, -1])
            np.testing.assert_array_equal(last.log_likelihood, together.log_likelihood)

    @pytest.mark.parametrize("first", [0, 1])
    def test_a_plot_that_is_missing_before_the_state_is_known(self, first):
        z = plots(6, 20, seed=6)
        z[3, first] = NAN
        together = filter_series(z, R, PRINTED)
        for row, plots_of_row in enumerate(z):
            alone = filter_series(plots_of_row, R, PRINTED)
            found = together.mean[row, 3:], together.covariance[row, 3:]
            assert_states(found, (alone.mean[3:], alone.covariance[3:]), EXACT_STATE)
            likelihood = pytest.approx(alone.log_likelihood, rel=1e-12)
            assert together.log_likelihood[row] == likelihood

    @pytest.mark.parametrize("store", ["all", "mean"])
    @pytest.mark.parametrize("shape", [(40,), (3, 40), (2, 20, 40)])
    def test_arrays_of_an_earlier_result(self, shape, store):
        z, other = plots(*shape, seed=1), plots(*shape, seed=2)
        z[..., 7] = NAN
        expected = filter_series(z, R, PRINTED, store=store)
        out = filter_series(other, 3 * R, EXACT, store=store)
        found = filter_series(z, R, PRINTED, store=store, out=out)
        for name in ("mean", "upper", "innovation", "innovation_variance"):
            assert getattr(found, name) is getattr(out, name)
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        np.testing.assert_array_equal(found.log_likelihood, expected.log_likelihood)
        np.testing.assert_array_equal(found.covariance, expected.covariance)

    def test_arrays_that_do_not_fit(self):
        z = plots(3, 40)
        out = filter_series(z, R, PRINTED)
        with pytest.raises(
            ValueError, match=r"out has an array of shape \(3, 40, 3\).*shape \(2, 40\)"
        ):
            filter_series(z[:2], R, PRINTED, out=out)
        with pytest.raises(ValueError, match=r'out has an array of shape .*store="mean"'):
            filter_series(z, R, PRINTED, store="mean", out=out)
        with pytest.raises(ValueError, match='out has no use with store="final"'):
            filter_series(z, R, PRINTED, store="final", out=out)
        with pytest.raises(TypeError, match="out is of type ndarray; it must be a FilteredSeries"):
            filter_series(z, R, PRINTED, out=np.empty((3, 40, 3)))
        out.mean.flags.writeable = False
        with pytest.raises(ValueError, match="out has an array"):
            filter_series(z, R, PRINTED, out=out)

    def test_threads_report_the_first_bad_row(self):
        z = plots(300, 40)
        z[[120, 250], 3] = INF
        for function in (filter_series, smooth_series):
            for n_threads in (1, 4):
                with pytest.raises(ValueError, match=r"z\[120, 3\] is inf"):
                    function(z, R, PRINTED, n_threads=n_threads)
