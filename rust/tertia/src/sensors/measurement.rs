//! A single measurement of a station: its prediction from a position, and the derivatives.

use crate::base::small::{Matrix, Vector, dot, norm, rotated, rotated_back};

/// Largest tangents for which five and nine terms of the series give the arctangent to the last bit.
const TINY_TANGENT: f64 = 0.01;
pub(crate) const SMALL_TANGENT: f64 = 0.1;
/// Coefficients of `t − t³/3 + t⁵/5 − …`, nine terms, without signs, from the last one to the second.
pub(crate) const TERMS: [f64; 8] =
    [1.0 / 17.0, 1.0 / 15.0, 1.0 / 13.0, 1.0 / 11.0, 1.0 / 9.0, 1.0 / 7.0, 1.0 / 5.0, 1.0 / 3.0];

/// Kind of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Range,
    Azimuth,
    Elevation,
    /// Range of a station minus that of the first station, which is the origin.
    RangeDifference,
    /// Time of arrival of a signal at a station, times its speed: the range plus the emission, which is
    /// common to all stations.
    Arrival,
    /// The last coordinate, which no station has measured.
    Height,
}

impl Kind {
    pub const ALL: [Self; super::KINDS] =
        [Self::Range, Self::Azimuth, Self::Elevation, Self::RangeDifference, Self::Arrival];

    pub fn is_angle(self) -> bool {
        matches!(self, Self::Azimuth | Self::Elevation)
    }

    /// Whether the value depends on the speed of the signals.
    pub fn travels(self) -> bool {
        matches!(self, Self::Range | Self::RangeDifference | Self::Arrival)
    }

    /// Whether the kind determines only differences of the distances from stations.
    pub fn is_difference(self) -> bool {
        matches!(self, Self::RangeDifference | Self::Arrival)
    }
}

/// A measured value, its station (relative to the first one) and its standard deviation.
#[derive(Clone, Debug)]
pub(crate) struct Measurement<const D: usize> {
    pub kind: Kind,
    /// Index of the station.
    pub index: usize,
    pub station: Vector<D>,
    pub value: f64,
    /// 1/σ
    pub precision: f64,
    pub sine: f64,
    pub cosine: f64,
    /// East, north and up at the station, for angles in three dimensions if they differ from those of the
    /// frame.
    pub axes: Option<Matrix<D>>,
}

/// A whitened residual, measured minus predicted, and the derivatives of the whitened prediction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row<const D: usize> {
    pub residual: f64,
    pub gradient: Vector<D>,
}

impl<const D: usize> Row<D> {
    /// Multiplies the row by a factor, which changes its units.
    #[inline(always)]
    pub fn scaled(mut self, factor: f64) -> Self {
        self.residual *= factor;
        for v in &mut self.gradient {
            *v *= factor;
        }
        self
    }
}

impl<const D: usize> Measurement<D> {
    pub fn new(kind: Kind, index: usize, station: Vector<D>, value: f64, sigma: f64) -> Self {
        let (sine, cosine) = if kind.is_angle() { value.sin_cos() } else { (0.0, 0.0) };
        Self { kind, index, station, value, precision: 1.0 / sigma, sine, cosine, axes: None }
    }

    /// Returns the measurement with angles relative to the axes of the station: its east, north and up,
    /// as rows.
    pub fn about(mut self, axes: &Matrix<D>) -> Self {
        if !self.kind.is_angle() {
            return self;
        }
        if D == 3 {
            self.axes = Some(*axes);
            return self;
        }
        // in the plane, a different north rotates the azimuth
        let mut direction = [0.0; D];
        (direction[0], direction[1]) = (self.sine, self.cosine);
        let direction = rotated_back(axes, &direction);
        (self.sine, self.cosine) = (direction[0], direction[1]);
        self
    }

    /// Path of the signals that are measured from a position relative to the first station; for a range
    /// difference, the difference of two paths.
    pub fn path(&self, p: &Vector<D>) -> f64 {
        let direct: Vector<D> = std::array::from_fn(|i| p[i] - self.station[i]);
        let reference = if self.kind == Kind::RangeDifference { norm(p) } else { 0.0 };
        norm(&direct) - reference
    }

