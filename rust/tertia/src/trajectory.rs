//! Trajectory: positions over time from the measurements of several stations, some of which may be wrong.
//!
//! [`reconstruct`] locates every instant on its own and smooths the positions. Measurements that contradict
//! the smooth path are left out, positions are linearised about the path, and systematic errors of the
//! stations are estimated from contradictions between stations. [`by_polynomials`] smooths the positions
//! without a motion model, [`temporal_first`] smooths the measurements of each station. Cost O(N K),
//! and up to O(K³) for each size of systematic errors that is tried.
//!
//! The parts, in an order in which each uses only those above it:
//!
//! | part | content |
//! |---|---|
//! | `measured` | the measurements of a record |
//! | `path` | smoothed positions over time |
//! | `mirror` | stations in a plane, for which a path and its mirror image look alike |
//! | `arrivals` | emitters, receivers and their clocks from times of arrival |
//! | `instants` | locations of single instants |
//! | `search` | the path that fits all measurements except outliers |
//! | `systematic` | systematic errors of the stations, constant or lasting |
//! | `images` | which of two mirror images is right |
//! | `methods` | results, and paths without a model of motion |
//! | `corrections` | records that are not as stated: clocks, repeated measurements, too small sigmas |

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

pub mod arrivals;
mod corrections;
mod images;
mod instants;
mod measured;
mod methods;
mod mirror;
mod path;
mod search;
mod systematic;

pub use instants::fixes::Fixes;
pub use measured::Record;
pub use methods::result::{Smoothed, Trajectory};
pub use methods::spatial::by_polynomials;
pub use methods::temporal::temporal_first;
pub use path::failure::Failure;
pub use path::series::Polynomials;
pub use systematic::lasting::LastingErrors;
pub use systematic::prior::{Prior, Systematic};

use crate::base::angle::median;
use crate::sensors::{KINDS, Kind};
use crate::smoothing::ProcessNoise;
use corrections::differences::Received;
use corrections::ranges::Proportional;
use corrections::repeated::Thinned;
use corrections::{clocks, growth, partly_wrong};
use images::Side;
use measured::{Measured, bending, extent, seen};
use methods::{motion, result::residuals};
use path::Path;
use search::fit::{Found, Setting};
use std::rc::Rc;
use systematic::bias::{self, Biases};
use systematic::lasting::{self, Lasting};
use systematic::{speed, survey};

/// Largest number of rounds near the plane of the stations, where derivatives depend on the uncertainty of
/// the states.
const BESIDE: usize = 3;
/// Largest number of shortened last steps.
const LAST: usize = 20;
/// Median standard deviation of a position, relative to the distance over which the stations are spread, beyond
/// which measurements without ranges do not determine a path.
const FARTHEST: f64 = 1e5;
/// Number of steps towards the path with a vertical motion of its own.
const REFITS: usize = 2;
/// Largest number of rounds in which biases are estimated.
const ROUNDS: usize = 10;
/// Largest number of times that a path is estimated with errors of ranges that grow with the range.
const AGAIN: usize = 3;
/// Distance by which the motion of a second search bends a path in the time of the record, relative to the
/// distance between the stations. A motion that is too agile makes the covariance larger, one that is too
/// smooth makes it wrong.
const AGILE: f64 = 10.0;

/// Locates every instant, smooths the positions, and removes systematic errors as far as they can be
/// estimated. Repeated measurements and columns that are wrong throughout are left out. Where errors of ranges
/// are found to grow with the range, or those of a kind to be far larger than stated, the path is estimated again
/// with such standard deviations. N is 3 D.
///
/// # Errors
/// No instant can be located, the measurements do not determine the biases, or no path was found that agrees
/// with them.
pub fn reconstruct<const D: usize, const N: usize>(
    record: &Record<'_>,
    jerk: Option<f64>,
    systematic: &Systematic,
) -> Result<Trajectory, Failure> {
    let solve = |record: &Record<'_>| proportional::<D, N>(record, jerk, systematic);
    let Some(thinned) = Thinned::without_repeats(record) else {
        return growth::with_larger_errors(record, solve);
    };
    let found = growth::with_larger_errors(&thinned.record(record), solve)?;
    Ok(thinned.restored::<D, N>(record, found))
}

