//! The speed of the signals and the wind beside lasting errors of the stations, which can look alike.
//!
//! About a speed that is too low by the relative difference δ, in a wind of β times the speed, a measurement
//! from p at the station s with the path d has an error of `−d δ − β·(s − p)`. The posterior of δ and β is
//! that of unknowns which all instants have in common.

use super::speed::{FAULT, SAMPLE, Speed, spread};
use super::wind::Wind;
use crate::base::small::Vector;
use crate::location::batch::lasting::Sums;
use crate::location::search::fix::{Instant, Solution, Status};
use crate::location::solver::record::Record;
use crate::location::solver::{Locator, Workspace};
use crate::sensors::{KINDS, Measurement, Row};

/// Share of outliers, and deviation of the speed or the wind in its standard deviations, above which what is
/// stated is suspected; deviation above which it is wrong.
const MANY: f64 = 0.2;
const SUSPECT: f64 = 3.0;
pub(in crate::location) const WRONG: f64 = 6.0;
/// Largest number of stations for which lasting errors are considered, because the cost grows with the cube.
const MOST: usize = 64;
/// Unknowns: the relative difference of the speed, and the wind east and north.
const UNKNOWNS: usize = 3;

impl Locator {
    /// Returns the speed if the stations may have lasting errors. `speed` is what fits best without such
    /// errors, and `prior` the standard deviation of the share before. O(N K² + K³) for K stations.
    pub(in crate::location) fn beside_lasting<'a, const D: usize>(
        &self,
        instants: impl Iterator<Item = Instant<'a>>,
        speed: Speed,
        prior: f64,
        workspace: &mut Workspace<D>,
    ) -> Speed {
        let sums = self.medium_sums(instants, speed.share, workspace);
        sums.and_then(|sums| speed_of(sums, speed, prior)).unwrap_or(speed)
    }

    /// Whether the stated speed, and still air, may be wrong, if the share of the speed and the wind have these
    /// standard deviations: the residuals look like those of another speed or of a wind, or many measurements
    /// are outliers. O(N M + N K² + K³) for K stations.
    pub(in crate::location) fn suspects_medium<'a, const D: usize>(
        &self,
        instants: impl Iterator<Item = Instant<'a>>,
        (speed, wind): (f64, f64),
        workspace: &mut Workspace<D>,
    ) -> (bool, bool) {
        let Some(sums) = self.medium_sums(instants, 0.0, workspace) else { return (false, false) };
        if sums.outliers > MANY * sums.measured {
            return (speed > 0.0, wind > 0.0);
        }
        let (prior, at) = ([speed, wind, wind], [0.0; UNKNOWNS]);
        let told = reduced(sums, &prior, &at).and_then(|sums| sums.mixed(&prior, &at));
        told.map_or((false, false), |told| {
            let is_blown = wind > 0.0 && told.distance(1..UNKNOWNS) > SUSPECT;
            (told.mean[0].abs() > SUSPECT * told.sigma(0), is_blown)
        })
    }

    /// Whether there is surely a wind, and it leaves no contradictions that look like lasting errors of the stations
    /// or like another speed. The standard deviations are those of the share of the speed, 0 if the speed is right,
    /// and of the components of the wind. O(N M + N K² + K³), for at most 256 instants.
    pub(super) fn is_blown<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        (values, sigmas): (&[f64], &[f64]),
        wind: Option<&Wind>,
        (speed, sigma): (f64, f64),
        workspace: &mut Workspace<D>,
    ) -> bool {
        let Some(wind) = wind else { return false };
        let size = instants.first().map_or(1, |one| one.values.len());
        let own = values.chunks(size).zip(sigmas.chunks(size)).zip(instants);
        let still: Vec<_> =
            own.map(|((values, sigmas), one)| Instant { values, sigmas, ..*one }).collect();
        let (prior, at) = ([speed, sigma, sigma], [0.0, wind.mean[0], wind.mean[1]]);
        let sums = self.medium_sums(spread(&still, SAMPLE), 0.0, workspace);
        let told = sums.and_then(|sums| reduced(sums, &prior, &at)?.mixed(&prior, &at));
        told.is_some_and(|mut told| {
            told.mean.iter_mut().zip(at).for_each(|(mean, at)| *mean += at);
            let is_right = speed == 0.0 || told.mean[0].abs() < SUSPECT * told.sigma(0);
            is_right && told.nothing > 0.5 && told.distance(1..UNKNOWNS) > WRONG
        })
    }

    /// Returns the normal equations of all instants if the signals are faster by this share; none without
    /// instants.
    pub(in crate::location) fn medium_sums<'a, const D: usize>(
        &self,
        instants: impl Iterator<Item = Instant<'a>>,
        share: f64,
        workspace: &mut Workspace<D>,
    ) -> Option<Sums> {
        let mut instants = instants.peekable();
        let stations = instants.peek()?.values.len() / KINDS;
        let mut sums = Sums::new(UNKNOWNS, if stations > MOST { 0 } else { stations });
        instants.for_each(|instant| self.add_instant(&instant, share, &mut sums, workspace));
        Some(sums)
    }

    /// Adds the measurements of an instant if the signals are faster by this share.
    fn add_instant<const D: usize>(
        &self,
        instant: &Instant<'_>,
        share: f64,
        sums: &mut Sums,
        workspace: &mut Workspace<D>,
    ) {
        let (fix, Solution { position, outlier, .. }) = self.located_at(share, instant, workspace);
        if fix.status != Status::None {
            return;
        }
        let p: Vector<D> = std::array::from_fn(|i| position[i] - instant.stations[i]);
        let Workspace { own, plane, space } = workspace;
        match (D, self.has_arrivals(instant)) {
            (_, false) => add(sums, &own.records[0], &p, &outlier),
            (2, true) => add(sums, &plane.records[0], &p, &outlier),
            _ => add(sums, &space.records[0], &p, &outlier),
        }
    }
}

