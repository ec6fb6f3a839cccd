//! The measurements of each instant, ready to be compared with positions.

use crate::base::small::{Vector, add_multiple};
use crate::sensors::{KINDS, Kind, Measurement, Row, read};
use std::f64::consts::FRAC_PI_2;
use std::num::NonZero;
use std::ops::Range;

/// Degrees of freedom from which an instant is located robustly.
pub(super) const REDUNDANCY: usize = 3;

/// Weight of an arrival that is not trusted, if another one is trusted.
const LEAST_TRUST: f64 = 1e-6;

/// Tolerance for rounding errors in sums of weights.
const MARGIN: f64 = 1e-9;

/// Measurements of K stations at N instants in D dimensions.
#[derive(Clone, Copy, Debug)]
pub struct Record<'a> {
    /// Positions of the stations, K D numbers, or N K D if they move.
    pub stations: &'a [f64],
    /// Directions of east, north and up at each station, K D² numbers or N K D²; none: those of the frame.
    pub axes: Option<&'a [f64]>,
    /// Standard deviations of the coordinates of the stations, K numbers; these errors are the same at all
    /// instants. None: 0.
    pub surveys: Option<&'a [f64]>,
    /// Times of the instants, not decreasing.
    pub time: &'a [f64],
    /// Readings of the clocks of the stations minus the true time, K numbers, for ranges, azimuths and
    /// elevations. None: 0.
    pub clocks: Option<&'a [f64]>,
    /// Ranges, azimuths, elevations, range differences and arrivals (in metres) of each instant, N 5 K
    /// numbers, nan where missing. In space, the height of the target may come last in each row, which then
    /// has 5 K + 1 numbers.
    pub values: &'a [f64],
    /// Usual standard deviations of the measurements, one for each number of a row.
    pub sigmas: &'a [f64],
    /// Standard deviations of each measurement, if they differ from the usual ones.
    pub own_sigmas: Option<&'a [f64]>,
    /// Correlation of the errors of the range differences of an instant.
    pub correlation: f64,
    /// Standard deviation of the propagation speed relative to the speed; this error is the same at all
    /// instants.
    pub speed_sigma: f64,
    /// Covariance of the wind that carries the signals, in units of their speed; the wind is the same at all
    /// instants.
    pub wind: Option<[[f64; 2]; 2]>,
    /// Whether instants are located robustly.
    pub robust: bool,
    /// A position near that of the target at the first instant, D numbers: of two paths that are mirror
    /// images, the one on the side of this position is taken.
    pub initial: Option<&'a [f64]>,
    /// Number of threads for computations that are independent for each instant.
    pub n_threads: Option<NonZero<usize>>,
}

impl<'a> Record<'a> {
    /// Number of columns, 5 K or 5 K + 1: values that an instant may have.
    pub(super) fn width(&self) -> usize {
        self.sigmas.len()
    }

    /// Number of stations.
    pub(super) fn receivers(&self) -> usize {
        self.width() / KINDS
    }

    /// Column of the heights of the target, which no station measures; none if there are none.
    pub(super) fn heights(&self) -> Option<usize> {
        let last = KINDS * self.receivers();
        (last < self.width()).then_some(last)
    }

    pub(super) fn len(&self) -> usize {
        self.time.len()
    }

    pub(super) fn kind_of(&self, column: usize) -> usize {
        column / self.receivers()
    }

    /// Standard deviations of the columns of an instant.
    pub(super) fn sigmas_at(&self, instant: usize) -> &'a [f64] {
        self.own_sigmas.map_or(self.sigmas, |own| &own[instant * self.width()..][..self.width()])
    }

    pub(super) fn stations_at(&self, instant: usize, d: usize) -> &'a [f64] {
        part(self.stations, instant, self.receivers() * d)
    }

    pub(super) fn axes_at(&self, instant: usize, d: usize) -> Option<&'a [f64]> {
        self.axes.map(|axes| part(axes, instant, self.receivers() * d * d))
    }
}

/// Returns the numbers of an instant, or all numbers if they hold for every instant.
fn part(values: &[f64], instant: usize, size: usize) -> &[f64] {
    if values.len() == size { values } else { &values[instant * size..][..size] }
}

/// A position, and the point at which derivatives are taken if it is a different one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place<const D: usize> {
    pub position: Vector<D>,
    pub eye: Option<Vector<D>>,
}

impl<const D: usize> Place<D> {
    pub fn at(position: &[f64]) -> Self {
        Self { position: std::array::from_fn(|i| position[i]), eye: None }
    }

    /// Returns both points moved by the same vector.
    pub fn moved(&self, by: &Vector<D>) -> Self {
        let moved = |p: Vector<D>| std::array::from_fn(|i| p[i] + by[i]);
        Self { position: moved(self.position), eye: self.eye.map(moved) }
    }
}

