//! Errors of radars that are far larger than expected, from the tracks of each radar alone at one instant.
//!
//! Which tracks of two radars belong to the same target is determined together with the errors. From each
//! possible pair a chain of pairs begins; each further pair must agree with the errors that the pairs before
//! it leave possible. The chain with the largest odds against chance is chosen. Cost O(C² N) for C possible
//! pairs of N targets; chains begin from 200 pairs at most.

use super::sighting::KINDS;
use crate::base::interrupt::poll;
use crate::sensors::{Identities, Radar};
use nalgebra::{DMatrix, DVector, Matrix2, SMatrix, SVector, Vector2, Vector4};
use std::f64::consts::TAU;

/// Errors that are the same in all directions.
type Errors = [f64; KINDS];

/// Standard deviations of large errors, in units of those of the prior: offset, gain, azimuth, clock; and those
/// of a radar whose ranges have the usual scale.
const WIDE: Errors = [10.0; KINDS];
const IN_SCALE: Errors = [10.0, 1.0, 10.0, 10.0];
/// Largest differences between two tracks of one target: heights in metres, normalised squares of velocities
/// (after an allowance of 3 m/s) and of positions, and of positions within a chain.
const HEIGHTS: f64 = 300.0;
const VELOCITIES: f64 = 16.0;
const SPARE_SPEED: f64 = 3.0;
const POSITIONS: f64 = 20.0;
const IN_CHAIN: f64 = 13.8;
/// ln of the odds that equal identities add to a pair.
const IDENTITIES: f64 = 6.0;
/// ln of the odds between two radars up to which either may have the large errors.
const RIVAL: f64 = 3.0;
/// Prior ln odds that one radar has large errors, and that all have, against none.
const ONE: f64 = -3.0;
const ALL: f64 = -6.0;
/// Prior ln odds that large errors are also those of the scale of ranges.
const SCALE: f64 = -3.0;
/// Number of tracks of a radar that are compared with all others, and number of tracks with a possible pair
/// that suffices.
const COMPARED: usize = 200;
const ENOUGH: usize = 40;
/// Number of pairs from which a chain begins, and least number of pairs in a chain.
const CHAINS: usize = 60;
const FEWEST: usize = 3;
/// Share of the tracks in a chain from which it is right beyond doubt.
const COMPLETE: f64 = 0.8;

/// Number of errors of two radars.
const BOTH: usize = 2 * KINDS;
type Design = SMatrix<f64, 2, BOTH>;

/// A track of one radar at the instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alone {
    /// Number of the radar.
    pub radar: usize,
    /// East, north, and their rates.
    pub state: [f64; 4],
    /// Covariance of the state, row by row.
    pub covariance: [f64; 16],
    /// Metres; nan if unknown.
    pub height: f64,
    /// Identities that the transponder reports.
    pub identities: Identities,
}

impl Alone {
    /// Covariance of the position (0) or of the velocity (2).
    fn part(&self, at: usize) -> Matrix2<f64> {
        let c = &self.covariance;
        Matrix2::new(c[5 * at], c[5 * at + 1], c[5 * at + 4], c[5 * at + 5])
    }
}

/// Errors from which a registration starts, and their prior.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// Errors of each radar.
    pub errors: Vec<Errors>,
    /// Prior standard deviations: those given, wider for a radar that has large errors.
    pub prior: Vec<Errors>,
    /// Standard deviations of the estimated errors.
    pub sigma: Vec<Errors>,
    /// Number of tracks of each radar that are paired with those of others.
    pub paired: Vec<usize>,
}

/// A pair of tracks of two radars.
#[derive(Clone, Copy)]
struct Pair {
    first: usize,
    second: usize,
    off: Vector2<f64>,
    spread: Matrix2<f64>,
    /// Displacement by the errors of the first radar and of the second, in standard deviations of the prior.
    design: Design,
    /// Indices of these errors among those of all radars.
    at: [usize; BOTH],
    bonus: f64,
}