/// Adds the measurements of a located instant; p is its position relative to the first station.
fn add<const D: usize, const N: usize>(
    sums: &mut Sums,
    record: &Record<D, N>,
    p: &[f64],
    outlier: &[bool],
) {
    let p: Vector<D> = std::array::from_fn(|i| p[i]);
    let has_lasting = sums.have_lasting();
    sums.add(record, outlier, |m: &Measurement<D>, _: &Row<N>, own: &mut Vec<(usize, f64)>| {
        if !m.kind.travels() {
            return;
        }
        own.push((0, -m.path(&p) * m.precision));
        own.extend((0..2).map(|i| (1 + i, (p[i] - m.station[i]) * m.precision)));
        if has_lasting {
            own.push((UNKNOWNS + m.index, 1.0));
        }
    });
}

/// Returns the sums for a noise that may be larger than stated.
fn reduced(mut sums: Sums, prior: &[f64], at: &[f64]) -> Option<Sums> {
    sums.reduce(sums.noise(prior, at)?);
    Some(sums)
}

/// Returns the speed about `speed`.
fn speed_of(sums: Sums, speed: Speed, prior: f64) -> Option<Speed> {
    let (prior, at) = ([prior, 0.0, 0.0], [speed.share, 0.0, 0.0]);
    let told = reduced(sums, &prior, &at)?.mixed(&prior, &at)?;
    let (off, sigma) = (told.mean[0], told.sigma(0).min(prior[0]));
    (off.is_finite() && sigma > 0.0).then_some(Speed { share: speed.share + off, sigma, ..speed })
}

/// Returns the log odds of the positions of some sums against others for the same measurements, if the stations
/// may have lasting errors. `None` if there are too many stations for this.
pub(super) fn evidence_against(these: Sums, others: Sums) -> Option<f64> {
    if !these.have_lasting() {
        return None;
    }
    let none = [0.0; UNKNOWNS];
    let noise = these.noise(&none, &none)?.min(others.noise(&none, &none)?);
    let of = |mut sums: Sums| -> Option<f64> {
        sums.reduce(noise);
        let told = sums.mixed(&none, &none)?;
        Some(told.evidence - 0.5 * sums.square - FAULT * sums.outliers)
    };
    Some(of(these)? - of(others)?)
}
