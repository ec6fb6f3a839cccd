//! Choice between two paths that are mirror images.

use super::instants::fixes::Fixes;
use super::instants::instant::Instant;
use super::measured::{Measured, Record};
use super::mirror::{ABOVE, AMBIGUOUS, Mirror};
use super::path::failure::Failure;
use super::search::fit::{Found, Setting};
use super::systematic::bias::weights;
use super::systematic::prior::Systematic;
use super::systematic::survey;
use crate::base::angle::median;
use crate::location::Status;
use crate::sensors::KINDS;
use nalgebra::{DMatrix, DVector};
use std::rc::Rc;

/// Size of a residual, in sigmas, above which its cost no longer grows.
const MOST: f64 = 4.0;

/// Gain of ln of the likelihood from which a path that may cross the plane is preferred, and difference from
/// which the other of two paths on either side is wrong.
const LIKELIER: f64 = 10.0;
const FAR: f64 = 20.0;

/// Standard deviation of an error of which nothing is known, in those of the measurement.
const UNKNOWN: f64 = 1e3;

/// Ratio of the costs of two paths up to which either may be right.
const HARDLY_MORE: f64 = 2.0;

/// Knowledge about the side of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Side {
    /// The path is on the correct side.
    Known,
    /// The mirror image of the path explains the measurements as well.
    OneOfTwo,
    /// The path is below a level plane, because no path above it fits.
    Behind,
}

/// The side on which instants are located if they are not compared with a path.
pub(super) struct Choice<const D: usize> {
    pub mirror: Option<Mirror<D>>,
    is_one_of_two: bool,
}

impl<const D: usize> Choice<D> {
    /// Chooses the side by the instants as they are located on their own.
    pub fn new(record: &Record<'_>, fixes: &Fixes) -> Self {
        let is_open = fixes.fixes.iter().any(|fix| fix.status == Status::Ambiguous);
        Self { mirror: Mirror::chosen(record), is_one_of_two: record.initial.is_none() && is_open }
    }

    /// Returns the mirror image of states (N, M), as [`image`] does.
    pub fn image(&self, mean: &[f64], size: usize) -> Result<Option<Vec<f64>>, Failure> {
        let mirror = self.mirror.as_ref().filter(|_| self.is_one_of_two);
        mirror.map(|mirror| mirror.image_of(mean, size)).transpose()
    }
}