/// Estimates the errors of the radars under the hypotheses that no radar has large errors, that one has, and
/// that all have; the likeliest is chosen. If several radars are about equally likely to be the one, any of them
/// may have large errors: of two clocks, only the difference is observed.
///
/// # Panics
/// If the radar of a track does not exist, or the lengths differ.
pub fn start(tracks: &[Alone], radars: &[Radar], prior: &[Errors]) -> Start {
    assert_eq!(prior.len(), radars.len());
    let pairs = associated(tracks, radars, prior);
    let order = KINDS * radars.len();
    let (mut information, mut score) = (DMatrix::zeros(order, order), DVector::zeros(order));
    for pair in &pairs {
        let Some(inverse) = pair.spread.try_inverse() else { continue };
        let (weighed, u) = (inverse * pair.design, pair.design.transpose() * inverse * pair.off);
        let product = pair.design.transpose() * weighed;
        for i in 0..BOTH {
            score[pair.at[i]] += u[i];
            for j in 0..BOTH {
                information[(pair.at[i], pair.at[j])] += product[(i, j)];
            }
        }
    }
    let count = radars.len();
    let (large, wide) = likeliest(&information, &score, count);
    let (_, errors, variances) = evidence(&information, &score, (&large, &wide));
    let value = |k: usize, j: usize| errors[KINDS * k + j] * prior[k][j];
    let sigma = |k: usize, j: usize| prior[k][j] * if large[k] { wide[j] } else { 1.0 };
    let known = |k: usize, j: usize| prior[k][j] * variances[KINDS * k + j].sqrt();
    let of = |track: usize, k: usize| tracks[track].radar == k;
    let paired = |k| pairs.iter().filter(|pair| of(pair.first, k) || of(pair.second, k)).count();
    Start {
        paired: (0..count).map(paired).collect(),
        errors: (0..count).map(|k| std::array::from_fn(|j| value(k, j))).collect(),
        prior: (0..count).map(|k| std::array::from_fn(|j| sigma(k, j))).collect(),
        sigma: (0..count).map(|k| std::array::from_fn(|j| known(k, j))).collect(),
    }
}

/// Returns which radars may have large errors, and their standard deviations.
fn likeliest(
    information: &DMatrix<f64>,
    score: &DVector<f64>,
    count: usize,
) -> (Vec<bool>, Errors) {
    let [usual, scaled] = [IN_SCALE, WIDE].map(|wide| large(information, score, (count, &wide)));
    if scaled.0 + SCALE > usual.0 { (scaled.1, WIDE) } else { (usual.1, IN_SCALE) }
}

/// Returns which radars may have errors that are so `wide`, and ln of the odds.
fn large(
    information: &DMatrix<f64>,
    score: &DVector<f64>,
    (count, wide): (usize, &Errors),
) -> (f64, Vec<bool>) {
    let odds = |large: &[bool]| evidence(information, score, (large, wide)).0;
    let one = |k: usize| ONE + odds(&(0..count).map(|i| i == k).collect::<Vec<_>>());
    let ones: Vec<f64> = (0..count).map(one).collect();
    let likeliest = ones.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let [none, all] = [odds(&vec![false; count]), ALL + odds(&vec![true; count])];
    if none >= likeliest.max(all) {
        (none, vec![false; count])
    } else if all >= likeliest {
        (all, vec![true; count])
    } else {
        (likeliest, ones.iter().map(|own| *own > likeliest - RIVAL).collect())
    }
}

/// Returns ln of the evidence for errors that are large of some radars, their mean, and their remaining
/// variances.
fn evidence(
    information: &DMatrix<f64>,
    score: &DVector<f64>,
    (large, wide): (&[bool], &Errors),
) -> (f64, DVector<f64>, DVector<f64>) {
    let n = score.len();
    let sigma = |i: usize| if large[i / KINDS] { wide[i % KINDS] } else { 1.0 };
    let u = DVector::from_fn(n, |i, _| sigma(i) * score[i]);
    let m = DMatrix::from_fn(n, n, |i, j| {
        f64::from(u8::from(i == j)) + sigma(i) * information[(i, j)] * sigma(j)
    });
    let Some(cholesky) = m.cholesky() else {
        return (f64::NEG_INFINITY, DVector::zeros(n), DVector::zeros(n));
    };
    let solved = cholesky.solve(&u);
    let value = 0.5 * u.dot(&solved) - cholesky.l_dirty().diagonal().map(f64::ln).sum();
    let left = cholesky.inverse();
    let variances = DVector::from_fn(n, |i, _| sigma(i).powi(2) * left[(i, i)]);
    (value, DVector::from_fn(n, |i, _| sigma(i) * solved[i]), variances)
}

/// Returns the pairs of tracks of one target, radar by radar, beginning with the radar with the most tracks.
fn associated(tracks: &[Alone], radars: &[Radar], prior: &[Errors]) -> Vec<Pair> {
    let of = |k: usize| (0..tracks.len()).filter(move |&i| tracks[i].radar == k);
    let mut order: Vec<usize> = (0..radars.len()).collect();
    order.sort_by_key(|&k| std::cmp::Reverse(of(k).count()));
    let (mut targets, mut found): (Vec<usize>, Vec<Pair>) = (Vec::new(), Vec::new());
    for k in order {
        let own: Vec<usize> = of(k).collect();
        let density = (own.len() as f64 / area(tracks)).ln();
        let pairs = possible(tracks, &own, &targets, radars, prior);
        let chain = best_chain(&pairs, density, KINDS * radars.len());
        targets.extend(own.iter().filter(|&&i| chain.iter().all(|pair| pair.first != i)));
        found.extend(chain);
    }
    found
}

