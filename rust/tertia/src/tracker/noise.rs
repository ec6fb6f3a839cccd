//! Estimates by how much the noise of a sensor differs from its stated noise, from the plots of its confirmed
//! tracks alone.
//!
//! Third differences of plots in four successive scans are free of positions, velocities and constant
//! accelerations. The median of their squares yields the noise, whatever outliers there are. Products of the
//! signs of second differences, one and two scans apart, show whether errors are correlated from scan to scan:
//! their contrast is nearly free of accelerations, too. Differences of targets that turn for long are left out.
//! The estimates do not depend on the filters, which use the estimated noise.

pub(super) mod copies;
pub(super) mod duplicates;
pub(super) mod lasting;
pub(super) mod outliers;
pub(super) mod repeats;
mod turning;
mod unidentified;

use super::errors::differences::{ENOUGH, SURE, Size, THIRD, WINDOW};
use super::errors::quality::{Quality, Reports};
use super::errors::rounding::Values;
use super::plot::individual::{Individual, key};
use super::plot::{Measured, Plot, Source, stated};
use super::settings::Settings;
use crate::base::plane::Plane;
use crate::sensors::{Detection, Radar};
use outliers::Outliers;
use repeats::Interval;
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_2_PI;
use turning::Turning;
use unidentified::Unidentified;

/// Number of tracks of a sensor that are used at the same time.
const TRACKS: u64 = 64;
/// Standard deviations, times the root of the number of differences, of the contrast if errors are independent,
/// and of the contrast if they are correlated (simulated, because differences share plots).
const CONTRAST: f64 = 3.0;
const CONTRAST_LASTING: f64 = 2.4;
/// Number of sigmas by which errors must be correlated before this is used.
const SURE_LASTING: f64 = 3.0;
/// Square of a second difference that only a manoeuvre causes, in the variances of third differences; that of
/// errors is a third, whatever their correlation.
const MANOEUVRE: f64 = 9.0 / 3.0;
/// Mean product of the signs of successive second differences above which most of them are due to the motion:
/// that of errors is -1/3 at the most, whatever their correlation.
const AT_MOST: f64 = -0.1;
/// Share of the plots of targets that turn for long from which on errors are taken as independent.
const TURNING: f64 = 0.15;
/// Standard deviation, times the root of the number of differences, of the mean product of those two scans apart:
/// it is not negative by errors and accelerations, but by sharp turns.
const PRODUCT: f64 = 1.3;
/// Share of an innovation by which a track usually moves: the effect of correlated noise on a track depends
/// on it. It is 0 for tracks that are smoothed over many plots.
const GAIN: f64 = 0.3;
pub(super) const SMOOTHING: f64 = 0.0;
/// Ratio of the estimated to the stated noise above which a recording is tracked again.
const DIFFERENT: f64 = 1.1;
/// Largest correlation from scan to scan.
const MOST: f64 = 0.9;
/// Largest difference between the durations of two successive scans, as a share.
const EVEN: f64 = 0.1;

/// How far errors are correlated from scan to scan, from both coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Lasting {
    count: f64,
    /// Mean products of the signs of second differences one and two scans apart.
    products: [f64; 2],
    /// Number of plots, and share of those of targets that turn for long.
    plots: f64,
    turning: f64,
}

impl Lasting {
    /// Updates the products by second differences, the last first. Their signs alone count, as those in turns
    /// are large.
    fn saw(&mut self, [last, one, two]: [f64; 3]) {
        self.count = (self.count + 1.0).min(2.0 * WINDOW);
        for (mean, other) in self.products.iter_mut().zip([one, two]) {
            *mean += ((last * other).signum() - *mean) / self.count;
        }
    }

    /// Learns from a plot whether its target turns for long.
    fn turns(&mut self, is_turning: bool) {
        self.plots = (self.plots + 1.0).min(WINDOW);
        self.turning += (f64::from(u8::from(is_turning)) - self.turning) / self.plots;
    }

