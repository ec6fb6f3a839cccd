"""Geo as its sources print it: WGS 84, plots by bisection, the plane, the atmosphere."""

import numpy as np

A, F = 6_378_137.0, 1 / 298.257223563
E2 = F * (2 - F)
# ISO 2533
P0, T0, LAPSE, TROPOPAUSE = 101_325.0, 288.15, 0.0065, 11_000.0
GAS, G0 = 287.05287, 9.80665


def to_ecef(latitude, longitude, height):
    phi, theta = np.radians(latitude), np.radians(longitude)
    n = A / np.sqrt(1 - E2 * np.sin(phi) ** 2)
    level = (n + height) * np.cos(phi)
    return np.array(
        [level * np.cos(theta), level * np.sin(theta), (n * (1 - E2) + height) * np.sin(phi)]
    )


def to_geodetic(p):
    """Latitude, longitude and height by a fixed point: tan φ = (z + e² N sin φ) / r."""
    x, y, z = p
    r = np.hypot(x, y)
    phi = np.arctan2(z, r * (1 - E2))
    for _ in range(30):
        n = A / np.sqrt(1 - E2 * np.sin(phi) ** 2)
        phi = np.arctan2(z + E2 * n * np.sin(phi), r)
    n = A / np.sqrt(1 - E2 * np.sin(phi) ** 2)
    # beyond 45 degrees the cosine is the worse divisor
    flat = abs(np.degrees(phi)) < 45
    height = r / np.cos(phi) - n if flat else z / np.sin(phi) - n * (1 - E2)
    return np.degrees(phi), np.degrees(np.arctan2(y, x)), height


def axes(latitude, longitude):
    phi, theta = np.radians(latitude), np.radians(longitude)
    sp, cp, sl, cl = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
    return np.array([[-sl, cl, 0], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]])


def polar_to_ecef(site, rho, alpha, height):
    """The point at this range and azimuth (radians) whose height is given: elevation bisected."""
    origin, turn = to_ecef(*site), axes(*site[:2])

    def point(e):
        local = np.array([np.cos(e) * np.sin(alpha), np.cos(e) * np.cos(alpha), np.sin(e)])
        return origin + rho * local @ turn

    low, high = -np.pi / 4, np.pi / 2
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if to_geodetic(point(middle))[2] < height else (low, middle)
    return point((low + high) / 2)


def meridional_radius(latitude):
    return A * (1 - E2) / (1 - E2 * np.sin(np.radians(latitude)) ** 2) ** 1.5


def to_plane(centre, p):
    """u, v and the height over the sphere of the meridional radius."""
    x, y, z = axes(*centre[:2]) @ (p - to_ecef(*centre))
    r, own = meridional_radius(centre[0]), centre[2]
    height = np.sqrt(x**2 + y**2 + (z + own + r) ** 2) - r
    k = 2 * r / (2 * r + own + z + height)
    return np.array([k * x, k * y, height])


def plot_in_plane(site, centre, rho, alpha, height):
    """u, v of a plot, and the derivatives by range, azimuth and height from differences."""

    def place(*plot):
        return to_plane(centre, polar_to_ecef(site, *plot))[:2]

    columns = []
    for k, step in enumerate((10.0, 1e-4, 10.0)):
        plots = np.array([[rho, alpha, height]] * 2)
        plots[0, k] += step
        plots[1, k] -= step
        columns.append((place(*plots[0]) - place(*plots[1])) / (2 * step))
    return place(rho, alpha, height), np.column_stack(columns)


def pressure(altitude):
    if altitude <= TROPOPAUSE:
        return P0 * (1 - LAPSE * altitude / T0) ** (G0 / (GAS * LAPSE))
    cold = T0 - LAPSE * TROPOPAUSE
    return pressure(TROPOPAUSE) * np.exp(-(altitude - TROPOPAUSE) * G0 / (GAS * cold))


def polar_state(state):
    """p, v, a of [ρ, ρ', ρ'', θ, θ', θ'']."""
    r, r1, r2, angle, w, w1 = state
    e = np.array([np.sin(angle), np.cos(angle)])
    f = np.array([np.cos(angle), -np.sin(angle)])
    return np.concatenate(
        [r * e, r1 * e + r * w * f, (r2 - r * w**2) * e + (r * w1 + 2 * r1 * w) * f]
    )