/// Returns the possible pairs of some of the own tracks with others.
fn possible(
    tracks: &[Alone],
    own: &[usize],
    others: &[usize],
    radars: &[Radar],
    prior: &[Errors],
) -> Vec<Pair> {
    let (mut found, mut paired) = (Vec::new(), 0);
    for &first in own.iter().step_by(own.len().div_ceil(COMPARED).max(1)) {
        poll();
        let before = found.len();
        found
            .extend(others.iter().filter_map(|&second| pair(tracks, first, second, radars, prior)));
        paired += usize::from(found.len() > before);
        if paired == ENOUGH {
            break;
        }
    }
    found
}

/// Returns the likeliest chain; empty if it is too short.
fn best_chain(pairs: &[Pair], density: f64, order: usize) -> Vec<Pair> {
    let mut firsts: Vec<usize> = pairs.iter().map(|pair| pair.first).collect();
    firsts.dedup();
    let complete = FEWEST.max((COMPLETE * firsts.len() as f64).ceil() as usize);
    let mut best = (f64::NEG_INFINITY, Vec::new());
    for begin in (0..pairs.len()).step_by(pairs.len().div_ceil(CHAINS).max(1)) {
        let found = chain(pairs, begin, density, order);
        if found.0 > best.0 {
            best = found;
        }
        if best.1.len() >= complete {
            break;
        }
    }
    if best.1.len() >= FEWEST { best.1 } else { Vec::new() }
}

/// Area that the tracks cover, square metres.
fn area(tracks: &[Alone]) -> f64 {
    let side = |axis: usize| {
        let places = || tracks.iter().map(|track| track.state[axis]);
        let (low, high) =
            (places().fold(f64::INFINITY, f64::min), places().fold(f64::NEG_INFINITY, f64::max));
        (high - low).max(1e4)
    };
    side(0) * side(1)
}

/// Returns two tracks as a pair, if they can be of one target.
fn pair(
    tracks: &[Alone],
    first: usize,
    second: usize,
    radars: &[Radar],
    prior: &[Errors],
) -> Option<Pair> {
    let (a, b) = (&tracks[first], &tracks[second]);
    let same = a.identities.same(&b.identities);
    if (a.height - b.height).abs() > HEIGHTS || same == Some(false) {
        return None;
    }
    let difference = Vector4::from(a.state) - Vector4::from(b.state);
    let part = |at: usize| a.part(at) + b.part(at);
    let speeds = difference[2].powi(2) + difference[3].powi(2);
    let variances = [10, 15].map(|at| a.covariance[at] + b.covariance[at] + SPARE_SPEED.powi(2));
    if speeds > VELOCITIES * (variances[0] + variances[1]) {
        return None;
    }
    let velocity = part(2) + Matrix2::identity() * (SPARE_SPEED * SPARE_SPEED);
    let off = Vector2::new(difference[2], difference[3]);
    if form(&velocity, off)? > VELOCITIES {
        return None;
    }
    let common = Common::of(a, b)?;
    let (off, spread) = (Vector2::new(difference[0], difference[1]), part(0));
    let mut design = Design::zeros();
    for (side, sign, track) in [(0, 1.0, a), (1, -1.0, b)] {
        let columns = common.columns(&radars[track.radar], &prior[track.radar]);
        design.view_mut((0, side * KINDS), (2, KINDS)).copy_from(&(sign * columns));
    }
    let wide = SVector::<f64, BOTH>::from_fn(|i, _| wide(i));
    let total = spread + design * SMatrix::from_diagonal(&wide) * design.transpose();
    let bonus = if same.is_some() { IDENTITIES } else { 0.0 };
    let at = std::array::from_fn(|i| KINDS * if i < KINDS { a.radar } else { b.radar } + i % KINDS);
    let possible = form(&total, off)? <= POSITIONS;
    possible.then_some(Pair { first, second, off, spread, design, at, bonus })
}

/// Common state of the target of two tracks, from which the displacements by the errors of both radars are
/// computed. If each track's own state were used, errors common to both radars would seem to explain random
/// errors: a clock error would explain errors of position, which are correlated with those of velocity, and a
/// range offset those of targets near radars at the same place.
struct Common {
    place: Vector2<f64>,
    velocity: Vector2<f64>,
    /// m; nan if neither track has one.
    height: f64,
}

