//! The side of the plane of the receivers on which emitters are.
//!
//! If the receivers are near a plane, each emission fits almost as well at its mirror image, and emissions
//! that are located one by one may end on either side. A path then jumps from side to side. Such a scene, and
//! one with emissions below its receivers, is solved on each side alone.

use super::super::mirror::{ABOVE, AMBIGUOUS, Mirror};
use super::scene::{Scene, Solution, Undetermined};
use super::solve::solve_beside;

/// Standard deviations by which an emission is certainly on one side.
const SURE: f64 = 3.0;

/// Solves the scene.
///
/// # Errors
/// The measurements do not determine an unknown.
pub fn solve<const D: usize>(scene: &Scene<D>) -> Result<Solution, Undetermined> {
    let (free, cost) = solve_beside(scene, None)?;
    let receivers = &scene.sites[..scene.is_base.len()];
    let Some(mirror) = Mirror::near(receivers, false) else { return Ok(free) };
    let [above, below] = sides(&free, &mirror, receivers);
    // a path on one side needs no choice, unless the other side is likelier beforehand
    if below == 0 || above == 0 && !mirror.is_level {
        return Ok(free);
    }
    let flipped = mirror.flipped();
    let prior = if mirror.is_level { ABOVE } else { 0.0 };
    let solved = [(mirror, 0.0), (flipped, prior)].map(|(mirror, prior)| {
        let (found, cost) = solve_beside(scene, Some(mirror)).ok()?;
        Some((found, cost, prior))
    });
    let costs = [0, 1].map(|i| solved[i].as_ref().map_or(f64::INFINITY, |one| one.1));
    let is_mirrored = (costs[0] - costs[1]).abs() < AMBIGUOUS;
    let mut best = (free, cost, prior);
    for one in solved.into_iter().flatten() {
        if one.1 + one.2 < best.1 + best.2 {
            best = (Solution { is_mirrored, ..one.0 }, one.1, one.2);
        }
    }
    Ok(best.0)
}

/// Counts the emissions that are certainly on the side of the normal, beyond all receivers, and on the other.
fn sides<const D: usize>(
    found: &Solution,
    mirror: &Mirror<D>,
    receivers: &[[f64; D]],
) -> [usize; 2] {
    let off = receivers.iter().map(|site| mirror.distance(site).abs());
    let thick = off.fold(0.0, f64::max);
    let mut counts = [0; 2];
    let n = 3 * D;
    for (mean, covariance) in found.mean.chunks_exact(n).zip(found.covariance.chunks_exact(n * n)) {
        let distance = mirror.distance(&mean[..D]);
        if distance.abs() > thick + SURE * mirror.variance(covariance, n).max(0.0).sqrt() {
            counts[usize::from(distance < 0.0)] += 1;
        }
    }
    counts
}