/// Reconstructs a path, again with standard deviations of ranges that grow with the range if their errors do.
fn proportional<const D: usize, const N: usize>(
    record: &Record<'_>,
    jerk: Option<f64>,
    systematic: &Systematic,
) -> Result<Trajectory, Failure> {
    let mut found = as_arrivals::<D, N>(record, jerk, systematic)?;
    let mut last = None;
    for _ in 0..AGAIN {
        let Some(grown) = Proportional::of::<D, N>(record, last.as_ref(), &found) else { break };
        let again = as_arrivals::<D, N>(&grown.record(record), jerk, systematic);
        let Ok(again) = again else { break };
        found = Trajectory { relative_range_sigma: Some(grown.relative), ..again };
        last = Some(grown);
    }
    Ok(found)
}

/// Reconstructs a path from arrivals instead of range differences.
fn as_arrivals<const D: usize, const N: usize>(
    record: &Record<'_>,
    jerk: Option<f64>,
    systematic: &Systematic,
) -> Result<Trajectory, Failure> {
    let Some(received) = Received::of(record, systematic) else {
        return without_wrong::<D, N>(record, jerk, systematic);
    };
    let found = without_wrong::<D, N>(&received.record(record), jerk, &received.systematic)?;
    Ok(received.restored(record, found))
}

/// Reconstructs a path without columns that are wrong throughout.
fn without_wrong<const D: usize, const N: usize>(
    record: &Record<'_>,
    jerk: Option<f64>,
    systematic: &Systematic,
) -> Result<Trajectory, Failure> {
    let Some(thinned) = Thinned::without_wrong::<D>(record, systematic) else {
        let solve = |record: &Record<'_>| sought::<D, N>(record, jerk, systematic);
        return Ok(partly_wrong::without_wrong::<D, N>(record, solve(record)?, solve));
    };
    let found = sought::<D, N>(&thinned.record(record), jerk, systematic)?;
    Ok(thinned.restored::<D, N>(record, found))
}

/// Reconstructs a path with this motion, or with the likeliest one; if it is far from the target, again from an
/// agile motion.
fn sought<const D: usize, const N: usize>(
    record: &Record<'_>,
    jerk: Option<f64>,
    systematic: &Systematic,
) -> Result<Trajectory, Failure> {
    if jerk.is_some() {
        return along::<D, N>(record, jerk.map(ProcessNoise::with_jerk), systematic);
    }
    let found = match along::<D, N>(record, None, systematic) {
        Ok(found) if found.has_diverged() => Err(Failure::Diverged),
        Ok(found) if is_unbounded::<D>(record, &found) => Err(Failure::Unbounded),
        found => found,
    };
    if !matches!(found, Err(Failure::Diverged | Failure::Unbounded)) {
        return found;
    }
    // the motion was estimated about a path far from the target
    let second = agile::<D>(record).map(|motion| along::<D, N>(record, Some(motion), systematic));
    match second {
        Some(Ok(second)) if second.explains() && !is_unbounded::<D>(record, &second) => {
            Ok(second.with_doubtful_motion())
        }
        _ => found,
    }
}

/// Reconstructs a path with this motion; none: with the likeliest one.
fn along<const D: usize, const N: usize>(
    record: &Record<'_>,
    motion: Option<ProcessNoise>,
    systematic: &Systematic,
) -> Result<Trajectory, Failure> {
    let mut setting = Setting { record, motion, smoother: Default::default() };
    let measured = Rc::new(Measured::<D>::new(record, record.values.to_vec()));
    let (found, side) = images::begin::<D, N>(&mut setting, &measured, systematic)?;
    let systematic = &systematic.with_surveys(record, &found);
    if clocks::are_right(record, systematic) {
        return completed(setting, found, side, systematic);
    }
    let (timed, found) = clocks::settled(&mut setting, found, systematic)?;
    let record = timed.record(record);
    let setting = Setting { record: &record, motion, smoother: setting.smoother };
    completed(setting, found, side, systematic).map(|found| timed.restored(found))
}

/// Returns the motion of a second search; none if the stations are at one place.
fn agile<const D: usize>(record: &Record<'_>) -> Option<ProcessNoise> {
    bending::<D>(record).map(|jerk| ProcessNoise::with_jerk(AGILE * AGILE * jerk))
}

