//! Starting points of searches.
//!
//! Without beacons, clocks are known only as far as the average distances from the receivers are. Emissions
//! that are located one by one with wrong clocks may lead to a path that fits badly, but that small changes
//! make worse. If all emissions start at one place, path and clocks spread out together, which rarely ends
//! there, but errs more with few arrivals. In the plane, searches therefore start both ways, and then from other
//! places, until the likeliest path has been found twice.

use super::problem::Problem;
use nalgebra::DMatrix;

/// Distance of the first place from the centre of the receivers along each of their axes, relative to their
/// largest extent: at the centre, or in the plane of the receivers, derivatives might vanish.
const ASIDE: f64 = 0.03;

/// How a search starts.
#[derive(Clone, Copy, Debug)]
pub(super) enum Start<const D: usize> {
    /// Each emission is located on its own.
    Apart,
    /// All emissions of moving identities come from this place.
    Together([f64; D]),
}

impl<const D: usize> Problem<'_, D> {
    /// Returns the starting points, those first that usually suffice.
    pub fn starts(&self) -> Vec<Start<D>> {
        // in space, images of a part of the emitters in the plane of the receivers would be found, which may be
        // likelier by chance
        if D > 2 || self.mirror.is_some() || self.layout.motion.iter().all(Option::is_none) {
            return vec![Start::Apart];
        }
        let (centre, axes) = self.axes();
        let longest = axes.iter().flatten().map(|x| x * x).sum::<f64>().sqrt();
        let aside = |i: usize| {
            let size = |axis: &[f64; D]| axis.iter().map(|x| x * x).sum::<f64>().sqrt();
            let of = |axis: &[f64; D]| axis[i] / size(axis).max(f64::MIN_POSITIVE);
            ASIDE * longest * axes.iter().map(of).sum::<f64>()
        };
        let first: [f64; D] = std::array::from_fn(|i| centre[i] + aside(i));
        let along = |axis: &[f64; D], sign: f64| {
            Start::Together(std::array::from_fn(|i| first[i] + sign * axis[i]))
        };
        let others = axes.iter().flat_map(|axis| [along(axis, 1.0), along(axis, -1.0)]);
        [Start::Apart, Start::Together(first)].into_iter().chain(others).collect()
    }

    /// Returns the centre of the receivers, and the principal axes of their positions, the shortest first. The
    /// length of an axis is the standard deviation along it.
    fn axes(&self) -> ([f64; D], [[f64; D]; D]) {
        let sites = &self.scene.sites[..self.scene.is_base.len()];
        let count = sites.len() as f64;
        let mean = |of: &dyn Fn(&[f64; D]) -> f64| sites.iter().map(of).sum::<f64>() / count;
        let centre: [f64; D] = std::array::from_fn(|i| mean(&|site| site[i]));
        let spread = |i: usize, j: usize| mean(&|s| (s[i] - centre[i]) * (s[j] - centre[j]));
        let eigen = DMatrix::from_fn(D, D, spread).symmetric_eigen();
        let mut order: [usize; D] = std::array::from_fn(|at| at);
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let axis = |at: usize| {
            let own: [f64; D] = std::array::from_fn(|i| eigen.eigenvectors[(i, at)]);
            let largest =
                own.iter().fold(0.0, |most: f64, x| if x.abs() > most.abs() { *x } else { most });
            let length = eigen.eigenvalues[at].max(0.0).sqrt().copysign(largest);
            own.map(|x| length * x)
        };
        (centre, order.map(axis))
    }
}
