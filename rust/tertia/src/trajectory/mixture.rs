//! Noise and outliers: how large and how many they are, and what a residual belongs to.

use crate::base::distribution::normal_two_sided_quantile;

/// Standard deviation of outliers over that of the noise: at least, as expected, and how many outliers
/// that is worth.
const LEAST_WIDTH: f64 = 3.0;
const WIDTH: f64 = 10.0;
const WORTH: f64 = 2.0;
/// Share of outliers: at the beginning, at most, and their number at least: one measurement in a record
/// without outliers is taken for one with a chance of about 1 %.
const SHARE: f64 = 0.1;
const LARGEST_SHARE: f64 = 0.5;
const LEAST_NUMBER: f64 = 0.5;
/// Outliers of either side that are expected besides: what is seen of a few says little of others.
const EITHER: f64 = 5.0;
/// Share of the residuals by whose size the noise is first taken, and the largest that it is.
const LARGE: f64 = 0.9;
const LARGEST: f64 = 1000.0;
/// Noise that is as stated, as far as such sizes tell.
const LARGER: f64 = 1.2;
/// By how much the noise is made smaller in a step.
const STEP: f64 = 0.6;
/// Steps of expectation and maximisation, and the relative change of the share that ends them.
const STEPS: usize = 30;
const SETTLED: f64 = 0.01;
/// One-sided 99 % of a normal variable.
const SURELY: f64 = 2.326;

/// Noise and outliers, both normal, in the stated standard deviations.
#[derive(Clone, Debug)]
pub(super) struct Mixture {
    /// Share of outliers.
    share: f64,
    /// Standard deviations of the noise and of what outliers have besides.
    pub noise: f64,
    width: f64,
    /// Share of the outliers of what travels that are late: detours are never shorter.
    late: f64,
    /// ln of the likelihood of the residuals, less, if there are outliers, 1/2 ln N for each of their
    /// parameters (Schwarz 1978), and 1 for each that the path has: it follows those that agree with it.
    pub log_evidence: f64,
}

/// A residual about what the others say.
pub(super) struct Compared {
    /// Where it stands.
    pub at: usize,
    pub residual: f64,
    /// Variance of what it is compared with.
    pub variance: f64,
    /// What it contributes to the number of parameters of the path.
    pub held: f64,
    /// Whether a signal travelled: by a detour it is late.
    pub travels: bool,
}

impl Mixture {
    /// For a path that may follow outliers: with a noise as large as the residuals.
    pub fn new(mut sizes: Vec<f64>) -> Self {
        let at = (LARGE * sizes.len() as f64) as usize;
        let noise = match sizes.len() {
            0 => 1.0,
            _ => {
                let size = *sizes.select_nth_unstable_by(at, f64::total_cmp).1;
                let noise = size / normal_two_sided_quantile(1.0 - LARGE);
                if noise < LARGER { 1.0 } else { noise.min(LARGEST) }
            }
        };
        Self { share: SHARE, noise, width: WIDTH * noise, late: 0.5, log_evidence: 0.0 }
    }

    /// With a smaller noise, if it is larger than stated.
    pub fn sharper(&self) -> Option<Self> {
        (self.noise > 1.0).then(|| Self { noise: (self.noise * STEP).max(1.0), ..self.clone() })
    }

    /// Densities of a residual of the noise, and of an outlier, each with its probability.
    pub fn densities(&self, one: &Compared) -> [f64; 2] {
        let inside = self.noise.powi(2) + one.variance;
        let outside = inside + self.width.powi(2);
        let density =
            |variance: f64| (-0.5 * one.residual * one.residual / variance).exp() / variance.sqrt();
        let side = match one.travels {
            true if one.residual > 0.0 => 2.0 * self.late,
            true => 2.0 * (1.0 - self.late),
            false => 1.0,
        };
        [(1.0 - self.share) * density(inside), side * self.share * density(outside)]
    }

    /// The likeliest share and size of outliers, and size of the noise unless it is held, by
    /// expectation and maximisation.
    pub fn fit(&mut self, residuals: &[Compared], is_held: bool) {
        for _ in 0..STEPS {
            let before = self.share;
            self.step(residuals, is_held);
            if (self.share - before).abs() < SETTLED * before {
                break;
            }
        }
    }

    fn step(&mut self, residuals: &[Compared], is_held: bool) {
        let (mut total, mut squares, mut outside, mut log) = (0.0, 0.0, 0.0, 0.0);
        let (mut late, mut either) = (EITHER, 2.0 * EITHER);
        for one @ Compared { residual, variance, .. } in residuals {
            let square = residual * residual;
            let densities = self.densities(one);
            let trust = trust_of(densities);
            total += trust;
            if one.travels {
                either += 1.0 - trust;
                late += if *residual > 0.0 { 1.0 - trust } else { 0.0 };
            }
            squares += trust * square / (1.0 + variance / self.noise.powi(2));
            outside += (1.0 - trust) * (square - variance).max(0.0);
            log += (densities[0] + densities[1]).max(f64::MIN_POSITIVE).ln();
        }
        let count = residuals.len() as f64;
        let is_mixed = self.share * count > LEAST_NUMBER * (1.0 + SETTLED);
        let held: f64 = residuals.iter().map(|one| one.held).sum();
        self.log_evidence = log - if is_mixed { count.ln() + held } else { 0.0 };
        if total == 0.0 {
            return;
        }
        self.share = (1.0 - total / count).max(LEAST_NUMBER / count).min(LARGEST_SHARE);
        if !is_held {
            // the first paths may be wrong, and then it is others that are late
            self.late = late / either;
            let growth = squares / total;
            let by_chance = 1.0 + SURELY * (2.0 / total).sqrt();
            self.noise = if growth > by_chance { growth.sqrt() } else { 1.0 };
        }
        let expected = (WIDTH * self.noise).powi(2);
        let width = (WORTH * expected + outside) / (WORTH + count - total);
        self.width = width.sqrt().max(LEAST_WIDTH * self.noise);
    }
}

/// Probability that a residual with these densities belongs to the noise: far from both it is an
/// outlier.
pub(super) fn trust_of([inside, outside]: [f64; 2]) -> f64 {
    if inside > 0.0 { inside / (inside + outside) } else { 0.0 }
}
