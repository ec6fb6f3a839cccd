//! Quadrature over the positions that a few bearings allow: a tree of squares, finer where the density
//! is high.

use super::concentration::Evidence;

/// Number of squares across the square that contains all positions within range.
const ACROSS: usize = 16;
/// Squares that may be within range are divided while their sides exceed this share of the maximum range:
/// if stations are far apart, few points of larger squares would be within range.
const RESOLVED: f64 = 0.5;
/// Largest number of these divisions. With more, the coordinates of the squares would no longer differ.
const FINER: usize = 40;
/// Number of squares from which on squares are no longer divided because of their size.
const MANY: usize = 1 << 14;
/// Largest number of times that a square is divided because of the density.
const LEVELS: usize = 11;
/// A square is divided if it may contain this share of the probability and its ln density may exceed
/// that at its centre by [`CHANGE`].
const SHARE: f64 = 0.003;
const CHANGE: f64 = 0.05;
/// Half the diagonal of a square of side 1, with a margin: slightly more than `√½`.
const RADIUS: f64 = 0.71;
/// Distance of the Gauss points of a square of side 1 from its axes: `1 / (2 √3)`.
const GAUSS: f64 = 0.288_675_134_594_812_9;
const CORNERS: [[f64; 2]; 4] = [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]];

/// A bearing: station, direction (east, north) and `1/σ²`.
#[derive(Clone, Copy, Debug)]
pub(in crate::location) struct Ray {
    pub station: [f64; 2],
    pub direction: [f64; 2],
    pub precision: f64,
}

/// The bearings of an instant, and the largest distance of the target from the nearest station.
pub(in crate::location) struct Scene<'a> {
    pub rays: &'a [Ray],
    pub max_range: f64,
}

impl Scene<'_> {
    /// Returns `S(p) = Σ (1 − cos(θ_i − a_i(p))) / σ_i²`, and the distance from the nearest station, by
    /// dot products, without computing angles.
    pub fn misfit(&self, p: [f64; 2]) -> (f64, f64) {
        let (mut sum, mut nearest) = (0.0, f64::INFINITY);
        for ray in self.rays {
            let (cosine, range) = ray.cosine(p);
            sum += ray.precision * (1.0 - cosine);
            nearest = nearest.min(range);
        }
        (sum, nearest)
    }

    /// Returns a lower bound of S within a radius around a point: every direction is turned towards its
    /// bearing as far as the radius allows.
    fn least_misfit(&self, p: [f64; 2], radius: f64) -> f64 {
        let mut sum = 0.0;
        for ray in self.rays {
            let (cosine, range) = ray.cosine(p);
            if range <= radius {
                continue;
            }
            let turn = radius / range;
            let least = (1.0 - turn * turn).sqrt();
            if cosine < least {
                let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
                sum += ray.precision * (1.0 - (cosine * least + sine * turn));
            }
        }
        sum
    }

    /// Returns centre and side of the square around all positions within range.
    fn frame(&self) -> ([f64; 2], f64) {
        let mut centre = [0.0; 2];
        let mut side = 0.0_f64;
        for axis in 0..2 {
            let places = || self.rays.iter().map(|ray| ray.station[axis]);
            let (low, high) =
                (places().fold(f64::INFINITY, f64::min), places().fold(-f64::INFINITY, f64::max));
            centre[axis] = 0.5 * (low + high);
            side = side.max(high - low + 2.0 * self.max_range);
        }
        (centre, side)
    }
}

impl Ray {
    /// Returns the cosine of the angle between the bearing and the direction to a point, and the range.
    fn cosine(&self, p: [f64; 2]) -> (f64, f64) {
        let (x, y) = (p[0] - self.station[0], p[1] - self.station[1]);
        let range = (x * x + y * y).sqrt();
        let along = x * self.direction[0] + y * self.direction[1];
        ((along / range.max(f64::MIN_POSITIVE)).clamp(-1.0, 1.0), range)
    }

    /// Returns the bearing minus the direction to a point, clockwise, in standard deviations.
    pub fn residual(&self, p: [f64; 2]) -> f64 {
        let (x, y) = (p[0] - self.station[0], p[1] - self.station[1]);
        let [east, north] = self.direction;
        (east * y - north * x).atan2(x * east + y * north) * self.precision.sqrt()
    }
}

#[derive(Clone, Copy, Debug)]
struct Square {
    centre: [f64; 2],
    side: f64,
    /// ln of the density at the centre; below, its upper bound within the square.
    ln: f64,
    ln_bound: f64,
}

/// A point of the quadrature, with the area that it represents, and S and ln of the density there.
#[derive(Clone, Copy, Debug)]
pub(in crate::location) struct Node {
    pub p: [f64; 2],
    pub area: f64,
    pub misfit: f64,
    pub ln: f64,
    /// Distance from the nearest station.
    pub nearest: f64,
}

/// Returns the nodes of a quadrature of the density `g(S(p))` within range. O(nodes · bearings).
pub(in crate::location) fn nodes(scene: &Scene<'_>, evidence: &Evidence<'_>) -> Vec<Node> {
    let square = &|centre: [f64; 2], side: f64| {
        let (misfit, nearest) = scene.misfit(centre);
        let reach = scene.max_range + RADIUS * side;
        (nearest <= reach).then(|| Square {
            centre,
            side,
            ln: evidence.ln_at(misfit),
            ln_bound: evidence.ln_at(scene.least_misfit(centre, RADIUS * side)),
        })
    };
    let (centre, side) = scene.frame();
    let step = side / ACROSS as f64;
    let at = |axis: usize, i: usize| centre[axis] - 0.5 * side + (i as f64 + 0.5) * step;
    let grid = (0..ACROSS).flat_map(|i| (0..ACROSS).map(move |j| (i, j)));
    let mut squares: Vec<Square> =
        grid.filter_map(|(i, j)| square([at(0, i), at(1, j)], step)).collect();
    let quarters = |s: Square| {
        let half = 0.5 * s.side;
        let centres = CORNERS.map(|corner| [0, 1].map(|i| s.centre[i] + 0.5 * half * corner[i]));
        centres.into_iter().filter_map(move |centre| square(centre, half))
    };
    for _ in 0..FINER {
        let is_fine = |s: &Square| s.side <= RESOLVED * scene.max_range;
        if squares.len() >= MANY || squares.iter().all(is_fine) {
            break;
        }
        squares = squares.into_iter().flat_map(quarters).collect();
    }
    for _ in 0..LEVELS {
        let largest = squares.iter().map(|s| s.ln).fold(f64::NEG_INFINITY, f64::max);
        let total: f64 = squares.iter().map(|s| s.side * s.side * (s.ln - largest).exp()).sum();
        let least = largest + (SHARE * total).ln();
        let divided =
            |s: &Square| s.ln_bound - s.ln > CHANGE && s.ln_bound + 2.0 * s.side.ln() > least;
        let (coarse, fine): (Vec<_>, Vec<_>) = squares.into_iter().partition(divided);
        squares = fine;
        if coarse.is_empty() {
            break;
        }
        squares.extend(coarse.into_iter().flat_map(quarters));
    }
    let inner = |s: Square| {
        CORNERS.iter().filter_map(move |corner| {
            let p = [0, 1].map(|axis| s.centre[axis] + GAUSS * s.side * corner[axis]);
            let (misfit, nearest) = scene.misfit(p);
            let area = 0.25 * s.side * s.side;
            let ln = evidence.ln_at(misfit);
            (nearest <= scene.max_range).then_some(Node { p, area, misfit, ln, nearest })
        })
    };
    squares.into_iter().flat_map(inner).collect()
}
