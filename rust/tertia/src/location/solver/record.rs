//! The measurements of one instant, without missing values.

use crate::base::small::{Vector, dot, norm};
use crate::location::descent::block::Block;
use crate::location::descent::lane::LANES;
use crate::location::descent::minimum::Minimum;
use crate::location::descent::starts;
use crate::location::descent::{Loss, Problem};
use crate::location::search::arrivals;
use crate::location::search::fix::{Instant, Output};
use crate::location::search::{Buffers, Search, least, states};
use crate::sensors::{KINDS, Kind, Measurement, Row, read, relative};

/// Place of a height, which is not among the values of an instant.
pub(in crate::location) const NOWHERE: usize = usize::MAX;

/// The measurements of an instant, and the state of the search for its position. A state is a position
/// and, if there are arrivals, their emission.
#[derive(Clone, Debug, Default)]
pub(in crate::location) struct Record<const D: usize, const N: usize> {
    pub measurements: Vec<Measurement<D>>,
    /// Index of each measurement among the values of the instant, or [`NOWHERE`].
    pub places: Vec<usize>,
    /// Size of the geometry: the largest distance, station or measured, from the first station.
    pub extent: f64,
    /// Whether the standard deviation of the measurements has to be estimated.
    pub unknown: bool,
    /// Variance that range differences have from the first station, if they are converted into
    /// arrivals.
    pub common: Option<f64>,
    /// A start, and the minimum to which it led.
    pub start: Option<Vector<N>>,
    pub first: Option<Minimum<N>>,
    /// The points of which the start is the best, and their costs; empty if the start is trusted.
    pub points: Vec<Vector<N>>,
    pub costs: Vec<f64>,
    /// Residuals and their derivatives at the minimum.
    pub rows: Vec<Row<N>>,
}

impl Instant<'_> {
    /// Returns the variance that range differences have from the first station, if there is any: from
    /// their correlation, and from the uncertain position of the station.
    pub(in crate::location) fn common(&self, correlation: f64) -> Option<f64> {
        let k = self.values.len() / KINDS;
        let differences =
            Kind::RangeDifference as usize * k..(Kind::RangeDifference as usize + 1) * k;
        let least = self.sigmas[differences].iter().copied().fold(f64::NAN, f64::min);
        let common = correlation * relative(least).powi(2) + self.survey(0).powi(2);
        (common > 0.0).then_some(common)
    }

    /// Returns the standard deviation of a station's coordinates.
    fn survey(&self, station: usize) -> f64 {
        self.position_sigmas.map_or(0.0, |sigmas| sigmas[station])
    }
}

impl<const D: usize, const N: usize> Record<D, N> {
    pub fn clear(&mut self) {
        self.measurements.clear();
        self.places.clear();
        self.points.clear();
        self.costs.clear();
        (self.start, self.first, self.common) = (None, None, None);
        (self.extent, self.unknown) = (0.0, false);
    }

    /// Collects the measurements station by station. Range differences with a common error become
    /// arrivals, with the arrival at the first station at zero.
    pub fn read(&mut self, instant: &Instant<'_>, correlation: f64) {
        self.clear();
        let Instant { stations, axes, values, sigmas, .. } = *instant;
        let k = values.len() / KINDS;
        let reference = Kind::RangeDifference as usize * k;
        let differences = reference..reference + k;
        if N > D && values[differences].iter().any(|v| !v.is_nan()) {
            self.common = instant.common(correlation);
        }
        if let Some(common) = self.common {
            let zero = Measurement::new(Kind::Arrival, 0, [0.0; D], 0.0, common.sqrt());
            self.measurements.push(zero);
            self.places.push(reference);
        }
        let (common, mut extent) = (self.common, 0.0_f64);
        let survey = |k: usize| instant.survey(k).powi(2);
        read(stations, axes, values, sigmas, |place, mut m: Measurement<D>| {
            let sigma = sigmas[place];
            self.unknown |= sigma.is_nan();
            let variance = m.precision.powi(-2) + survey(m.index);
            match (m.kind, common) {
                (Kind::RangeDifference, Some(common)) => {
                    let own = (variance - common + survey(0)).sqrt();
                    m = Measurement::new(Kind::Arrival, m.index, m.station, m.value, own);
                }
                (Kind::Range | Kind::Arrival | Kind::RangeDifference, _)
                    if survey(m.index) > 0.0 =>
                {
                    m.precision = variance.sqrt().recip();
                }
                _ => {}
            }
            if !m.kind.is_angle() {
                extent = extent.max(m.value.abs());
            }
            extent = extent.max(norm(&m.station));
            self.measurements.push(m);
            self.places.push(place);
        });
        if let Some((height, sigma)) = instant.height {
            let value = height - stations[D - 1];
            extent = extent.max(value.abs());
            self.measurements.push(Measurement::new(Kind::Height, k, [0.0; D], value, sigma));
            self.places.push(NOWHERE);
        }
        self.extent = extent;
    }

