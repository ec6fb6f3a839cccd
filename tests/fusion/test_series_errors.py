"""What `fuse_series` refuses."""

import numpy as np
import pytest
from checks import INF, NAN, spoilt
from fusion.scenes import MODEL

from tertia.fusion import AngleFusion, fuse, fuse_series
from tertia.kalman import SingerModel

Z = np.arange(10.0).reshape(2, 5)
STATE_OF_TWO = np.zeros((2, 3)), np.full((2, 3, 3), np.eye(3))


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"z": Z[0]}, ValueError, r"z has shape \(5,\); it must be \(\.\.\., K, steps\)"),
        ({"z": 1.0}, ValueError, r"z has shape \(\)"),
        ({"z": Z[:0]}, ValueError, r"z has shape \(0, 5\)"),
        ({"z": Z[:, :0]}, ValueError, r"z has shape \(2, 0\)"),
        ({"z": [[1.0, 2.0], [3.0]]}, ValueError, "z is ragged"),
        ({"z": [["a", "b"]]}, TypeError, "z has dtype"),
        ({"z": spoilt(Z, INF, 1, 3)}, ValueError, r"^z\[1, 3\] is inf"),
        ({"z": spoilt(Z, -INF, 0, 0)}, ValueError, r"^z\[0, 0\] is -inf"),
        ({"z": spoilt(np.stack([Z] * 4), INF, 2, 1, 3)}, ValueError, r"^z\[2, 1, 3\] is inf"),
        (
            {"z": spoilt(np.ones((3, 2, 2, 5)), INF, 2, 1, 0, 4)},
            ValueError,
            r"^z\[2, 1, 0, 4\] is inf",
        ),
        ({"measurement_variance": -1.0}, ValueError, "^measurement_variance is -1"),
        ({"measurement_variance": 0.0}, ValueError, r"^measurement_variance.* is 0"),
        ({"measurement_variance": NAN}, ValueError, "^measurement_variance.* is nan"),
        (
            {"measurement_variance": spoilt(np.ones((2, 5)), -2.0, 1, 3)},
            ValueError,
            r"^measurement_variance\[1, 3\] is -2",
        ),
        (
            {
                "z": np.stack([Z] * 3),
                "measurement_variance": spoilt(np.ones((3, 2, 5)), 0, 2, 0, 1),
            },
            ValueError,
            r"^measurement_variance\[2, 0, 1\] is 0",
        ),
        (
            {"measurement_variance": [[0.1], [-0.2]]},
            ValueError,
            r"^measurement_variance\[1, 0\] is -0.2",
        ),
        (
            {
                "z": np.stack([Z] * 3),
                "measurement_variance": spoilt(np.ones((3, 2, 1)), -0.2, 2, 1, 0),
            },
            ValueError,
            r"^measurement_variance\[2, 1, 0\] is -0.2",
        ),
        (
            {"measurement_variance": spoilt(np.ones((1, 5)), -0.2, 0, 3)},
            ValueError,
            r"^measurement_variance\[0, 3\] is -0.2",
        ),
        ({"measurement_variance": np.ones((3, 1))}, ValueError, r"measurement_variance has shape"),
        ({"measurement_variance": np.ones((2, 4))}, ValueError, r"measurement_variance has shape"),
        ({"measurement_variance": "x"}, TypeError, "measurement_variance has dtype"),
        ({"model": 5.0}, TypeError, "model is 5.0; it must be a SingerModel"),
        ({"method": "best"}, ValueError, "method is 'best'; it must be 'robust', 'adaptive'"),
        ({"method": None}, ValueError, "method is 'None'"),
        ({"time": [0, 1, 2, 1, 3]}, ValueError, r"time\[3\] is before"),
        ({"time": [0, 1, 2]}, ValueError, "time has shape"),
        ({"time": 1.0}, ValueError, "time is a single number"),
        ({"time": [0, 1, NAN, 2, 3]}, ValueError, r"time\[2\] is nan"),
        ({"time": [0, 1, 2, 30, 31]}, ValueError, "alpha"),
        ({"period": 0.0}, ValueError, "period is 0"),
        ({"period": -360.0}, ValueError, "period is -360"),
        ({"period": "x"}, TypeError, "period is 'x'"),
        ({"forgetting_factor": 1.0}, ValueError, "forgetting_factor is 1"),
        ({"forgetting_factor": -0.5}, ValueError, "forgetting_factor is -0.5"),
        ({"forgetting_factor": NAN}, ValueError, "forgetting_factor is nan"),
        ({"forgetting_factor": "x"}, TypeError, "forgetting_factor is 'x'"),
        ({"threshold": 0.9}, ValueError, "threshold is 0.9"),
        ({"threshold": NAN}, ValueError, "threshold is nan"),
        ({"outlier_gate": 0.5}, ValueError, "outlier_gate is 0.5"),
        ({"change_probability": 0.0}, ValueError, "change_probability is 0"),
        ({"change_probability": 1.0}, ValueError, "change_probability is 1"),
        ({"change_probability": NAN}, ValueError, "change_probability is nan"),
        ({"change_probability": "x"}, TypeError, "change_probability is 'x'"),
        ({"outlier_gate": None}, TypeError, "outlier_gate is None"),
        ({"n_threads": 0}, ValueError, "n_threads is 0"),
        ({"initial": 5}, TypeError, "initial must be a pair"),
        ({"initial": (np.zeros(2), np.eye(3))}, ValueError, "initial has shapes"),
        ({"initial": (np.zeros((3, 3)), np.eye(3))}, ValueError, "initial has shape"),
        (
            {"initial": (np.zeros(3), np.full((3, 3), INF))},
            ValueError,
            "initial covariance.* is inf",
        ),
        ({"initial": (np.zeros(3), -np.eye(3))}, ValueError, r"covariance\[0, 0\] is -1"),
        (
            {"initial": (STATE_OF_TWO[0], spoilt(STATE_OF_TWO[1], -1.0, 1, 2, 2))},
            ValueError,
            r"^covariance\[1, 2, 2\] is -1",
        ),
        (
            {"initial": (STATE_OF_TWO[0], [np.eye(3), 2 * np.ones((3, 3)) - np.eye(3)])},
            np.linalg.LinAlgError,
            r"^covariance\[1\] is indefinite",
        ),
        (
            {"initial": (np.zeros(3), [[1, 2, 0], [2, 1, 0], [0, 0, 1]])},
            np.linalg.LinAlgError,
            "covariance",
        ),
    ],
)
def test_errors(changes, error, message):
    arguments = {"z": Z, "measurement_variance": 0.01, "model": MODEL} | changes
    with pytest.raises(error, match=message):
        fuse_series(**arguments)


