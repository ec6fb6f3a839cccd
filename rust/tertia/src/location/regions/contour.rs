//! Contours in the plane by marching squares, and size of the area that they enclose.

use std::f64::consts::PI;

/// Number of squares along each side of a frame.
const CELLS: usize = 96;
/// Number of nodes along a side.
const SIDE: usize = CELLS + 1;
/// Marks an edge that no contour crosses.
const NONE: usize = usize::MAX;

/// A rectangle, given by its centre, the direction of its first axis, and half the lengths of its
/// sides.
#[derive(Clone, Copy, Debug)]
pub(in crate::location) struct Frame {
    pub centre: [f64; 2],
    pub cosine: f64,
    pub sine: f64,
    pub half: [f64; 2],
}

impl Frame {
    /// Returns a frame around squares, along their principal axes. The squares are given by their
    /// centres and a quarter of their areas.
    pub fn around(squares: impl Iterator<Item = ([f64; 2], f64)> + Clone) -> Self {
        let mut total = 0.0;
        let mut sum = [0.0; 2];
        for (p, area) in squares.clone() {
            total += area;
            sum = [sum[0] + area * p[0], sum[1] + area * p[1]];
        }
        let mean = sum.map(|v| v / total);
        let mut moments = [0.0; 3];
        for (p, area) in squares.clone() {
            let [x, y] = [p[0] - mean[0], p[1] - mean[1]];
            moments =
                [moments[0] + area * x * x, moments[1] + area * x * y, moments[2] + area * y * y];
        }
        let (.., angle) = principal(moments.map(|v| v / total));
        let (sine, cosine) = angle.sin_cos();
        let mut frame = Self { centre: mean, cosine, sine, half: [0.0; 2] };
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for (p, area) in squares {
            let (at, side) = (frame.inward(p), 2.0 * area.sqrt());
            for axis in 0..2 {
                low[axis] = low[axis].min(at[axis] - side);
                high[axis] = high[axis].max(at[axis] + side);
            }
        }
        frame.centre = frame.outward([0, 1].map(|axis| 0.5 * (low[axis] + high[axis])));
        frame.half = [0, 1].map(|axis| 0.5 * (high[axis] - low[axis]));
        frame
    }

    fn inward(&self, p: [f64; 2]) -> [f64; 2] {
        let [x, y] = [p[0] - self.centre[0], p[1] - self.centre[1]];
        [x * self.cosine + y * self.sine, y * self.cosine - x * self.sine]
    }

    fn outward(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [
            self.centre[0] + x * self.cosine - y * self.sine,
            self.centre[1] + x * self.sine + y * self.cosine,
        ]
    }

    fn node(&self, i: usize, j: usize) -> [f64; 2] {
        let at = |axis: usize, i: usize| self.half[axis] * (2.0 * i as f64 / CELLS as f64 - 1.0);
        self.outward([at(0, i), at(1, j)])
    }
}

/// Closed lines around an area, which is to their left, and the ellipse with the same second moments.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Corners of each line.
    pub rings: Vec<Vec<[f64; 2]>>,
    /// Area that the lines enclose.
    pub area: f64,
    /// Longer semi-axis of the ellipse with the second moments of the area.
    pub semi_major: f64,
    /// Shorter semi-axis of this ellipse.
    pub semi_minor: f64,
    /// Direction of the longer semi-axis, clockwise from north, from 0 to π.
    pub orientation: f64,
}

impl Outline {
    /// Computes area and moments of closed lines by Green's theorem.
    pub(in crate::location) fn of(rings: Vec<Vec<[f64; 2]>>) -> Self {
        let origin = rings.first().map_or([0.0; 2], |ring| ring[0]);
        let (mut area, mut first, mut second) = (0.0, [0.0; 2], [0.0; 3]);
        for ring in &rings {
            for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
                let [x, y] = [a[0] - origin[0], a[1] - origin[1]];
                let [u, v] = [b[0] - origin[0], b[1] - origin[1]];
                let cross = x * v - u * y;
                area += cross / 2.0;
                first = [first[0] + cross * (x + u) / 6.0, first[1] + cross * (y + v) / 6.0];
                second[0] += cross * (x * x + x * u + u * u) / 12.0;
                second[1] += cross * (x * v + 2.0 * x * y + 2.0 * u * v + u * y) / 24.0;
                second[2] += cross * (y * y + y * v + v * v) / 12.0;
            }
        }
        let [x, y] = first.map(|v| v / area);
        let [xx, xy, yy] = second.map(|v| v / area);
        let (large, small, angle) = principal([xx - x * x, xy - x * y, yy - y * y]);
        // a disc of radius a has the second moment a²/4
        let [semi_major, semi_minor] = [large, small].map(|v| 2.0 * v.max(0.0).sqrt());
        Self { rings, area, semi_major, semi_minor, orientation: bearing(angle) }
    }

    /// An outline without lines; all numbers are nan.
    pub fn empty() -> Self {
        let nan = f64::NAN;
        let rings = Vec::new();
        Self { rings, area: nan, semi_major: nan, semi_minor: nan, orientation: nan }
    }

    /// Moves the lines.
    pub(in crate::location) fn shift(&mut self, by: [f64; 2]) {
        for corner in self.rings.iter_mut().flatten() {
            *corner = [corner[0] + by[0], corner[1] + by[1]];
        }
    }
}

