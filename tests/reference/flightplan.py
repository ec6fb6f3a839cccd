"""Flight plans by their formulas: turns, capture arcs, scores, monitors, passing times.

Courses and angles of turns are mathematical here, counter-clockwise from east.
"""

import numpy as np

GRAVITY = 9.80665
BANK, RATE = np.radians(25.0), np.radians(3.0)


def unit(vector):
    return np.asarray(vector, dtype=float) / np.hypot(*vector)


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def wrap(angle):
    return np.angle(np.exp(1j * angle))


def course(vector):
    return np.arctan2(vector[1], vector[0])


def turn(before, corner, after, speed, bank=BANK, rate=RATE):
    """The fly-by turn at B between A and C, its legs long enough."""
    a, b, c = (np.asarray(p, dtype=float) for p in (before, corner, after))
    u1, u2 = unit(b - a), unit(c - b)
    th = wrap(course(u2) - course(u1))
    radius = max(speed**2 / (GRAVITY * np.tan(bank)), speed / rate)
    d = radius * np.tan(abs(th) / 2)
    t1, t2 = b - d * u1, b + d * u2
    n1 = np.array([-u1[1], u1[0]])
    centre = t1 + np.sign(th) * radius * n1
    return {
        "b": b, "u1": u1, "u2": u2, "th": th, "radius": radius, "lead": d,
        "arc": radius * abs(th), "start": t1, "end": t2, "centre": centre,
    }  # fmt: skip


def at(t, s):
    """Position and course at the coordinate s, which is 0 where the arc starts."""
    if s < 0:
        return t["start"] + s * t["u1"], course(t["u1"])
    if s > t["arc"]:
        return t["end"] + (s - t["arc"]) * t["u2"], course(t["u2"])
    angle = np.sign(t["th"]) * s / t["radius"]
    turning = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return t["centre"] + turning @ (t["start"] - t["centre"]), course(t["u1"]) + angle


def project(t, p):
    """Coordinate and distance of the nearest point: legs and arc by the bisector."""
    p = np.asarray(p, dtype=float)
    if (p - t["b"]) @ (t["u1"] + t["u2"]) < 0:
        along = (p - t["start"]) @ t["u1"]
        if along < 0:
            return along, abs(cross(t["u1"], p - t["start"]))
    else:
        along = (p - t["end"]) @ t["u2"]
        if along > 0:
            return t["arc"] + along, abs(cross(t["u2"], p - t["end"]))
    a, q = t["start"] - t["centre"], p - t["centre"]
    swept = np.sign(t["th"]) * np.arctan2(cross(a, q), a @ q)
    return t["radius"] * swept, abs(t["radius"] - np.hypot(*q))


def passing_times(waypoints, speed, bank=BANK, rate=RATE):
    """Times at waypoints: legs less `2 d - R|th|` of the turns before, and half of its own."""
    w = np.asarray(waypoints, dtype=float)
    legs = np.hypot(*np.diff(w, axis=0).T)
    turns = [turn(*w[i : i + 3], speed, bank, rate) for i in range(len(w) - 2)]
    short = np.array([0.0, *(2 * t["lead"] - t["arc"] for t in turns), 0.0])
    before = np.cumsum(short) - short
    return (np.concatenate([[0.0], np.cumsum(legs)]) - before - short / 2) / speed


def score(e, dpsi, dv, dt, dh=None, p=0.0, psi_variance=0.0, v_variance=0.0):
    """L of the differences of a plot from a plan."""
    total = (
        e**2 / (700**2 + p)
        + dpsi**2 / (np.radians(3) ** 2 + psi_variance)
        + dv**2 / (12**2 + v_variance)
        + dt**2 / 120**2
    )
    return -0.5 * (total + (0.0 if dh is None else dh**2 / 150**2))


def level(before, e, dc, p=0.0, room=0.0, course_variance=0.0):
    """The next B of a monitor."""
    q = max(abs(e) - room, 0.0) ** 2 / (350**2 + p) + dc**2 / (np.radians(5) ** 2 + course_variance)
    return max(0.0, before + min(q, 20.0) - 4.0)


def mean_speed(times, speeds, tau=60.0):
    """Normalised mean with weights that fall by e in tau."""
    weights = np.exp((times - times[-1]) / tau)
    return weights @ speeds / weights.sum()