/// Whether the measurements, none of which is a range, leave it open how far the path is from the stations.
fn is_unbounded<const D: usize>(record: &Record<'_>, found: &Trajectory) -> bool {
    let (n, extent) = (3 * D, extent::<D>(record));
    let has_ranges = !seen(record, &[Kind::Range as usize]).is_empty();
    let known = found.covariance.chunks_exact(n * n).filter(|own| own[0].is_finite());
    let mut sigmas: Vec<f64> =
        known.map(|own| (0..D).map(|i| own[i * (n + 1)]).sum::<f64>().sqrt()).collect();
    extent > 0.0 && !has_ranges && !sigmas.is_empty() && median(&mut sigmas) > FARTHEST * extent
}

/// Removes systematic errors from the measurements of a path, and collects the results.
fn completed<const D: usize, const N: usize>(
    mut setting: Setting<'_, D, N>,
    found: Found<D, N>,
    side: Side,
    systematic: &Systematic,
) -> Result<Trajectory, Failure> {
    let record = setting.record;
    let (mut found, effect) = match systematic {
        Systematic::Flat(kinds) => {
            let columns = seen(record, kinds);
            let (found, biases) = bias::rounds(&mut setting, found, &columns, ROUNDS)?;
            (found, biases.map(|biases| Effect::Biases(biases, kinds)))
        }
        Systematic::Lasting(prior) => {
            let (found, lasting) = lasting::rounds(&mut setting, found, prior)?;
            (found, lasting.map(|lasting| Effect::Lasting(lasting, prior)))
        }
    };
    let scale = effect.as_ref().and_then(Effect::noise).unwrap_or(found.scale);
    let mut states = States::new(&mut setting, &mut found, systematic, effect.as_ref(), scale)?;
    for _ in 0..BESIDE {
        let Some(sides) = found.sides.as_mut().filter(|own| own.is_near(&states.best.mean, N))
        else {
            break;
        };
        sides.learn_systematic(&states.covariance, &states.random, N);
        states = States::new(&mut setting, &mut found, systematic, effect.as_ref(), scale)?;
    }
    let States { best, innovation, mut covariance, .. } = states;
    if let Some(sides) = &found.sides {
        // a path that is not apart from its image has no image in the result
        let is_open = side == Side::OneOfTwo && !sides.mirror.is_exact;
        let is_open = is_open && !sides.is_apart(&best.mean, N);
        sides.add_doubt(&best.mean, &mut covariance, N, is_open);
    }
    covariance.chunks_exact_mut(N * N).for_each(symmetrise::<N>);
    let may_cross =
        found.sides.as_ref().is_some_and(|own| own.may_cross && own.is_apart(&best.mean, N));
    let image = images::image(&found, &best.mean, side)?;
    let left_out = |at: usize| found.measured.values[at].is_nan() && !record.values[at].is_nan();
    let outlier: Vec<bool> =
        (0..found.trust.len()).map(|at| found.is_outlier(at) || left_out(at)).collect();
    let fixes = found.fixes.without(record, &found.measured, |at| found.trust[at] < 0.5);
    let value =
        |at: usize| if left_out(at) { record.values[at] } else { found.measured.values[at] };
    let values: Vec<f64> = (0..record.values.len()).map(value).collect();
    let residual = residuals::<D, N>(record, values, &best.mean, &outlier);
    Ok(Trajectory {
        covariance,
        smoothed: Some(Smoothed {
            covariance: best.covariance,
            innovation,
            summary: best.summary,
            fit: best.fit,
            ln_spread: found.plots.ln_spread(D),
        }),
        mean: best.mean,
        outlier,
        residual,
        bias: effect.map(|effect| effect.by_station(record)),
        image,
        is_behind: side == Side::Behind,
        may_cross,
        is_doubtful: found.sides.as_ref().is_some_and(|own| own.is_doubtful),
        relative_range_sigma: None,
        fixes,
    })
}

/// Copies the upper triangle of a matrix to the lower one: products of three numbers depend on their order.
fn symmetrise<const N: usize>(matrix: &mut [f64]) {
    for i in 0..N {
        (0..i).for_each(|j| matrix[i * N + j] = matrix[j * N + i]);
    }
}

/// States of all instants with their uncertainty.
struct States {
    best: Path,
    innovation: Vec<f64>,
    /// Covariances with the uncertainty of the motion alone, and with systematic errors.
    random: Vec<f64>,
    covariance: Vec<f64>,
}