impl Common {
    fn of(a: &Alone, b: &Alone) -> Option<Self> {
        let [(place, own), (other_place, other)] = [a, b].map(|track| {
            let [x, y, vx, vy] = track.state;
            (Vector2::new(x, y), Vector2::new(vx, vy))
        });
        let spare = Matrix2::identity() * (SPARE_SPEED * SPARE_SPEED);
        let weight = a.part(2) * (a.part(2) + b.part(2) + spare).try_inverse()?;
        let height = match [a.height, b.height].map(f64::is_nan) {
            [true, _] => b.height,
            [_, true] => a.height,
            _ => 0.5 * (a.height + b.height),
        };
        let velocity = own + weight * (other - own);
        Some(Self { place: 0.5 * (place + other_place), velocity, height })
    }

    /// Displacement of a track of this target by errors of one standard deviation.
    fn columns(&self, radar: &Radar, prior: &Errors) -> SMatrix<f64, 2, KINDS> {
        let offset = [0, 1].map(|axis| self.place[axis] - radar.position[axis]);
        let ground = offset[0].hypot(offset[1]).max(1.0);
        let up = if self.height.is_finite() { self.height - radar.position[2] } else { 0.0 };
        let range = ground.hypot(up);
        let [e, n] = offset.map(|side| side / ground);
        let slope = range / ground;
        SMatrix::<f64, 2, KINDS>::from_columns(&[
            Vector2::new(e, n) * (slope * prior[0]),
            Vector2::new(e, n) * (slope * range * prior[1]),
            Vector2::new(n, -e) * (ground * prior[2]),
            -self.velocity * prior[3],
        ])
    }
}

/// `dᵀ S⁻¹ d`.
fn form(spread: &Matrix2<f64>, off: Vector2<f64>) -> Option<f64> {
    Some(off.dot(&(spread.try_inverse()? * off)))
}

/// Returns the pairs that follow from one, and ln of their odds against chance.
fn chain(pairs: &[Pair], begin: usize, density: f64, order: usize) -> (f64, Vec<Pair>) {
    let mut mean = DVector::<f64>::zeros(order);
    let mut spread = DMatrix::from_diagonal(&DVector::from_fn(order, |i, _| wide(i)));
    let (mut score, mut taken) = (0.0, Vec::new());
    let mut left = pairs.to_vec();
    let mut next = gain(&pairs[begin], &mean, &spread, density).map(|odds| (begin, odds));
    while let Some((at, odds)) = next {
        poll();
        let pair = left[at];
        let Some(inverse) = (pair.design_spread(&spread) + pair.spread).try_inverse() else {
            break;
        };
        let cross = spread.select_columns(&pair.at) * pair.design.transpose();
        let gain_of_pair = &cross * inverse;
        mean += &gain_of_pair * (pair.off - pair.design * pair.of(&mean));
        spread -= &gain_of_pair * cross.transpose();
        score += odds;
        taken.push(pair);
        left.retain(|other| other.first != pair.first && other.second != pair.second);
        next = left
            .iter()
            .enumerate()
            .filter_map(|(i, pair)| Some((i, gain(pair, &mean, &spread, density)?)))
            .max_by(|a, b| a.1.total_cmp(&b.1));
    }
    (score, taken)
}

/// ln of the odds of a pair against chance; none if the pair is unlikely.
fn gain(pair: &Pair, mean: &DVector<f64>, spread: &DMatrix<f64>, density: f64) -> Option<f64> {
    let total = pair.design_spread(spread) + pair.spread;
    let d = form(&total, pair.off - pair.design * pair.of(mean))?;
    let volume = (TAU * TAU * total.determinant()).sqrt();
    let odds = -0.5 * d - volume.ln() - density + pair.bonus;
    (d < IN_CHAIN && odds > 0.0).then_some(odds)
}

/// Variance of a large error, in units of that of the prior.
fn wide(error: usize) -> f64 {
    WIDE[error % KINDS].powi(2)
}

impl Pair {
    /// Errors of the two radars among those of all radars.
    fn of(&self, errors: &DVector<f64>) -> SVector<f64, BOTH> {
        SVector::from_fn(|i, _| errors[self.at[i]])
    }

    /// Covariance of the difference of position due to the errors of the two radars.
    fn design_spread(&self, spread: &DMatrix<f64>) -> Matrix2<f64> {
        let own = SMatrix::<f64, BOTH, BOTH>::from_fn(|i, j| spread[(self.at[i], self.at[j])]);
        let total = self.design * own * self.design.transpose();
        0.5 * (total + total.transpose())
    }
}

