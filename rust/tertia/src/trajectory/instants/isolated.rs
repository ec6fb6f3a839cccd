//! Locations of single instants that are far from those before and after.
//!
//! If a few wrong measurements agree with others by chance, an instant may be located kilometres from the target,
//! as on the other side of the stations. With one such location, the motion that is estimated about the first path
//! is so agile that the path follows all other wrong locations, too.

use super::fixes::Fixes;
use crate::base::angle::median;
use crate::base::small::{Vector, norm};
use crate::location::{Fix, Status};
use crate::trajectory::measured::Record;

/// Least number of located instants, and the largest share of them that may be isolated.
const ENOUGH: usize = 20;
const MOST: f64 = 0.2;
/// Distance from the line between the instants before and after, in units of the typical one, beyond which a
/// location is isolated.
const FAR: f64 = 20.0;
/// Number of times that locations are compared with those that are left.
const ROUNDS: usize = 3;

/// An isolated location, the place between its neighbours, and how far from there it may be.
struct Isolated<const D: usize> {
    t: usize,
    between: Vector<D>,
    limit: f64,
}

impl Fixes {
    /// Locates isolated instants again, with a search from between their neighbours. Those that stay far from
    /// there have no location.
    pub(in crate::trajectory) fn move_isolated<const D: usize>(
        &mut self,
        record: &Record<'_>,
        values: &[f64],
    ) {
        let isolated = self.isolated::<D>(record);
        if isolated.is_empty() {
            return;
        }
        let open: Vec<usize> = isolated.iter().map(|own| own.t).collect();
        let initial: Vec<f64> = isolated.iter().flat_map(|own| own.between).collect();
        self.relocate_from::<D>(record, &open, values, &initial);
        for Isolated { t, between, limit } in isolated {
            // nan is not near
            let is_near = norm(&self.off::<D>(t, &between)) <= limit;
            if !is_near {
                self.position[t * D..][..D].fill(f64::NAN);
                self.covariance[t * D * D..][..D * D].fill(f64::NAN);
                self.fixes[t] = Fix { status: Status::Ambiguous, ..Fix::UNKNOWN };
            }
        }
    }

    /// Returns the isolated locations; none if there are too many.
    fn isolated<const D: usize>(&self, record: &Record<'_>) -> Vec<Isolated<D>> {
        let located: Vec<usize> = (0..record.len()).filter(|&t| self.is_located(t)).collect();
        if located.len() < ENOUGH {
            return Vec::new();
        }
        let time = record.time;
        let triples = |own: &[usize]| -> Vec<(usize, Vector<D>, f64)> {
            own.windows(3)
                .map(|at| (at[1], self.between(time, at), time[at[2]] - time[at[0]]))
                .collect()
        };
        let first = triples(&located);
        let distance =
            |(t, between, _): &(usize, Vector<D>, f64)| norm(&self.off::<D>(*t, between));
        let sigma = |t: &usize| {
            let own = &self.covariance[t * D * D..][..D * D];
            (own.iter().step_by(D + 1).sum::<f64>() / D as f64).sqrt()
        };
        let typical = median(&mut first.iter().map(distance).collect::<Vec<f64>>());
        let unit = typical.max(median(&mut located.iter().map(sigma).collect::<Vec<f64>>()));
        let usual = median(&mut first.iter().map(|own| own.2).collect::<Vec<f64>>());
        // a motion bends a path by up to the square of the time
        let limit = |gap: f64| FAR * unit * (gap / usual).max(1.0).powi(2);
        let (mut left, mut found) = (located.clone(), Vec::new());
        for _ in 0..ROUNDS {
            let all = triples(&left);
            let size: Vec<f64> = all.iter().map(distance).collect();
            // the neighbours of a wrong location seem to be wrong as well
            let is_largest = |at: usize| {
                let before = at.checked_sub(1).map_or(0.0, |before| size[before]);
                size[at] >= before && size[at] >= size.get(at + 1).copied().unwrap_or(0.0)
            };
            let is_far = |at: &usize| size[*at] > limit(all[*at].2) && is_largest(*at);
            let far: Vec<usize> = (0..all.len()).filter(is_far).collect();
            if far.is_empty() {
                break;
            }
            found.extend(far.iter().map(|&at| Isolated {
                t: all[at].0,
                between: all[at].1,
                limit: limit(all[at].2),
            }));
            left.retain(|t| !found.iter().any(|own| own.t == *t));
        }
        if found.len() as f64 > MOST * located.len() as f64 { Vec::new() } else { found }
    }

    /// Returns the place at the time of the second instant on the line between the others.
    fn between<const D: usize>(&self, time: &[f64], at: &[usize]) -> Vector<D> {
        let whole = time[at[2]] - time[at[0]];
        let share = if whole > 0.0 { (time[at[1]] - time[at[0]]) / whole } else { 0.5 };
        let of = |t: usize, i: usize| self.position[t * D + i];
        std::array::from_fn(|i| of(at[0], i) + share * (of(at[2], i) - of(at[0], i)))
    }

    fn off<const D: usize>(&self, t: usize, from: &Vector<D>) -> Vector<D> {
        std::array::from_fn(|i| self.position[t * D + i] - from[i])
    }
}