impl States {
    /// Smooths measurements that are linearised about the path, with a noise of `scale` times the stated one.
    fn new<const D: usize, const N: usize>(
        setting: &mut Setting<'_, D, N>,
        found: &mut Found<D, N>,
        systematic: &Systematic,
        effect: Option<&Effect<'_>>,
        scale: f64,
    ) -> Result<Self, Failure> {
        let record = setting.record;
        if found.sides.is_some() {
            found.settle(false);
            found.relinearise(setting, setting.motion, scale)?;
            found.settle(true);
        }
        found.is_last = true;
        // earlier, a stiff vertical motion could hold the path at a wrong height; near the plane of the
        // stations, heights are hardly known
        let is_near = found.sides.as_ref().is_some_and(|own| own.is_near(&found.path.mean, N));
        setting.smoother.separates = D == 3 && setting.motion.is_none() && !is_near;
        if setting.smoother.separates {
            (0..REFITS).try_for_each(|_| found.relinearise(setting, None, scale).map(drop))?;
        }
        // the covariance of a shortened step is too small
        let mut rounds = 0;
        while found.relinearise(setting, setting.motion, scale)? {
            rounds += 1;
            if rounds > LAST {
                return Err(Failure::Diverged);
            }
        }
        let track = found.plots.track(record.time, D)?;
        let fit = setting.smoother.with_error(&track, found.path.fit);
        let (best, innovation) = setting.smoother.finish(&track, fit);
        let motion = best.fit.motion;
        let random = match setting.motion {
            Some(_) => best.covariance.clone(),
            None => motion::mixed(setting, found, &best)?,
        };
        let mut covariance = random.clone();
        if let Some(effect) = effect {
            effect.add(setting, found, motion, &mut covariance)?;
        }
        if let Systematic::Lasting(Prior { deviation: Some(sigma), .. }) = systematic {
            lasting::add_deviation(setting, found, sigma, motion, &mut covariance)?;
        }
        let biases = effect.and_then(Effect::biases);
        if let Some(sigma) = record.surveys {
            survey::add_errors(setting, found, (sigma, biases), motion, &mut covariance)?;
        }
        if record.speed_sigma > 0.0 {
            let sigma = record.speed_sigma;
            speed::add_error(setting, found, (sigma, biases), motion, &mut covariance)?;
        }
        if let Some(wind) = &record.wind {
            speed::add_wind(setting, found, (wind, biases), motion, &mut covariance)?;
        }
        setting.smoother.separates = false;
        Ok(Self { best, innovation, random, covariance })
    }
}

/// Systematic errors that were estimated.
enum Effect<'a> {
    Biases(Biases, &'a [usize]),
    Lasting(Lasting, &'a Prior),
}

impl Effect<'_> {
    /// Standard deviation of the noise relative to the stated one, if contradictions between stations
    /// determine it.
    fn noise(&self) -> Option<f64> {
        match self {
            Self::Biases(..) => None,
            Self::Lasting(lasting, _) => lasting.noise(),
        }
    }

    /// Constant biases of which nothing was known.
    fn biases(&self) -> Option<&Biases> {
        match self {
            Self::Biases(biases, _) => Some(biases),
            Self::Lasting(..) => None,
        }
    }

    fn add<const D: usize, const N: usize>(
        &self,
        setting: &mut Setting<'_, D, N>,
        found: &Found<D, N>,
        motion: ProcessNoise,
        covariance: &mut [f64],
    ) -> Result<(), Failure> {
        match self {
            Self::Biases(biases, _) => biases.add_effect(setting, motion, covariance),
            Self::Lasting(lasting, _) => lasting.add_effect(setting, found, motion, covariance),
        }
    }

    fn by_station(&self, record: &Record<'_>) -> LastingErrors {
        match self {
            Self::Biases(biases, kinds) => by_station(record, biases, kinds),
            Self::Lasting(lasting, prior) => lasting.by_station(prior),
        }
    }
}

fn by_station(record: &Record<'_>, biases: &Biases, biased: &[usize]) -> LastingErrors {
    let (width, k) = (record.width(), record.width() / KINDS);
    let (mut value, mut sigma) = (vec![0.0; width + k], vec![0.0; width + k]);
    for kind in biased {
        sigma[kind * k..(kind + 1) * k].fill(f64::INFINITY);
    }
    for (i, &column) in biases.columns.iter().enumerate() {
        (value[column], sigma[column]) = (biases.values[i], biases.sigma(i));
    }
    LastingErrors { value, sigma, share: 0.0, time: f64::INFINITY, is_told: true }
}