#[cfg(test)]
mod tests {
    use super::super::sighting::CLOCK;
    use super::super::sighting::tests::{self, radar};
    use super::*;

    const PRIOR: Errors = [tests::PRIOR[0], tests::PRIOR[1], tests::PRIOR[2], tests::PRIOR[3]];
    use crate::base::interrupt::Flag;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    #[test]
    fn the_search_is_interrupted() {
        let (state, covariance, height) = ([0.0; 4], [0.0; 16], f64::NAN);
        let identities = Identities::NONE;
        let tracks = [0, 1].map(|radar| Alone { radar, state, covariance, height, identities });
        let radars = [0.0, 1e4].map(|x| radar([x, 0.0, 0.0], 50.0, 0.1));
        let flag = Flag::default();
        flag.set();
        let search = || flag.watch(|| start(&tracks, &radars, &[PRIOR; 2]));
        assert!(catch_unwind(AssertUnwindSafe(search)).is_err());
    }

    /// Errors of position and velocity are correlated in a young track. But a clock error of all radars moves
    /// their tracks alike, and nothing shows it.
    #[test]
    fn young_tracks_do_not_show_a_clock_error_of_all_radars() {
        let mut covariance = [0.0; 16];
        for axis in 0..2 {
            let of = |i: usize, j: usize| 4 * (2 * i + axis) + 2 * j + axis;
            covariance[of(0, 0)] = 1e4;
            covariance[of(0, 1)] = 2e3;
            covariance[of(1, 0)] = 2e3;
            covariance[of(1, 1)] = 1e3;
        }
        let track = |radar: usize, target: usize| {
            let [turn, phase] = [2.0 * target as f64, (7 * target + 3 * radar) as f64];
            let errors = [phase.sin(), phase.cos()].map(|e| 100.0 * e);
            let position = [3e4 * turn.sin(), 5e4 + 3e4 * turn.cos()];
            let velocity = [200.0 * (3.0 * turn).sin(), 200.0 * (3.0 * turn).cos()];
            let at = |axis: usize| position[axis] + errors[axis];
            let rate = |axis: usize| velocity[axis] + 0.2 * errors[axis];
            let state = [at(0), at(1), rate(0), rate(1)];
            Alone {
                radar,
                state,
                covariance,
                height: f64::NAN,
                identities: Identities::of(target as i64),
            }
        };
        let tracks: Vec<Alone> = (0..40).map(|i| track(i % 2, i / 2)).collect();
        let found = start(
            &tracks,
            &[[0.0; 3], [8e4, 0.0, 0.0]].map(|at| radar(at, 50.0, 0.1)),
            &[PRIOR; 2],
        );
        assert_eq!(found.paired, [20, 20]);
        let [first, second] = [0, 1].map(|k| found.errors[k][CLOCK]);
        assert!((first + second).abs() < 1e-9, "{first} {second}");
        assert!((first - second).abs() < PRIOR[CLOCK], "{first} {second}");
    }

    /// Near the radar, two tracks of a target that differ by random errors lie in different directions.
    #[test]
    fn targets_near_radars_at_one_place_do_not_show_an_offset_of_both() {
        let mut covariance = [0.0; 16];
        for (i, variance) in [1e4, 1e4, 1e3, 1e3].into_iter().enumerate() {
            covariance[5 * i] = variance;
        }
        let track = |radar: usize, target: usize| {
            let [turn, phase] = [2.0 * target as f64, (7 * target + 3 * radar) as f64];
            let distance = 400.0 + 100.0 * target as f64;
            let errors = [phase.sin(), phase.cos()].map(|e| 150.0 * e);
            let state =
                [distance * turn.sin() + errors[0], distance * turn.cos() + errors[1], 60.0, 0.0];
            let height = if target.is_multiple_of(3) { f64::NAN } else { 300.0 };
            Alone { radar, state, covariance, height, identities: Identities::of(target as i64) }
        };
        let tracks: Vec<Alone> = (0..40).map(|i| track(i % 2, i / 2)).collect();
        let found =
            start(&tracks, &[radar([0.0; 3], 50.0, 0.1), radar([0.0; 3], 50.0, 0.1)], &[PRIOR; 2]);
        assert_eq!(found.paired, [20, 20]);
        let [first, second] = [0, 1].map(|k| found.errors[k][0]);
        assert!((first + second).abs() < 1e-6 && found.prior[0][0] == PRIOR[0], "{first} {second}");
    }
}