/// Returns the path without the measurements that contradict it. If the stations are in a plane, the path is
/// on one side of this plane.
pub(super) fn begin<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    measured: &Rc<Measured<D>>,
    systematic: &Systematic,
) -> Result<(Found<D, N>, Side), Failure> {
    let record = setting.record;
    let on = |setting: &mut Setting<'_, D, N>, mirror: Option<Mirror<D>>, is_wide: bool| {
        Found::sought(setting, measured, mirror, is_wide)
    };
    let Some(mirror) = Mirror::chosen(record) else {
        return Ok((on(setting, None, true)?.0, Side::Known));
    };
    if record.initial.is_some() || mirror.is_exact {
        let side = if record.initial.is_some() { Side::Known } else { Side::OneOfTwo };
        let found = on(setting, Some(mirror.clone()), true);
        // a search may fail on the right side, too; a path near the plane may then still be found
        if found.is_ok() || mirror.is_exact {
            return Ok((found?.0, side));
        }
    }
    let mut sides =
        [on(setting, Some(mirror.clone()), false), on(setting, Some(mirror.flipped()), false)];
    let known = [0, 1].map(|at| sides[at].as_ref().map_or(0, |(found, _)| known(found, record)));
    for at in 0..2 {
        // a path on the wrong side may consist of a few instants that happen to be there
        if sides[at].is_ok() && 2 * known[at] < known[1 - at] {
            sides[at] = Err(Failure::Diverged);
        }
    }
    let values = [0, 1].map(|at| sides[at].as_ref().ok().and_then(|one| one.1));
    if let Some(likeliest) = values.into_iter().flatten().reduce(f64::max) {
        // the path may cross the plane, and so does the wide search
        if let Ok((free, Some(value))) = on(setting, None, true)
            && value > likeliest + LIKELIER
        {
            let is_behind = |t: usize| mirror.distance(free.path.position::<D>(t)) < 0.0;
            let behind = (0..record.len()).filter(|&t| is_behind(t)).count();
            let own = match behind {
                0 => Some((0, mirror.clone())),
                _ if behind == record.len() => Some((1, mirror.flipped())),
                _ => None,
            };
            let own = own.map(|(at, side)| (at, on(setting, Some(side), true)));
            match own {
                Some((at, Ok((found, Some(one))))) if one > value - LIKELIER => {
                    sides[at] = Ok((found, Some(one)));
                }
                _ => return Ok((free, Side::Known)),
            }
        }
    }
    if !mirror.is_level {
        // a search may fail on the side on which the target is
        for at in 0..2 {
            if sides[at].is_err()
                && let Ok((found, _)) = &sides[1 - at]
                && let Ok(image) = found.image(setting, measured)
            {
                sides[at] = Ok((image, None));
            }
        }
    }
    let costs = [0, 1].map(|at| {
        let own = sides[at].as_ref().ok();
        own.map_or(f64::INFINITY, |(found, _)| cost(record, found, systematic))
    });
    if values == [None, None]
        && is_lost(&sides, costs)
        && let Ok((free, _)) = on(setting, None, true)
        && cost(record, &free, systematic) + LIKELIER < costs[0].min(costs[1])
    {
        return Ok((free, Side::Known));
    }
    let [path, image] = sides;
    let ((path, value), (image, other)) = match (path, image) {
        (Ok(path), Ok(image)) => (path, image),
        (Ok(path), Err(_)) => return Ok((path.0, Side::Known)),
        (Err(_), image) if mirror.is_level && record.initial.is_none() => {
            return Ok((image?.0, Side::Behind));
        }
        (Err(_), image) => return Ok((image?.0, Side::Known)),
    };
    if let Some((value, other)) = value.zip(other)
        && (value - other).abs() > FAR
    {
        return Ok((if value > other { path } else { image }, Side::Known));
    }
    let more = costs[1] - costs[0];
    let odds = if mirror.is_level { ABOVE } else { 0.0 };
    if more < -AMBIGUOUS - odds {
        return Ok((image, Side::Known));
    }
    Ok((path, if more < AMBIGUOUS { Side::OneOfTwo } else { Side::Known }))
}

/// Number of instants at which a path is known.
fn known<const D: usize, const N: usize>(found: &Found<D, N>, record: &Record<'_>) -> usize {
    let is_known = |t: &usize| !found.path.position::<D>(*t).iter().any(|p| p.is_nan());
    (0..record.len()).filter(is_known).count()
}

/// Whether the cheaper of two paths was far from the target while it was sought, or the other one was and is
/// hardly more expensive.
fn is_lost<T, const D: usize, const N: usize>(
    sides: &[Result<(Found<D, N>, T), Failure>; 2],
    costs: [f64; 2],
) -> bool {
    let was_far = |at: usize| sides[at].as_ref().is_ok_and(|(found, _)| found.was_far);
    let best = usize::from(costs[1] < costs[0]);
    was_far(best) || was_far(1 - best) && costs[1 - best] < HARDLY_MORE * costs[best]
}

/// Half the sum of the squared residuals. Columns that are not trusted may have constant errors of the stated
/// size, all or none of them, whichever is likelier: each costs its square and, as it is determined by all
/// residuals of its column, the ratio of its prior standard deviation to the one that remains (Laplace's
/// approximation). Errors of stations that may be elsewhere than surveyed change along the path.
fn cost<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
    systematic: &Systematic,
) -> f64 {
    if record.surveys.is_some() {
        return cost_with_surveys(record, found, systematic);
    }
    let width = record.width();
    let mut residuals = vec![Vec::new(); width];
    for t in 0..record.len() {
        for (m, row, _) in found.rows(t).filter(|(_, row, _)| !row.residual.is_nan()) {
            residuals[found.measured.column[m]].push(row.residual);
        }
    }
    let (mut without, mut with) = (0.0, 0.0);
    for (column, own) in residuals.iter_mut().enumerate().filter(|(_, own)| !own.is_empty()) {
        let sum = |own: &[f64], constant: f64| -> f64 {
            0.5 * own.iter().map(|r| (r - constant).powi(2).min(MOST * MOST)).sum::<f64>()
        };
        let none = sum(own, 0.0);
        without += none;
        with += if systematic.is_trusted(column, width / KINDS) {
            none
        } else {
            let constant = median(own);
            sum(own, constant) + 0.5 * (constant * constant + (own.len() as f64).ln_1p())
        };
    }
    f64::min(without, with)
}