    /// Residual and gradient at a state: a position and, if there is one more number, the emission of
    /// arrivals.
    #[inline(always)]
    pub fn row_at<const N: usize>(&self, x: &Vector<N>) -> Row<N> {
        let row = self.row(&std::array::from_fn(|i| x[i]));
        let mut gradient = [0.0; N];
        gradient[..D].copy_from_slice(&row.gradient);
        let mut residual = row.residual;
        if N > D && self.kind == Kind::Arrival {
            residual -= x[D] * self.precision;
            gradient[D] = self.precision;
        }
        Row { residual, gradient }
    }

    /// Residual and gradient at a position relative to the first station.
    #[inline(always)]
    pub fn row(&self, p: &Vector<D>) -> Row<D> {
        let mut d = *p;
        for i in 0..D {
            d[i] -= self.station[i];
        }
        match &self.axes {
            None => self.row_of(&d, p),
            Some(axes) => {
                let Row { residual, gradient } = self.row_of(&rotated(axes, &d), p);
                Row { residual, gradient: rotated_back(axes, &gradient) }
            }
        }
    }

    /// Residual and gradient for an offset from the station, in the axes of the station.
    #[inline(always)]
    fn row_of(&self, d: &Vector<D>, p: &Vector<D>) -> Row<D> {
        match self.kind {
            Kind::Range | Kind::Arrival => self.range(d),
            Kind::Azimuth => self.azimuth(d),
            Kind::Elevation => self.elevation(d),
            Kind::RangeDifference => self.range_difference(d, p),
            Kind::Height => self.height(d),
        }
    }

    #[inline]
    fn range(&self, d: &Vector<D>) -> Row<D> {
        let range = norm(d);
        let scale = self.precision / range;
        Row { residual: (self.value - range) * self.precision, gradient: d.map(|v| v * scale) }
    }

    #[inline]
    fn height(&self, d: &Vector<D>) -> Row<D> {
        let mut gradient = [0.0; D];
        gradient[D - 1] = self.precision;
        Row { residual: (self.value - d[D - 1]) * self.precision, gradient }
    }

    #[inline]
    fn range_difference(&self, d: &Vector<D>, p: &Vector<D>) -> Row<D> {
        let (range, first) = (norm(d), norm(p));
        // (r² − r0²) / (r + r0) loses fewer digits than r − r0 if the target is far away
        let station = &self.station;
        let difference = (dot(station, station) - 2.0 * dot(station, p)) / (range + first);
        let mut gradient = [0.0; D];
        for i in 0..D {
            gradient[i] = (d[i] / range - p[i] / first) * self.precision;
        }
        Row { residual: (self.value - difference) * self.precision, gradient }
    }

    /// Residual from sine and cosine of the difference, so that it is wrapped.
    #[inline]
    fn azimuth(&self, d: &Vector<D>) -> Row<D> {
        let [east, north] = [d[0], d[1]];
        let squared = east * east + north * north;
        let sine = east * self.cosine - north * self.sine;
        let cosine = east * self.sine + north * self.cosine;
        let scale = self.precision / squared;
        let mut gradient = [0.0; D];
        gradient[0] = north * scale;
        gradient[1] = -east * scale;
        Row { residual: -angle(sine, cosine) * self.precision, gradient }
    }

    #[inline]
    fn elevation(&self, d: &Vector<D>) -> Row<D> {
        let [east, north, up] = [d[0], d[1], d[D - 1]];
        let horizontal = (east * east + north * north).sqrt();
        let squared = horizontal * horizontal + up * up;
        let sine = up * self.cosine - horizontal * self.sine;
        let cosine = up * self.sine + horizontal * self.cosine;
        let scale = self.precision / squared;
        let tilt = -up / horizontal * scale;
        let mut gradient = [0.0; D];
        gradient[0] = east * tilt;
        gradient[1] = north * tilt;
        gradient[D - 1] = horizontal * scale;
        Row { residual: -angle(sine, cosine) * self.precision, gradient }
    }

    /// Whether the direction to a position is undefined: the position is at the station or directly above it.
    pub fn is_blind(&self, p: &Vector<D>, near: f64) -> bool {
        let mut d: Vector<D> = std::array::from_fn(|i| p[i] - self.station[i]);
        if let Some(axes) = &self.axes {
            d = rotated(axes, &d);
        }
        if self.kind == Kind::Height {
            return false;
        }
        let axes = if self.kind.is_angle() { 2 } else { D };
        let squared: f64 = d[..axes].iter().map(|v| v * v).sum();
        let first = self.kind == Kind::RangeDifference && norm(p) <= near;
        first || squared <= near * near
    }
}

