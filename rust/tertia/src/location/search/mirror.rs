//! The line or plane that is nearest to the stations, and its sides.

use crate::base::small::{Factor, Matrix, Vector, add_outer, dot, longest, quadratic};
use crate::sensors::{Kind, Measurement};

/// Largest distance of the stations from their plane, as a share of their distances within it (root mean
/// squares of one coordinate). If it is larger, the measurements distinguish mirror images.
const THIN: f64 = 0.3;
/// Smallest variance of the stations across their plane, as a share of the whole.
const FLAT: f64 = 1e-12;
/// Axis of the height.
const UP: usize = 2;

/// The line or plane that is nearest to stations.
#[derive(Clone, Copy)]
pub(in crate::location) struct Mirror<const D: usize> {
    middle: Vector<D>,
    normal: Vector<D>,
    /// Sums of the squared distances of the stations from the plane, and within it from the middle.
    across: f64,
    along: f64,
}

/// A side of a plane, and its prior odds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::location) struct Side {
    /// The direction to the likely side. In two dimensions, the last coordinate is 0.
    normal: [f64; 3],
    /// A point of the plane.
    middle: [f64; 3],
    /// Logarithm of the odds.
    log_odds: f64,
}

impl<const D: usize> Mirror<D> {
    /// O(K) for K stations.
    pub fn of(stations: impl Iterator<Item = Vector<D>> + Clone) -> Self {
        let (mut middle, mut count) = ([0.0; D], 0.0);
        for station in stations.clone() {
            (0..D).for_each(|i| middle[i] += station[i]);
            count += 1.0;
        }
        middle = middle.map(|v| v / count);
        let (mut spread, mut total): (Matrix<D>, f64) = ([[0.0; D]; D], 0.0);
        for station in stations {
            let offset: Vector<D> = std::array::from_fn(|i| station[i] - middle[i]);
            total += dot(&offset, &offset);
            add_outer(&mut spread, 1.0, &offset);
        }
        let mut raised = spread;
        (0..D).for_each(|i| raised[i][i] += FLAT * total);
        let upright = std::array::from_fn(|i| if i + 1 == D { 1.0 } else { 0.0 });
        let normal = Factor::try_new(&raised, 0.0).map_or(upright, |f| longest(&f.inverse()).0);
        let across = quadratic(&spread, &normal);
        Self { middle, normal, across, along: total - across }
    }

    /// Returns the distance of a position from the plane; negative on one side.
    pub fn height(&self, p: &[f64]) -> f64 {
        (0..D).map(|i| self.normal[i] * (p[i] - self.middle[i])).sum()
    }

    /// Whether the stations are so near the plane that a position and its mirror image look alike.
    pub fn is_thin(&self) -> bool {
        self.across < THIN * THIN * self.along / (D - 1) as f64
    }

    /// Returns the root mean square of a coordinate of the stations within the plane.
    pub fn width(&self, stations: usize) -> f64 {
        (self.along / ((D - 1) * stations) as f64).sqrt()
    }

    /// Returns the place in the plane, of this size, that is nearest to a position.
    pub fn place(&self, p: &[f64], size: f64) -> [i64; D] {
        let height = self.height(p);
        let within = |i: usize| p[i] - self.middle[i] - height * self.normal[i];
        std::array::from_fn(|i| (within(i) / size).round() as i64)
    }

    pub fn side(&self, sign: f64, log_odds: f64) -> Side {
        let wide = |v: &Vector<D>| std::array::from_fn(|i| if i < D { v[i] } else { 0.0 });
        Side { normal: wide(&self.normal.map(|v| sign * v)), middle: wide(&self.middle), log_odds }
    }
}

impl Side {
    /// Returns the prior cost of a position relative to `origin`: 0 on the likely side.
    pub fn cost(&self, p: &[f64], origin: &[f64]) -> f64 {
        let along = |i: usize| self.normal[i] * (p[i] + origin[i] - self.middle[i]);
        let height: f64 = (0..origin.len()).map(along).sum();
        if height < 0.0 { self.log_odds } else { 0.0 }
    }
}

/// Returns the mirror images of a state: in the line or plane that is nearest to the stations, with elevations
/// or heights in the nearest vertical plane, and with azimuths in the level plane. If the stations lie in such
/// a plane, their measurements of both positions are the same. O(M).
pub(in crate::location) fn images<const D: usize, const N: usize>(
    measurements: &[Measurement<D>],
    state: &Vector<N>,
) -> impl Iterator<Item = Vector<N>> {
    let places = measurements.iter().map(|m| m.station);
    let nearest = Mirror::of(places.clone());
    let has = |kind: Kind| D == UP + 1 && measurements.iter().any(|m| m.kind == kind);
    let lift =
        |level: Vector<2>, up: f64| std::array::from_fn(|i| if i < UP { level[i] } else { up });
    let upright = (has(Kind::Elevation) || has(Kind::Height)).then(|| {
        let plan = Mirror::<2>::of(places.map(|p| [p[0], p[1]]));
        Mirror { normal: lift(plan.normal, 0.0), middle: lift(plan.middle, 0.0), ..nearest }
    });
    let level = has(Kind::Azimuth).then(|| Mirror { normal: lift([0.0; 2], 1.0), ..nearest });
    let state = *state;
    [Some(nearest), upright, level].into_iter().flatten().map(move |mirror| {
        let twice = 2.0 * mirror.height(&state);
        std::array::from_fn(|i| state[i] - if i < D { twice * mirror.normal[i] } else { 0.0 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::base::small::norm;

    #[test]
    fn mirror_images_have_the_same_distances_from_stations_in_a_plane() {
        let at = |x: f64, y: f64| [x, y, 0.3 * x - 0.2 * y + 40.0];
        let stations = [at(0.0, 0.0), at(900.0, 50.0), at(300.0, 800.0), at(-500.0, 400.0)];
        let measured: Vec<_> =
            stations.iter().map(|s| Measurement::new(Kind::Range, 0, *s, 0.0, 1.0)).collect();
        let p = [100.0, 200.0, 700.0];
        let image: Vector<3> = images(&measured, &p).next().unwrap();
        for s in stations {
            let of = |p: Vector<3>| norm(&std::array::from_fn::<_, 3, _>(|i| p[i] - s[i]));
            assert_within(1e-9, of(image), of(p));
        }
        assert!(image[2] < -400.0, "{image:?}");
    }

    #[test]
    fn mirror_images_have_the_same_elevations_from_stations_in_line() {
        let stations = [[0.0, 0.0, 30.0], [900.0, 600.0, 10.0]];
        let kinds = [Kind::Range, Kind::Elevation];
        let all = kinds.iter().flat_map(|kind| stations.map(|s| (*kind, s)));
        let measured: Vec<_> =
            all.map(|(kind, s)| Measurement::new(kind, 0, s, 0.1, 1.0)).collect();
        let p = [100.0, 500.0, 700.0];
        let image: Vector<3> = images(&measured, &p).nth(1).unwrap();
        assert!(image[0] > 400.0 && image[2] == p[2], "{image:?}");
        for m in measured {
            assert_within(1e-9, m.row(&image).residual, m.row(&p).residual);
        }
    }
}