/// Returns the azimuth, from 0 to π, of an axis at this angle anticlockwise from east.
pub(in crate::location) fn bearing(angle: f64) -> f64 {
    (0.5 * PI - angle).rem_euclid(PI)
}

/// Returns the eigenvalues of a symmetric matrix `[a, b; b, c]`, the larger one first, and the
/// direction of its eigenvector anticlockwise from the first axis.
pub(in crate::location) fn principal([a, b, c]: [f64; 3]) -> (f64, f64, f64) {
    let (mean, half) = (0.5 * (a + c), 0.5 * (a - c));
    let radius = half.hypot(b);
    let small = if mean + radius > 0.0 { (a * c - b * b) / (mean + radius) } else { 0.0 };
    (mean + radius, small, 0.5 * b.atan2(half))
}

/// Part of the area in which a function exceeds a level: all of it, or the part that contains the
/// centre of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::location) enum Part {
    All,
    Centre,
}

/// Returns the contour in a frame at which a function falls below a level, and for each axis whether
/// the frame cuts the contour. O(cells).
pub(in crate::location) fn outline(
    frame: &Frame,
    part: Part,
    level: f64,
    f: impl Fn([f64; 2]) -> f64,
) -> (Outline, [bool; 2]) {
    let mut values: Vec<f64> =
        (0..SIDE * SIDE).map(|at| f(frame.node(at / SIDE, at % SIDE)) - level).collect();
    if part == Part::Centre {
        keep_centre(&mut values);
    }
    let mut cut = [false; 2];
    for at in 0..SIDE {
        for (axis, first, step) in [(0, at, CELLS * SIDE), (1, at * SIDE, CELLS)] {
            for node in [first, first + step] {
                cut[axis] |= values[node] >= 0.0;
                // so that all lines are closed
                values[node] = f64::NEG_INFINITY;
            }
        }
    }
    let next = segments(&values, |i, j| {
        let (a, b) = (frame.node(i, j), frame.node(i + 1, j + 1));
        f([0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]) >= level
    });
    (Outline::of(rings(next, |edge| crossing(frame, &values, edge))), cut)
}

/// Keeps only the part that is connected with the centre.
fn keep_centre(values: &mut [f64]) {
    let mut kept = vec![false; values.len()];
    let mut open = vec![values.len() / 2];
    while let Some(at) = open.pop() {
        if kept[at] || values[at] < 0.0 {
            continue;
        }
        kept[at] = true;
        let (i, j) = (at / SIDE, at % SIDE);
        for k in i.saturating_sub(1)..=(i + 1).min(CELLS) {
            open.extend((j.saturating_sub(1)..=(j + 1).min(CELLS)).map(|l| k * SIDE + l));
        }
    }
    for (value, kept) in values.iter_mut().zip(kept) {
        if !kept {
            *value = value.min(-f64::MIN_POSITIVE);
        }
    }
}

/// Returns the index of the edge from a node to the next one along an axis.
fn edge(i: usize, j: usize, axis: usize) -> usize {
    2 * (i * SIDE + j) + axis
}

