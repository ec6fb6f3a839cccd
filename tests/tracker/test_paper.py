"""The tracker of the source: its score, and its window with a quadratic."""

import pickle

import numpy as np
import pytest
from tracker.flights import RADAR, line, noisy, scene, squared_errors

from tertia import simulate
from tertia.tracker import COLUMNS, PaperScore, Plots, Tracker, WindowModel, track


def test_with_one_plot_in_each_gate_the_score_is_as_good_as_the_likelihood():
    plots = line(60)
    usual, paper = (track(plots, [RADAR], association=name) for name in ("gnn", "paper"))
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(usual, column.name), getattr(paper, column.name))


@pytest.mark.parametrize("motion", ["window", "imm"])
def test_plots_m_of_n_confirm_whatever_the_clutter(motion):
    radar, _, seen = scene(3, n=10, clutter=150.0)
    tables = {
        name: track(seen.plots, [radar], motion=motion, association=name)
        for name in ("gnn", "paper")
    }
    count = {name: len(np.unique(table.track)) for name, table in tables.items()}
    assert count["paper"] > count["gnn"]
    # the third plot confirms: nothing else is asked
    found = tables["paper"]
    assert {np.sum(~found.confirmed[found.track == k]) for k in np.unique(found.track)} == {2}


def test_options_of_the_paper():
    tracker = Tracker([RADAR], association=PaperScore(q=10.0), motion=WindowModel(degree=2))
    plots = line(30)
    tracker.update(plots[:15])
    same = pickle.loads(pickle.dumps(tracker))
    np.testing.assert_array_equal(
        tracker.update(plots[15:]).position, same.update(plots[15:]).position
    )
    assert (WindowModel().after_turn, WindowModel(degree=2).after_turn) == (3, 7)
    assert WindowModel(degree=2, after_turn=6).after_turn == 6
    for call, message in (
        (lambda: PaperScore(q=1.0), "q is 1.0; it must be above 1"),
        (lambda: WindowModel(degree=3), "degree is 3; it must be 1 or 2"),
        (lambda: WindowModel(degree=2, after_turn=4), "after_turn is 4"),
        (lambda: Tracker([RADAR], association="best"), "association is 'best'"),
    ):
        with pytest.raises(ValueError, match=message):
            call()
    with pytest.raises(TypeError, match="association is 3"):
        Tracker([RADAR], association=3)


def test_a_quadratic_follows_turns_better_than_a_line():
    plans = simulate.routes("middle", 60, rng=181)
    traffic = simulate.flights(plans, wind=20.0, rng=182)
    radar = simulate.set_up("middle").radar
    seen = simulate.radar_plots(traffic, [radar], rng=183)
    square = {1: [], 2: []}
    for flight in range(60):
        plots = seen.plots[seen.target == flight]
        for degree, errors in square.items():
            found = track(plots, [radar], motion=WindowModel(degree=degree))
            squares, turning = squared_errors(found, traffic, flight)
            errors.append(squares[found.confirmed & turning])
    rms = {degree: np.sqrt(np.mean(np.concatenate(s))) for degree, s in square.items()}
    assert 0.85 < rms[2] / rms[1] < 1.0


def test_a_quadratic_is_exact_where_the_acceleration_is_constant():
    quiet = type(RADAR)(range_sigma=0.5, azimuth_sigma=1e-6, scan_period=4.0)
    # a parabola in the middle third
    time = 4.0 * np.arange(60)
    after = np.clip(time - 80.0, 0.0, 60.0)
    north = 30e3 + 0.5 * 1.5 * after**2 + 1.5 * after * np.clip(time - 140.0, 0.0, None)
    position = np.stack([-20e3 + 150.0 * time, north], axis=1)
    plots = Plots(time, *noisy(position, quiet, np.random.default_rng(1)))
    errors = {}
    for degree in (1, 2):
        found = track(plots, [quiet], motion=WindowModel(degree=degree))
        bent = (found.time > 112.0) & (found.time < 128.0)
        errors[degree] = np.linalg.norm(found.position - position[found.plot], axis=1)[bent].max()
    # the line lags, the quadratic has the noise of its plots
    assert errors[2] < 2.0 < errors[1]