    /// Smallest and largest likely correlation from scan to scan; none if errors may be independent, or if so many
    /// targets turn that those among them that are not recognised may have caused it.
    fn correlation(&self) -> Option<[f64; 2]> {
        let root = self.count.sqrt();
        let [one, two] = self.products;
        let contrast = (one - two) / (1.0 - two);
        let least = contrast_of(0.0) + SURE_LASTING * CONTRAST / root;
        let is_sure = self.count > 2.0 * ENOUGH && contrast > least && one < AT_MOST;
        let is_sure = is_sure && self.turning < TURNING && two > -SURE * PRODUCT / root;
        let within = SURE * CONTRAST_LASTING / root;
        is_sure.then(|| [-within, within].map(|off| correlation(contrast_of, contrast + off)))
    }
}

/// Ratio of two variances: of white noise, independent from scan to scan, that has the same effect on a track
/// with this gain as the estimated noise, and of the stated noise. It is 1 unless it is significantly larger.
fn factor(size: &Size, lasting: &Lasting, gain: f64) -> f64 {
    let variance = size.level.exp();
    match lasting.correlation() {
        _ if size.count < ENOUGH => 1.0,
        Some([least, most]) => {
            // the stated noise is believed as far as the likely correlations allow
            let own = correlation(|r| -third_of(r), -variance).clamp(least, most);
            let kept = own * (1.0 - gain);
            (variance / third_of(own) * (1.0 + kept) / (1.0 - kept)).max(1.0)
        }
        None => size.sure(variance),
    }
}

/// Ratio of the variance of third differences of errors with this correlation from scan to scan to that of
/// independent errors.
fn third_of(r: f64) -> f64 {
    (1.0 - r) * (10.0 - r * (5.0 - r)) / 10.0
}

/// Contrast (c₁ − c₂) / (1 − c₂) of the mean products cₖ of the signs of second differences k scans apart, for
/// normal errors with this correlation from scan to scan.
fn contrast_of(r: f64) -> f64 {
    let zero = 6.0 - r * (8.0 - 2.0 * r);
    let one = r * (7.0 - r * (4.0 - r)) - 4.0;
    let two = 1.0 - r * (4.0 - r * (6.0 - r * (4.0 - r)));
    let [one, two] = [one, two].map(|c| FRAC_2_PI * (c / zero).asin());
    (one - two) / (1.0 - two)
}