def test_more_radars_than_memory_is_refused():
    # as of an array whose axes are exchanged
    many = 3_000_000
    with pytest.raises(MemoryError):
        fuse_series(np.zeros((many, 1)), 1.0, MODEL)
    with pytest.raises(MemoryError):
        AngleFusion(MODEL, np.ones(many))
    with pytest.raises(MemoryError):
        fuse(np.zeros((many, 1)), np.ones((many, 1, 1)), method="covariance-intersection")


@pytest.mark.parametrize("wrong", [np.radians, np.negative, lambda z: z + 20.0])
def test_two_radars_that_contradict_each_other_throughout_cause_a_warning(wrong):
    rng = np.random.default_rng(1)
    z = 40.0 + 0.02 * np.arange(200) + 0.1 * rng.standard_normal((2, 200))
    model = SingerModel(2.0, 1 / 60, 0.002)
    fuse_series(z, 0.1**2, model, period=360.0)
    z[1] = wrong(z[1])
    with pytest.warns(UserWarning, match="contradict the other radars.*the unit, the north"):
        fuse_series(z % 360.0, 0.1**2, model, period=360.0)


def wandering(steps=300, seed=2):
    """A slow sine, seen by three radars with the noise as stated."""
    truth = 40.0 + 3.0 * np.sin(np.arange(steps) / 25)
    return truth + 0.1 * np.random.default_rng(seed).standard_normal((3, steps))


def stuck(z):
    return np.r_[z[:100], z[100] + 0.02 * np.random.default_rng(3).standard_normal(len(z) - 100)]


def drifting(z):
    return z + np.linspace(0, 0.7, len(z))


@pytest.mark.parametrize("wrong", [stuck, drifting, lambda z: z + 0.7 * (np.arange(300) % 80 < 40)])
def test_two_radars_whose_errors_last_cause_a_warning(wrong):
    model = SingerModel(1.0, 1 / 20, 0.01)
    z = wandering()
    fuse_series(z, 0.1**2, model)
    z[1] = wrong(z[1])
    with pytest.warns(UserWarning, match="differ for long by more than their noise"):
        fuse_series(z[:2], 0.1**2, model)
    # most of three radars agree
    fuse_series(z, 0.1**2, model)
    # it is known that errors last
    fuse_series(z[:2], 0.1**2, model, correlation_time=50.0)


def test_plots_that_are_given_twice_cause_a_warning():
    z = wandering()
    with pytest.warns(UserWarning, match="radars 0 and 2 are the same"):
        fuse_series(z[[0, 1, 0]], 0.1**2, SingerModel(1.0, 1 / 20, 0.01))