/// Returns, for each edge that the contour crosses, the edge where it leaves the square; the inside is
/// to its left.
fn segments(values: &[f64], is_inside: impl Fn(usize, usize) -> bool) -> Vec<usize> {
    let mut next = vec![NONE; 2 * SIDE * SIDE];
    for i in 0..CELLS {
        for j in 0..CELLS {
            let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
            let inside = corners.map(|(i, j)| values[i * SIDE + j] >= 0.0);
            let edges = [edge(i, j, 0), edge(i + 1, j, 1), edge(i, j + 1, 0), edge(i, j, 1)];
            // the contour enters the square at the edge where, anticlockwise, the inside ends
            let leaves = |k: usize| inside[k] && !inside[(k + 1) % 4];
            let enters = |k: usize| !inside[k] && inside[(k + 1) % 4];
            let starts = (0..4).filter(|&k| leaves(k)).count();
            for k in (0..4).filter(|&k| leaves(k)) {
                let end = match starts {
                    1 => (0..4).find(|&k| enters(k)).unwrap_or(k),
                    // at a saddle, around the corner that is not connected with the centre
                    _ if is_inside(i, j) => (k + 1) % 4,
                    _ => (k + 3) % 4,
                };
                next[edges[k]] = edges[end];
            }
        }
    }
    next
}

/// Joins segments to closed lines.
fn rings(mut next: Vec<usize>, crossing: impl Fn(usize) -> [f64; 2]) -> Vec<Vec<[f64; 2]>> {
    let mut rings = Vec::new();
    for start in 0..next.len() {
        let mut ring = Vec::new();
        let mut at = start;
        while next[at] != NONE {
            ring.push(crossing(at));
            at = std::mem::replace(&mut next[at], NONE);
        }
        if ring.len() > 2 {
            rings.push(ring);
        }
    }
    rings
}

/// Returns the point at which the contour crosses an edge.
fn crossing(frame: &Frame, values: &[f64], edge: usize) -> [f64; 2] {
    let (node, axis) = (edge / 2, edge % 2);
    let (i, j) = (node / SIDE, node % SIDE);
    let (k, l) = if axis == 0 { (i + 1, j) } else { (i, j + 1) };
    let (a, b) = (values[node], values[k * SIDE + l]);
    let share = a / (a - b);
    let share = if (a - b).is_finite() { share } else { 0.5 };
    let (a, b) = (frame.node(i, j), frame.node(k, l));
    [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    const FRAME: Frame = Frame { centre: [10.0, 5.0], cosine: 0.8, sine: 0.6, half: [4.0, 4.0] };

    #[test]
    fn an_ellipse() {
        // semi-axes 3 and 1, the longer one towards 0.4 rad anticlockwise from east
        let (sine, cosine) = 0.4_f64.sin_cos();
        let ellipse = |[x, y]: [f64; 2]| {
            let [x, y] = [x - 10.0, y - 5.0];
            -((x * cosine + y * sine) / 3.0).hypot(y * cosine - x * sine)
        };
        let (found, cut) = outline(&FRAME, Part::All, -1.0, ellipse);
        assert_eq!((found.rings.len(), cut), (1, [false; 2]));
        assert_within(2e-3, found.area, 3.0 * PI);
        assert_within(2e-3, found.semi_major, 3.0);
        assert_within(2e-3, found.semi_minor, 1.0);
        assert_within(1e-3, found.orientation, 0.5 * PI - 0.4);
        for corner in &found.rings[0] {
            assert!((ellipse(*corner) + 1.0).abs() < 2e-3);
        }
    }

    #[test]
    fn a_ring_two_islands_and_what_is_cut() {
        let radius = |[x, y]: [f64; 2]| (x - 10.0).hypot(y - 5.0);
        let (ring, _) = outline(&FRAME, Part::All, -0.5, |p| -(radius(p) - 2.0).abs());
        assert_eq!(ring.rings.len(), 2);
        assert_within(5e-3, ring.area, PI * (2.5 * 2.5 - 1.5 * 1.5));
        let islands = |[x, y]: [f64; 2]| -(x - 8.5).hypot(y - 5.0).min((x - 11.5).hypot(y - 5.0));
        let (two, _) = outline(&FRAME, Part::All, -1.0, islands);
        assert_eq!(two.rings.len(), 2);
        assert_within(5e-3, two.area, 2.0 * PI);
        let beside = |[x, y]: [f64; 2]| -(x - 10.5).hypot(y - 5.0).min((x - 7.5).hypot(y - 5.0));
        let (one, _) = outline(&FRAME, Part::Centre, -1.0, beside);
        assert_eq!(one.rings.len(), 1);
        assert_within(5e-3, one.area, PI);
        assert_eq!(outline(&FRAME, Part::All, -9.0, |p| -radius(p)).1, [true; 2]);
        assert!(outline(&FRAME, Part::All, 1.0, |p| -radius(p)).0.rings.is_empty());
    }
}