/// Returns the correlation for which an increasing function has this value.
fn correlation(function: impl Fn(f64) -> f64, value: f64) -> f64 {
    let (mut low, mut high) = (0.0, MOST);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if function(middle) < value { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Plots of a track by one sensor in successive scans.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Chain {
    track: u64,
    count: usize,
    /// Times and positions of the last plots, the last first.
    times: [f64; 2],
    positions: [[f64; 2]; 4],
    /// Whether the plots have no heights and were placed at assumed ones: plots with heights have other
    /// positions.
    is_slant: bool,
    /// The channels that detected the plots.
    detection: Option<Detection>,
    turning: Turning,
}

/// The noise of one sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Noise {
    /// Standard deviations of range and azimuth as stated.
    stated: [f64; 2],
    /// Standard deviations of range and azimuth as they were used last.
    pub used: [f64; 2],
    sizes: [Size; 2],
    lasting: Lasting,
    pub outliers: Outliers,
    pub interval: Interval,
    pub unidentified: Unidentified,
    /// Errors of the reports of a sensor of positions.
    pub reports: Reports,
    pub individual: Individual,
    /// Ranges and azimuths, or coordinates.
    pub values: Values,
    chains: Vec<Chain>,
}

impl Noise {
    pub fn new(radar: &Radar) -> Self {
        let stated = [radar.range_sigma, radar.azimuth_sigma];
        Self {
            stated,
            used: stated,
            sizes: <[_; 2]>::default(),
            lasting: Lasting::default(),
            outliers: Outliers::default(),
            interval: Interval::new(radar.scan_period),
            unidentified: Unidentified::default(),
            reports: Reports::default(),
            individual: Individual::default(),
            values: Values::default(),
            chains: Vec::new(),
        }
    }

    /// Starts again with the estimates so far: the plots that follow belong to new tracks.
    pub fn restart(&mut self) {
        self.chains.clear();
        self.reports.restart();
        self.individual.restart();
    }

    /// Learns from the values of a plot, with this range and azimuth before corrections, whether they are rounded.
    #[cold]
    pub fn saw_values(&mut self, plot: &Plot, measured: [f64; 2], settings: &Settings) {
        match plot.report {
            Some(own) if settings.geometry(plot.radar).is_position() => {
                let Plane { xx, yy, .. } =
                    stated(own.covariance, self.stated[0]).unwrap_or_default();
                self.values.saw_coordinates(own.position, [xx.sqrt(), yy.sqrt()]);
            }
            _ => self.values.saw(measured, self.stated),
        }
    }

    /// Updates the estimates by a plot of a confirmed track.
    pub fn saw(&mut self, track: u64, plot: &Measured, settings: &Settings) {
        self.outliers.saw();
        if settings.geometry(plot.radar).is_position() {
            return self.saw_report(track, plot, settings);
        }
        let Radar { scan_period: period, position: origin, .. } = settings.radars[plot.radar];
        if self.reports.may_be_rounded() {
            let azimuth = (plot.position[0] - origin[0]).atan2(plot.position[1] - origin[1]);
            self.reports.saw_plot(plot.time, azimuth, period);
        }
        let place = (track % TRACKS) as usize;
        if self.chains.is_empty() {
            self.chains = vec![Chain::default(); TRACKS as usize];
        }
        let chain = &mut self.chains[place];
        let age = plot.time - chain.times[0];
        if chain.track != track && chain.count > 0 && age >= 0.0 && age < 3.0 * period {
            return;
        }
        let before = chain.times[0] - chain.times[1];
        let even = age > 0.0 && (chain.count < 2 || (age - before).abs() < EVEN * before);
        let is_slant = matches!(plot.source, Source::Slant { .. });
        let is_alike = is_slant == chain.is_slant && plot.detection == chain.detection;
        if chain.track != track || !even || age > 1.5 * period || !is_alike {
            chain.count = 0;
        }
        if chain.track != track {
            chain.turning = Turning::default();
        }
        let [a, b, c, d] = chain.positions;
        let z = plot.position;
        if chain.count >= 3 {
            let way = settings.radars[plot.radar].way(plot.detection);
            let stated = way.map_or(self.stated, |way| way.sigmas);
            let (direction, sigmas) = axes(stated, plot, settings);
            let second = |x: [f64; 2], y: [f64; 2], z: [f64; 2]| {
                let [east, north] = [0, 1].map(|i| x[i] - 2.0 * y[i] + z[i]);
                let along = east * direction[0] + north * direction[1];
                let across = east * direction[1] - north * direction[0];
                [along / sigmas[0], across / sigmas[1]]
            };
            let seconds = [second(z, a, b), second(a, b, c), second(b, c, d)];
            chain.turning.saw(seconds[0], seconds[1]);
            let is_turning = chain.turning.is_likely();
            self.lasting.turns(is_turning);
            let used = if is_turning { &mut [] } else { &mut self.sizes[..] };
            for (i, size) in used.iter_mut().enumerate() {
                let own = seconds.map(|second| second[i]);
                if own.iter().all(|d| d.is_finite()) {
                    size.saw(own[0] - own[1]);
                    let most = MANOEUVRE * THIRD * size.level.exp();
                    if chain.count >= 4 && own.iter().all(|d| d * d < most) {
                        self.lasting.saw(own);
                    }
                }
            }
        }
        *chain = Chain {
            track,
            count: chain.count + 1,
            times: [plot.time, chain.times[0]],
            positions: [z, a, b, c],
            is_slant,
            detection: plot.detection,
            turning: chain.turning,
        };
    }

    /// The same for a plot of a sensor that reports positions. The scatter of plots of targets that are larger
    /// than the resolution of the sensor says nothing about its noise.
    fn saw_report(&mut self, track: u64, plot: &Measured, settings: &Settings) {
        if let Some(age) = self.reports.age(track, plot.time) {
            self.interval.saw(age);
        }
        if let Some(noise) = plot.source.placed() {
            let ratio = settings.quality(plot.radar).ratio;
            if settings.radars[plot.radar].extent > 0.0 {
                return self.reports.saw(track, plot, noise.scaled(f64::NAN));
            }
            let noise = self.individual.basis(key(&plot.identities), noise);
            self.reports.saw(track, plot, noise.scaled(1.0 / ratio));
        }
    }

    /// Updates the noise of single targets by a report with an identity, whichever track it may belong to.
    pub fn saw_identity(&mut self, plot: &Measured, settings: &Settings) {
        let is_point = settings.radars[plot.radar].extent == 0.0;
        if !is_point || !settings.geometry(plot.radar).is_position() {
            return;
        }
        if let (Some(noise), Some(key)) = (plot.source.placed(), key(&plot.identities)) {
            let Quality { ratio, clock, .. } = settings.quality(plot.radar);
            let (place, ratios) = ((plot.time, plot.position), (ratio, self.reports.ratio()));
            self.individual.saw(key, place, (noise, clock), ratios);
        }
    }

    /// How plots differ from what the sensor states, apart from the noise of a radar.
    pub fn quality(&self) -> Quality {
        self.reports.quality(self.interval.stated)
    }

    /// Whether the estimated noise is so large that tracks would differ.
    pub fn differs(&self) -> bool {
        let is_noisier = |(found, stated): (f64, f64)| found > DIFFERENT * stated;
        let Quality { ratio, clock, .. } = self.quality();
        let is_other = ratio > DIFFERENT * DIFFERENT || clock > 0.0;
        is_other
            || self.individual.differs()
            || self.values.variances() != [0.0; 2]
            || self.interval.is_shorter()
            || self.found().into_iter().zip(self.stated).any(is_noisier)
    }

    /// Noise factor of both coordinates together, estimated over stated sigma; nan before there are enough
    /// plots.
    pub fn told(&self) -> f64 {
        if let Some(ratio) = self.reports.ratio() {
            // if the differences are motion alone, nothing is known of the noise
            return if ratio > 0.0 { ratio.sqrt() } else { f64::NAN };
        }
        let [along, across] = self.sizes.map(|size| {
            let (factor, own) = (factor(&size, &self.lasting, GAIN), size.level.exp());
            if factor > 1.0 { factor.max(own) } else { own }
        });
        let is_known = self.sizes[0].count >= ENOUGH;
        if is_known { (along * across).powf(0.25) } else { f64::NAN }
    }

    /// Returns the standard deviations of range and azimuth for tracking: the `assumed` ones, or the
    /// estimated ones if these are larger.
    pub fn use_with(&mut self, assumed: [f64; 2]) -> [f64; 2] {
        let (assumed, factors) = (self.values.recorded(assumed), self.factors(GAIN));
        self.used = [0, 1].map(|i| {
            let factor = factors[i];
            if factor > 1.0 { assumed[i].max(factor.sqrt() * self.stated[i]) } else { assumed[i] }
        });
        self.used
    }

    /// Estimated standard deviations of range and azimuth for tracking; 0 unless they are significantly
    /// larger than stated.
    pub fn found(&self) -> [f64; 2] {
        let factors = self.factors(GAIN);
        [0, 1].map(|i| if factors[i] > 1.0 { factors[i].sqrt() * self.stated[i] } else { 0.0 })
    }

    /// Ratios of estimated to stated variances, along and across the beam, for tracks with this gain.
    pub fn factors(&self, gain: f64) -> [f64; 2] {
        self.sizes.map(|size| factor(&size, &self.lasting, gain))
    }
}

/// Gives the radars their estimated noise; returns the noise that was assumed before.
pub(super) fn use_found(radars: &mut [Radar], noise: &mut [Noise]) -> Vec<[f64; 2]> {
    let assumed: Vec<_> = radars.iter().map(|r| [r.range_sigma, r.azimuth_sigma]).collect();
    let found: Vec<_> = noise.iter_mut().zip(&assumed).map(|(n, own)| n.use_with(*own)).collect();
    for ((radar, noise), own) in radars.iter_mut().zip(&*noise).zip(&assumed) {
        if let Some(ways) = &mut radar.ways {
            ways.assume(noise.values.recorded(*own), noise.stated, noise.factors(GAIN));
        }
    }
    assume(radars, &found);
    assumed
}

/// Gives the radars these standard deviations.
pub(super) fn assume(radars: &mut [Radar], sigmas: &[[f64; 2]]) {
    for (radar, sigmas) in radars.iter_mut().zip(sigmas) {
        [radar.range_sigma, radar.azimuth_sigma] = *sigmas;
    }
}

/// A direction at a plot, and the stated standard deviations along and across it, m.
fn axes(stated: [f64; 2], plot: &Measured, settings: &Settings) -> ([f64; 2], [f64; 2]) {
    let placed = plot.source.placed();
    let origin = settings.radars[plot.radar].position;
    let away = [0, 1].map(|i| plot.position[i] - origin[i]);
    let distance = away[0].hypot(away[1]);
    let direction = away.map(|x| x / distance);
    // the noise of plots of extended targets includes their spread
    if let Some(noise) = placed.filter(|_| settings.radars[plot.radar].extent > 0.0) {
        let across = [direction[1], -direction[0]];
        return (direction, [direction, across].map(|axis| noise.form(axis).sqrt()));
    }
    (direction, [stated[0], stated[1] * distance])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::base::random::Random;
    use crate::sensors::radar_of;
    use crate::tracker::{ImmModel, Motion};
    use std::f64::consts::{FRAC_PI_2, TAU};

    /// The estimated noise of a radar that states 50 m and 0.001 rad, by sixteen straight tracks.
    fn found(noise: f64, correlation: f64, outliers: usize) -> Noise {
        let radar = radar_of([50.0, 1e-3]);
        let settings = Settings::new(vec![radar.clone()], Motion::Imm(ImmModel::default()));
        let (mut found, mut random) = (Noise::new(&radar), Random::new(5));
        let mut normal = || {
            let (size, angle) = (1.0 - random.uniform(), TAU * random.uniform());
            (-2.0 * size.ln()).sqrt() * angle.cos()
        };
        let fresh = (1.0 - correlation * correlation).sqrt();
        for track in 1..17 {
            let mut error = [normal(), normal()];
            for scan in 0..300 {
                error = error.map(|e| correlation * e + fresh * normal());
                let far = if outliers > 0 && scan % outliers == 0 { 20.0 } else { 1.0 };
                let time = 4.0 * f64::from(scan as u32);
                // targets fly north: errors of the range are north, those of the azimuth east
                let north = 60e3 + 3e3 * f64::from(track as u32) + 50.0 * time;
                let off = error.map(|e| far * noise * e);
                let position = [off[1] * 1e-3 * north, north + 50.0 * off[0]];
                found.saw(track, &Measured { time, position, ..Measured::default() }, &settings);
            }
        }
        found
    }

    #[test]
    fn noise_is_found_whatever_outliers_there_are_and_used_where_it_is_more() {
        let stated = [50.0, 1e-3];
        assert_within(0.06, found(1.0, 0.0, 0).told(), 1.0);
        assert_within(0.06, found(0.5, 0.0, 0).told(), 0.5);
        assert_eq!(found(0.5, 0.0, 0).use_with(stated), stated);
        let mut twice = found(2.0, 0.0, 0);
        assert_within(0.1, twice.told(), 2.0);
        let [range, azimuth] = twice.use_with(stated);
        assert!((1.75..2.1).contains(&(range / 50.0)) && (1.75..2.1).contains(&(azimuth / 1e-3)));
        assert!(twice.differs() && !found(1.0, 0.0, 0).differs());
        // a larger noise may be assumed for other reasons
        assert_eq!(twice.use_with([500.0, 1e-2]), [500.0, 1e-2]);
        assert_within(0.5, found(1.0, 0.0, 12).told(), 1.2);
        assert!(Noise::new(&radar_of(stated)).told().is_nan());
    }

    #[test]
    fn errors_that_last_count_as_more_noise() {
        // white noise with the same effect has the factor of the root of (1 + .49) / (1 - .49)
        let mut lasting = found(1.0, 0.7, 0);
        let [range, azimuth] = lasting.use_with([50.0, 1e-3]);
        for factor in [range / 50.0, azimuth / 1e-3] {
            assert!((1.4..2.2).contains(&factor), "{factor}");
        }
    }

    #[test]
    fn correlations_are_those_of_their_differences() {
        for r in [0.1, 0.3, 0.7] {
            // covariances of the second differences of first-order autoregressive errors
            let c = |k: i32| {
                let r = |lag: i32| f64::powi(r, lag.abs());
                6.0 * r(k) - 4.0 * (r(k - 1) + r(k + 1)) + r(k - 2) + r(k + 2)
            };
            assert_within(1e-12, third_of(r), 2.0 * (c(0) - c(1)) / THIRD);
            let sign = |k: i32| (c(k) / c(0)).asin() / FRAC_PI_2;
            assert_within(1e-12, contrast_of(r), (sign(1) - sign(2)) / (1.0 - sign(2)));
            assert_within(1e-6, correlation(contrast_of, contrast_of(r)), r);
        }
    }
}