/// The measurements of a record without missing ones.
#[derive(Debug)]
pub(super) struct Measured<const D: usize> {
    pub values: Vec<f64>,
    list: Vec<Measurement<D>>,
    /// Column of each measurement.
    pub column: Vec<usize>,
    /// Index of the first measurement of each instant, and the number of all measurements.
    first: Vec<usize>,
    origins: Vec<Vector<D>>,
    /// Number of columns.
    pub width: usize,
    /// Whether there are arrivals.
    pub is_timed: bool,
}

/// Emission of an instant, which its arrivals have in common: the weighted median of their residuals, which
/// late arrivals hardly change, and the weighted mean of their derivatives, in metres.
pub(super) struct Emission<const D: usize> {
    residual: f64,
    gradient: Vector<D>,
    /// Sum of the weights over σ² of the arrivals; 0 if there is only one, which gives no information.
    information: f64,
}

impl<const D: usize> Emission<D> {
    const NONE: Self = Self { residual: 0.0, gradient: [0.0; D], information: 0.0 };

    /// Returns the row of a measurement less the emission; none for an arrival if the emission is unknown.
    pub fn removed_from(&self, one: &Measurement<D>, mut row: Row<D>) -> Option<Row<D>> {
        if one.kind != Kind::Arrival {
            return Some(row);
        }
        row.residual -= self.residual * one.precision;
        for i in 0..D {
            row.gradient[i] -= self.gradient[i] * one.precision;
        }
        (self.information > 0.0).then_some(row)
    }

    /// Variance of the emission in units of the variance of an arrival; 0 for other kinds.
    pub fn variance(&self, one: &Measurement<D>) -> f64 {
        match one.kind {
            Kind::Arrival => one.precision * one.precision / self.information,
            _ => 0.0,
        }
    }
}

/// Weighted median: the value at which the sum of the weights exceeds `half`, or the mean of two values if it
/// just equals `half`.
fn median(values: &mut [(f64, f64)], half: f64) -> f64 {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut sum = 0.0;
    for (i, (value, weight)) in values.iter().enumerate() {
        sum += weight;
        if sum > half * (1.0 + MARGIN) {
            return *value;
        }
        if sum >= half * (1.0 - MARGIN) {
            return 0.5 * (value + values[(i + 1).min(values.len() - 1)].0);
        }
    }
    f64::NAN
}

impl<const D: usize> Measured<D> {
    pub fn new(record: &Record<'_>, values: Vec<f64>) -> Self {
        let (mut list, mut column, mut first) = (Vec::new(), Vec::new(), vec![0]);
        let mut origins = Vec::with_capacity(record.len());
        for (t, own) in values.chunks_exact(record.width()).enumerate() {
            let stations = record.stations_at(t, D);
            let sigmas = record.sigmas_at(t);
            read(stations, record.axes_at(t, D), own, sigmas, |place, measurement| {
                list.push(measurement);
                column.push(place);
            });
            if let Some(at) = record.heights().filter(|&at| !own[at].is_nan()) {
                let (value, k) = (own[at] - stations[D - 1], record.receivers());
                list.push(Measurement::new(Kind::Height, k, [0.0; D], value, sigmas[at]));
                column.push(at);
            }
            first.push(list.len());
            origins.push(std::array::from_fn(|i| stations[i]));
        }
        let (width, is_timed) = (record.width(), list.iter().any(|one| one.kind == Kind::Arrival));
        Self { values, list, column, first, origins, width, is_timed }
    }

    /// Range of the indices of the measurements of an instant.
    pub fn instant(&self, t: usize) -> Range<usize> {
        self.first[t]..self.first[t + 1]
    }

    /// Number of stations.
    pub fn receivers(&self) -> usize {
        self.width / KINDS
    }

    /// Number of all measurements.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Number of measurements of an instant, less one if there are arrivals, which determines its emission.
    pub fn comparable(&self, t: usize) -> usize {
        let is_timed = self.instant(t).any(|m| self.list[m].kind == Kind::Arrival);
        self.instant(t).len() - usize::from(is_timed)
    }

    /// Whitened residuals and gradients of an instant at a position.
    pub fn rows(&self, t: usize, place: Place<D>) -> impl Iterator<Item = (usize, Row<D>)> {
        let p = self.relative(t, &place.position);
        let eye = place.eye.map(|eye| self.relative(t, &eye));
        self.instant(t).map(move |m| {
            let mut row = self.list[m].row(&p);
            if let Some(eye) = &eye {
                row.gradient = self.list[m].row(eye).gradient;
            }
            (m, row)
        })
    }