/// `atan2(sine, cosine)`, by its series near zero: four times as fast as the library function.
#[inline(always)]
fn angle(sine: f64, cosine: f64) -> f64 {
    let size = sine.abs();
    if size <= TINY_TANGENT * cosine {
        return series::<5>(sine / cosine);
    }
    if size <= SMALL_TANGENT * cosine {
        return series::<9>(sine / cosine);
    }
    sine.atan2(cosine)
}

/// Sums this number of terms of `t − t³/3 + t⁵/5 − …`
#[inline(always)]
fn series<const TERMS: u8>(t: f64) -> f64 {
    let s = t * t;
    let mut sum = 0.0;
    for k in (1..TERMS).rev() {
        sum = s * (1.0 / f64::from(2 * k + 1) - sum);
    }
    t - t * sum
}

/// Returns the standard deviation of a measurement, relative to the common one if it is unknown (nan).
pub(crate) fn relative(sigma: f64) -> f64 {
    if sigma.is_nan() { 1.0 } else { sigma }
}

/// Reads the measurements of an instant, with the index of each number. The numbers are those of K
/// stations for each kind in turn, nan if missing. Positions are relative to the first station, which
/// costs no digits; an unknown σ is replaced by 1.
pub(crate) fn read<const D: usize>(
    stations: &[f64],
    axes: Option<&[f64]>,
    values: &[f64],
    sigmas: &[f64],
    mut add: impl FnMut(usize, Measurement<D>),
) {
    let count = stations.len() / D;
    for k in 0..count {
        let station: Vector<D> = std::array::from_fn(|i| stations[k * D + i] - stations[i]);
        for (at, kind) in Kind::ALL.into_iter().enumerate() {
            let place = at * count + k;
            let (value, sigma) = (values[place], sigmas[place]);
            if value.is_nan() {
                continue;
            }
            let measurement = Measurement::new(kind, k, station, value, relative(sigma));
            add(
                place,
                match axes {
                    None => measurement,
                    Some(axes) => measurement.about(&std::array::from_fn(|i| {
                        std::array::from_fn(|j| axes[(k * D + i) * D + j])
                    })),
                },
            );
        }
    }
}

/// Predicts the measurements of K stations for a position, without errors: K numbers of each kind, nan for
/// elevations in the plane. The arguments are those of an instant; `predicted` has 5 K numbers. O(K).
pub fn predict<const D: usize>(
    stations: &[f64],
    axes: Option<&[f64]>,
    position: &[f64],
    predicted: &mut [f64],
) {
    let zeros = vec![0.0; predicted.len()];
    let ones = vec![1.0; predicted.len()];
    let p: Vector<D> = std::array::from_fn(|i| position[i] - stations[i]);
    predicted.fill(f64::NAN);
    read(stations, axes, &zeros, &ones, |place, m: Measurement<D>| {
        if D == 3 || m.kind != Kind::Elevation {
            // minus the residual of a measured zero
            predicted[place] = -m.row(&p).residual;
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_series_is_the_arctangent() {
        for i in -100_i32..=100 {
            let t = f64::from(i) * 1e-3;
            let (sine, cosine) = t.atan().sin_cos();
            assert!((angle(sine, cosine) - sine.atan2(cosine)).abs() <= 3e-17, "{t}");
        }
        assert_eq!(angle(0.0, -1.0), std::f64::consts::PI);
    }

    #[test]
    fn gradients_are_differences() {
        let p = [300.0, -200.0, 150.0];
        let station = [40.0, 70.0, -20.0];
        let axes = [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]];
        let kinds = Kind::ALL.into_iter().chain([Kind::Height]);
        let measurements: Vec<_> =
            kinds.map(|kind| Measurement::new(kind, 1, station, 0.5, 0.1)).collect();
        let tilted: Vec<_> =
            measurements.iter().map(|measurement| measurement.clone().about(&axes)).collect();
        for measurement in measurements.into_iter().chain(tilted) {
            let kind = measurement.kind;
            let row = measurement.row(&p);
            for i in 0..3 {
                let shifted = |by: f64| {
                    let mut q = p;
                    q[i] += by;
                    measurement.row(&q).residual
                };
                let slope = (shifted(-1e-3) - shifted(1e-3)) / 2e-3;
                assert!((slope - row.gradient[i]).abs() < 1e-7 * (1.0 + slope.abs()), "{kind:?}");
            }
        }
    }
}
