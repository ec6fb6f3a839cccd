"""Pictures of gates."""

import numpy as np
import pytest
from matplotlib import pyplot as plt
from pictures import line
from plot.test_tracks import air_plots, air_radars, air_tracks

from tertia import plot
from tertia.association import GUARD, INNER, OUTER, gate_threshold


def test_gates_are_about_the_prediction() -> None:
    table, plots, radars = air_tracks(), air_plots(), air_radars()
    row = int(np.flatnonzero((table.time > 90) & (table.plot >= 0))[0])
    ax = plot.gates(table, row, plots, radars, guard_acceleration=4.0)
    s = table.innovation_covariance[row]
    # every point of a gate is at its distance
    for name, probability in (("inner", INNER), ("outer", OUTER), ("guard", GUARD)):
        points = line(ax, f"{name} gate")
        squared = np.sum(points * np.linalg.solve(s, points.T).T, axis=1)
        np.testing.assert_allclose(squared, gate_threshold(probability), rtol=1e-9)
    before = (table.track == table.track[row]) & (table.time < table.time[row]) & (table.plot >= 0)
    gap = table.time[row] - table.time[before].max()
    wide = s + np.eye(2) * (4.0 * gap**2 / 2) ** 2
    points = line(ax, "guard gate, 4 m/s²")
    squared = np.sum(points * np.linalg.solve(wide, points.T).T, axis=1)
    np.testing.assert_allclose(squared, gate_threshold(GUARD), rtol=1e-9)
    np.testing.assert_allclose(line(ax, "its plot")[0], table.innovation[row])
    # the plot itself is one of the scan
    assert ax.get_title().startswith(f"track {table.track[row]} at ")
    assert ax.get_xlabel() == "east (m)"


def test_the_meaning_of_a_plot_is_that_of_its_sector() -> None:
    table, plots, radars = air_tracks(), air_plots(), air_radars()
    rows = np.flatnonzero((table.plot >= 0) & table.confirmed & (table.time < 130.0))
    meanings, ax = [], plt.figure().subplots()
    for row in rows:
        plot.gates(table, int(row), plots, radars, ax=ax)
        meanings.append(ax.get_title().split(": ")[1])
        ax.clear()
    straight = np.array(meanings) == "straight on"
    assert straight[(table.time[rows] > 40.0) & (table.time[rows] < 100.0)].all()
    assert not straight[table.time[rows] > 100.0].all()


def test_the_history_has_the_distances_of_all_plots() -> None:
    table = air_tracks()
    number = int(table.track[0])
    ax = plot.gate_history(table, number)
    drawn = line(ax, "plot")
    rows = np.flatnonzero((table.track == number) & (table.plot >= 0) & table.confirmed)
    rows = rows[np.argsort(table.time[rows], kind="stable")]
    e, s = table.innovation[rows], table.innovation_covariance[rows]
    expected = [one @ np.linalg.solve(matrix, one) for one, matrix in zip(e, s, strict=True)]
    np.testing.assert_allclose(drawn, np.column_stack([table.time[rows], expected]))
    heights = [gate_threshold(probability) for probability in (INNER, OUTER, GUARD)]
    names = ("inner gate, d²", "outer gate, d²", "guard gate, d²")
    assert [line(ax, name)[0, 1] for name in names] == heights
    inside = np.sum(np.array(expected) <= heights[0])
    assert ax.get_title() == f"track {number}: {inside} of {len(rows)} plots in the inner gate"
    assert len(ax.collections) == 1


def test_wrong_arguments() -> None:
    table, plots, radars = air_tracks(), air_plots(), air_radars()
    for call, message in (
        (lambda: plot.gates(table, len(table), plots, radars), "row is"),
        (lambda: plot.gates(table, 5, plots[:2], radars), "plots has 2 plots"),
        (lambda: plot.gates(table, 5, plots, radars, guard_acceleration=0), "guard_acceleration"),
        (lambda: plot.gate_history(table, 9), "track is 9"),
    ):
        with pytest.raises(ValueError, match=message):
            call()
    with pytest.raises(TypeError, match="table is 3"):
        plot.gate_history(3, 1)  # type: ignore[arg-type]