    /// Returns the emission of an instant from its arrivals at a position, with the given weights.
    pub fn emission(
        &self,
        t: usize,
        place: Place<D>,
        weight: impl Fn(usize) -> f64,
    ) -> Emission<D> {
        let mut sum = Emission::NONE;
        if !self.is_timed {
            return sum;
        }
        let mut offsets = Vec::new();
        for (m, row) in self.rows(t, place).filter(|(m, _)| self.list[*m].kind == Kind::Arrival) {
            let (own, precision) = (weight(m), self.precision(m));
            offsets.push((row.residual / precision, own * precision * precision));
            sum.information += own * precision * precision;
            add_multiple(&mut sum.gradient, own * precision, &row.gradient);
        }
        if offsets.iter().filter(|(_, weight)| *weight > 0.0).count() < 2 {
            return Emission::NONE;
        }
        sum.residual = median(&mut offsets, 0.5 * sum.information);
        sum.gradient.iter_mut().for_each(|v| *v /= sum.information);
        sum
    }

    /// Returns the emission with which all arrivals of an instant are compared. It is that of the trusted
    /// arrivals; as far as none is trusted, all have equal weights, because otherwise two arrivals that
    /// contradict each other would be trusted again.
    pub fn emission_for_all(
        &self,
        t: usize,
        place: Place<D>,
        trust: impl Fn(usize) -> f64,
    ) -> Emission<D> {
        let arrivals = self.instant(t).filter(|m| self.list[*m].kind == Kind::Arrival);
        let missing = (1.0 - arrivals.map(&trust).sum::<f64>()).max(LEAST_TRUST);
        self.emission(t, place, |m| trust(m) + missing)
    }

    /// Returns the column of an instant's arrival, if it has only one.
    pub fn lone_arrival(&self, t: usize) -> Option<usize> {
        let mut arrivals = self.instant(t).filter(|m| self.list[*m].kind == Kind::Arrival);
        let first = arrivals.next().filter(|_| arrivals.next().is_none())?;
        Some(self.column[first])
    }

    /// Columns of the arrivals of an instant, if it has two.
    pub fn pair(&self, t: usize) -> Option<[usize; 2]> {
        let arrivals = self.instant(t).filter(|m| self.list[*m].kind == Kind::Arrival);
        let columns: Vec<usize> = arrivals.map(|m| self.column[m]).collect();
        columns.try_into().ok()
    }

    /// Whether most instants have two arrivals, as where pairs of stations measure in turn.
    pub fn is_in_pairs(&self) -> bool {
        let count = self.first.len() - 1;
        self.is_timed && 2 * (0..count).filter(|&t| self.pair(t).is_some()).count() > count
    }

    /// Returns a position relative to the first station of an instant.
    pub fn relative(&self, t: usize, position: &[f64]) -> Vector<D> {
        std::array::from_fn(|i| position[i] - self.origins[t][i])
    }

    pub fn one(&self, m: usize) -> &Measurement<D> {
        &self.list[m]
    }

    /// 1/σ
    pub fn precision(&self, m: usize) -> f64 {
        self.list[m].precision
    }
}

/// Returns a value of a column, or nan if it cannot be measured.
pub(super) fn in_domain(column: usize, width: usize, value: f64) -> f64 {
    let inside = match column / (width / KINDS) {
        0 => value > 0.0,
        2 => value.abs() <= FRAC_PI_2,
        _ => true,
    };
    if inside { value } else { f64::NAN }
}

/// Returns the columns of these kinds that have any measurements; their biases are estimated.
pub(super) fn seen(record: &Record<'_>, biased: &[usize]) -> Vec<usize> {
    let (width, k) = (record.width(), record.width() / KINDS);
    let all = biased.iter().flat_map(|kind| kind * k..(kind + 1) * k);
    all.filter(|at| record.values.iter().skip(*at).step_by(width).any(|v| !v.is_nan())).collect()
}

/// Returns the jerk that bends a path, in the time of the record, by about the distance between the stations;
/// none if the stations are at one place.
pub(super) fn bending<const D: usize>(record: &Record<'_>) -> Option<f64> {
    let square = extent::<D>(record).powi(2);
    let jerk = square / (record.time.last()? - record.time.first()?).powi(5);
    (jerk > 0.0 && jerk.is_finite()).then_some(jerk)
}

/// Returns the distance over which the stations are spread.
pub(super) fn extent<const D: usize>(record: &Record<'_>) -> f64 {
    let spread = |axis: usize| {
        let own = record.stations.iter().skip(axis).step_by(D);
        let (low, high) = own.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(*value), high.max(*value))
        });
        (high - low).powi(2)
    };
    (0..D).map(spread).sum::<f64>().sqrt()
}