/// As [`cost`], with the errors of all stations and columns together. The smoothness of the path is not used.
fn cost_with_surveys<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
    systematic: &Systematic,
) -> f64 {
    let (errors, prior) = systematic_errors(record, found, systematic);
    let (mut without, mut with) = (0.0, prior);
    for t in 0..record.len() {
        for (m, row, _) in found.rows(t).filter(|(_, row, _)| !row.residual.is_nan()) {
            let error = errors[t * record.width() + found.measured.column[m]];
            let capped = |residual: f64| 0.5 * residual.powi(2).min(MOST * MOST);
            without += capped(row.residual);
            with += capped(row.residual - error * found.measured.precision(m));
        }
    }
    f64::min(without, with)
}

/// Returns the part of the residuals (N, 5 K) that the likeliest systematic errors explain with the positions of
/// the instants free, and what these errors cost: their squares, and the ratios of their prior standard
/// deviations to those that remain (Laplace's approximation).
fn systematic_errors<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
    systematic: &Systematic,
) -> (Vec<f64>, f64) {
    let width = record.width();
    let (weight, _) = weights(record, found, &vec![0.0; width]);
    let instants: Vec<Instant<D>> =
        (0..record.len()).map(|t| found.instant(t, &weight, &[])).collect();
    let rows = || instants.iter().flat_map(|own| &own.rows);
    let constant = |column: usize| {
        let sigma = match systematic.sigma(column, record) {
            0.0 => record.sigmas[column],
            stated => stated.min(UNKNOWN * record.sigmas[column]),
        };
        let error = |at| if at % width == column { sigma } else { 0.0 };
        (0..record.len() * width).map(error).collect::<Vec<f64>>()
    };
    let free = (0..width).filter(|&column| !systematic.is_trusted(column, width / KINDS));
    let free = free.filter(|column| rows().any(|row| row.0 == *column)).map(constant);
    let surveyed = record.surveys.into_iter().flat_map(|own| survey::effects(record, found, own));
    let left: Vec<DVector<f64>> = free
        .chain(surveyed)
        .map(|errors| {
            let own = instants.iter().zip(errors.chunks_exact(width));
            let own: Vec<f64> = own.flat_map(|(one, errors)| one.unexplained(errors)).collect();
            DVector::from_vec(own)
        })
        .collect();
    let mut errors = vec![0.0; record.len() * width];
    if left.is_empty() {
        return (errors, 0.0);
    }
    let left = DMatrix::from_columns(&left);
    let mut weighted = left.clone();
    for (mut own, row) in weighted.row_iter_mut().zip(rows()) {
        own *= row.1;
    }
    let residual = DVector::from_iterator(left.nrows(), rows().map(|row| row.2));
    let information = left.tr_mul(&weighted) + DMatrix::identity(left.ncols(), left.ncols());
    let Some(factor) = information.cholesky() else { return (errors, f64::INFINITY) };
    let likeliest = factor.solve(&weighted.tr_mul(&residual));
    let explained = left * &likeliest;
    let places = instants.iter().enumerate();
    let places = places.flat_map(|(t, own)| own.rows.iter().map(move |row| t * width + row.0));
    places.zip(&explained).for_each(|(at, one)| errors[at] = *one);
    (errors, 0.5 * likeliest.norm_squared() + factor.l().diagonal().map(f64::ln).sum())
}

/// Returns the mirror image of a path (N, 3D), if either of the two may be right. It is an error if
/// neither is above the other.
pub(super) fn image<const D: usize, const N: usize>(
    found: &Found<D, N>,
    mean: &[f64],
    side: Side,
) -> Result<Option<Vec<f64>>, Failure> {
    let Some(sides) =
        found.sides.as_ref().filter(|own| side == Side::OneOfTwo && own.is_apart(mean, N))
    else {
        return Ok(None);
    };
    sides.mirror.image_of(mean, N).map(Some)
}