    pub fn search(&self, loss: Loss) -> Search<'_, D, N> {
        let Self { measurements, extent, unknown, start, first, .. } = self;
        let problem = Problem { measurements, extent: *extent };
        let (start, first) = (*start, *first);
        Search { problem, loss, unknown: *unknown, start, first, decides: false, side: None }
    }

    /// Whether uncertain station positions cause errors of angles.
    pub fn is_blurred(&self, instant: &Instant<'_>) -> bool {
        let angles = self.measurements.iter().filter(|m| m.kind.is_angle());
        !self.unknown && angles.into_iter().any(|m| instant.survey(m.index) > 0.0)
    }

    /// Sets the sigmas of angles to include the errors from uncertain station positions, at a position
    /// `p`.
    pub fn blur(&mut self, instant: &Instant<'_>, p: &Vector<D>) {
        for (m, &place) in self.measurements.iter_mut().zip(&self.places) {
            if m.kind.is_angle() {
                let gradient = m.row(p).gradient;
                let slope = dot(&gradient, &gradient) / (m.precision * m.precision);
                let survey = instant.survey(m.index).powi(2);
                let sigma = instant.sigmas[place];
                m.precision = (sigma * sigma + survey * slope).sqrt().recip();
            }
        }
        self.first = None;
    }

    /// Converts whitened residuals and outlier marks of arrivals back into those of range differences.
    pub fn tell_differences(&self, out: &mut Output<'_>) {
        let reference = self.places[0];
        let sigma = |at: usize| self.measurements[at].precision.recip();
        let (first, wrong) = (out.residual[reference] * sigma(0), out.outlier[reference]);
        let differences = Kind::RangeDifference as usize;
        let k = out.residual.len() / KINDS;
        for (at, &place) in self.places.iter().enumerate().skip(1) {
            if place / k == differences {
                let total = sigma(0).hypot(sigma(at));
                out.residual[place] = (out.residual[place] * sigma(at) - first) / total;
                out.outlier[place] |= wrong;
            }
        }
        (out.residual[reference], out.outlier[reference]) = (f64::NAN, false);
    }
}

/// Buffers for instants side by side, either all with arrivals or all without.
#[derive(Debug)]
pub(in crate::location) struct Room<const D: usize, const N: usize> {
    pub records: Vec<Record<D, N>>,
    pub block: Block<D, N>,
    pub buffers: Buffers<D, N>,
}

impl<const D: usize, const N: usize> Default for Room<D, N> {
    fn default() -> Self {
        Self {
            records: vec![Record::default(); LANES],
            block: Block::default(),
            buffers: Buffers::default(),
        }
    }
}

impl<const D: usize, const N: usize> Room<D, N> {
    /// Reads an instant, and finds a start if `loss` returns a loss for its number of measurements: a
    /// start that many measurements support, otherwise the best of the candidate points.
    pub fn read(
        &mut self,
        at: usize,
        instant: &Instant<'_>,
        correlation: f64,
        loss: impl Fn(usize) -> Option<Loss>,
    ) {
        let record = &mut self.records[at];
        record.read(instant, correlation);
        let count = record.measurements.len();
        if count < N || instant.initial.is_some() || record.unknown {
            return;
        }
        let Some(loss) = loss(count) else { return };
        let Buffers { candidates, scratch, .. } = &mut self.buffers;
        record.start = if N > D {
            arrivals::start(&record.measurements)
        } else {
            let middle = candidates.middle(&record.measurements);
            middle.map(|p| std::array::from_fn(|i| p[i]))
        };
        if record.start.is_none() {
            let Record { measurements, points, costs, .. } = record;
            candidates.find(measurements, record.extent);
            states(measurements, &candidates.points, points, scratch);
            starts::costs(measurements, points, loss, costs);
            record.start = least(costs).map(|at| points[at]);
        }
    }

    pub fn clear(&mut self, count: usize) {
        self.records[..count].iter_mut().for_each(Record::clear);
    }
}
