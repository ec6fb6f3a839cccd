"""The table of `fuse` in docs/fusion-estimates.md; without chance, from the covariances alone."""

import numpy as np

from studies.pages import markdown
from tertia.fusion import InstantMethod, fuse

# variances along and across the line of sight of three sensors, and of an error they share
ALONG, ACROSS = 9.0, 1.0
DIRECTIONS = np.radians([0.0, 60.0, 120.0])
COMMON = (0.0, 1.0, 4.0)
ROWS: tuple[tuple[str, InstantMethod, bool], ...] = (
    ("matrix", "matrix", True),
    ("matrix, errors treated as independent", "matrix", False),
    ("posterior", "posterior", True),
    ("equal", "equal", True),
    ("covariance-intersection", "covariance-intersection", False),
)


def methods() -> str:
    """Real mean squared error of each method over that of the best, and expected NEES."""
    turn = np.array(
        [[np.cos(DIRECTIONS), np.sin(DIRECTIONS)], [-np.sin(DIRECTIONS), np.cos(DIRECTIONS)]]
    )
    turn = np.moveaxis(turn, -1, 0)
    alone = turn.swapaxes(-1, -2) @ np.diag([ALONG, ACROSS]) @ turn
    rows = []
    for label, method, correlated in ROWS:
        cells = []
        for variance in COMMON:
            common = variance * np.eye(2)
            cross = np.broadcast_to(common, (3, 3, 2, 2))
            s, x = alone + common, np.zeros((3, 2))
            best = fuse(x, s, cross_covariances=cross)
            found = fuse(x, s, method=method, cross_covariances=cross if correlated else None)
            real = found.weights @ alone @ found.weights.swapaxes(-1, -2)
            covariance = real.sum(axis=0) + common
            cost = np.trace(covariance) / np.trace(best.covariance)
            nees = np.trace(np.linalg.solve(found.covariance, covariance)) / 2
            cells.append(f"{cost:.2f}, {nees:.2f}")
        rows.append([label, *cells])
    head = [f"common variance {variance:.0f}" for variance in COMMON]
    return markdown(["squared error relative to the best, NEES per dimension", *head], rows)
