//! Tails and quantiles of the normal, Student and F distributions.
//!
//! The gamma family comes from the `special` crate. The incomplete beta function is written out
//! here because the usual interface `I_x(a, b)` takes only x: for a sample of N the Student tail
//! needs `(1 + t²/ν)^(-ν/2)`, and with x rounded to a double that power loses log10(N) digits
//! (measured: 1.7e-10 at ν = 1e5). Given x and 1 − x separately, nothing is lost.

use special::{Error as _, Gamma};

/// Above this value of `t²/ν` only the leading term of a tail remains, and the square may overflow.
const FAR: f64 = 1e280;
const LN_SQRT_PI: f64 = 0.572_364_942_924_700_1;
const HALF_LN_TWO_PI: f64 = 0.918_938_533_204_672_7;
/// Series end at a term of this share, because the remaining terms fall ever faster and are negligible.
const SMALLEST_TERM: f64 = 1e-20;
/// From this argument on, the Stirling remainder below is exact to double precision.
const STIRLING_FROM: f64 = 20.0;

/// `P(|Z| > 2)` of a normal variable, as it is usually rounded.
pub(crate) const OUTSIDE_TWO_SIGMA: f64 = 0.0455;
/// From this number of degrees of freedom on, the cube root of chi-square is normal to within 1e-7.
const CUBE_ROOT_FROM: f64 = 1e5;

/// Number of terms of the series of artanh r for r up to 1/4.
const ARTANH_TERMS: i32 = 14;

/// `P(|Z| > t)` of a standard normal variable.
pub fn normal_two_sided(t: f64) -> f64 {
    (t * std::f64::consts::FRAC_1_SQRT_2).compl_error()
}

/// The t with `P(|Z| > t) = p`, for 0 < p < 1.
pub fn normal_two_sided_quantile(p: f64) -> f64 {
    solve_decreasing(normal_two_sided, p)
}

/// `P(|T| > t)` of Student's distribution with `nu` degrees of freedom.
pub fn student_two_sided(t: f64, nu: f64) -> f64 {
    // P(|T| > t) = I_x(ν/2, 1/2), x = ν / (ν + t²)
    let r = t * t / nu;
    if r > FAR {
        let ln_x = nu.ln() - 2.0 * t.ln();
        return (0.5 * nu * ln_x - (0.5 * nu).ln() - ln_beta(0.5 * nu, 0.5)).exp();
    }
    incomplete_beta(0.5 * nu, 0.5, 1.0 / (1.0 + r), r / (1.0 + r))
}

/// The t with `P(|T| > t) = p`, for 0 < p < 1.
pub fn student_two_sided_quantile(p: f64, nu: f64) -> f64 {
    solve_decreasing(|t| student_two_sided(t, nu), p)
}

/// `P(F > f)` of Fisher's distribution with `nu1` and `nu2` degrees of freedom.
pub fn fisher_upper(f: f64, nu1: f64, nu2: f64) -> f64 {
    // P(F > f) = I_x(ν2/2, ν1/2), x = ν2 / (ν2 + ν1 f)
    let r = nu1 * f / nu2;
    if r.is_infinite() {
        return 0.0;
    }
    incomplete_beta(0.5 * nu2, 0.5 * nu1, 1.0 / (1.0 + r), r / (1.0 + r))
}

/// The f with `P(F > f) = p`, for 0 < p < 1.
pub fn fisher_upper_quantile(p: f64, nu1: f64, nu2: f64) -> f64 {
    solve_decreasing(|f| fisher_upper(f, nu1, nu2), p)
}

/// `P(X > x)` of the chi-square distribution with `nu` degrees of freedom. Cost O(nu) at most.
///
/// With h = x/2 it is the sum of `h^a e^-h / Γ(a+1)` over a = ν/2 − 1, ν/2 − 2, … ≥ 0, plus the normal
/// tail for odd ν. All terms are positive. The sum starts at its largest term.
pub fn chi_square_upper(x: f64, nu: usize) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    if x == f64::INFINITY {
        return 0.0;
    }
    let (h, top) = (0.5 * x, 0.5 * nu as f64 - 1.0);
    let tail = if nu % 2 == 1 { normal_two_sided(x.sqrt()) } else { 0.0 };
    if top < 0.0 {
        return tail;
    }
    let lowest = top.fract();
    let largest = top.min(lowest + (h - lowest).floor().max(0.0));
    let first = poisson(largest, h);
    let mut sum = first;
    let (mut term, mut a) = (first, largest);
    while a < top && term > SMALLEST_TERM * sum {
        a += 1.0;
        term *= h / a;
        sum += term;
    }
    (term, a) = (first, largest);
    while a > lowest && term > SMALLEST_TERM * sum {
        term *= a / h;
        a -= 1.0;
        sum += term;
    }
    (sum + tail).min(1.0)
}

/// `P(X > x)` of the chi-square distribution with any number `nu` > 0 of degrees of freedom, to
/// about 1e-10; for large `nu`, with the cube root of Wilson and Hilferty (1931), to 1e-7.
pub fn chi_square_upper_real(x: f64, nu: f64) -> f64 {
    if nu < CUBE_ROOT_FROM {
        return 1.0 - (0.5 * x).inc_gamma(0.5 * nu);
    }
    let variance = 2.0 / (9.0 * nu);
    let t = ((x / nu).cbrt() - 1.0 + variance) / variance.sqrt();
    let outside = 0.5 * normal_two_sided(t.abs());
    if t < 0.0 { 1.0 - outside } else { outside }
}

/// `h^a e^-h / Γ(a+1)`, without the cancellation of numbers of the size of a.
fn poisson(a: f64, h: f64) -> f64 {
    if a < STIRLING_FROM {
        return (a * h.ln() - h - ln_gamma(a + 1.0)).exp();
    }
    (a * ln_1p_less_x((h - a) / a) - 0.5 * a.ln() - HALF_LN_TWO_PI - stirling_remainder(a)).exp()
}

/// `ln(1 + x) − x`.
fn ln_1p_less_x(x: f64) -> f64 {
    if x.abs() > 0.4 {
        return x.ln_1p() - x;
    }
    // ln(1 + x) = 2 artanh r, r = x / (2 + x), and x − 2 r = x r
    let r = x / (2.0 + x);
    let (square, mut power, mut sum) = (r * r, r, 0.0);
    for k in 1..ARTANH_TERMS {
        power *= square;
        sum += power / f64::from(2 * k + 1);
    }
    2.0 * sum - x * r
}

/// The x with `P(X > x) = p`, for 0 < p < 1.
pub fn chi_square_upper_quantile(p: f64, nu: usize) -> f64 {
    solve_decreasing(|x| chi_square_upper(x, nu), p)
}

/// Regularised incomplete beta function `I_x(a, b)` with `y = 1 − x` given as well.
fn incomplete_beta(a: f64, b: f64, x: f64, y: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if y <= 0.0 {
        return 1.0;
    }
    if x < (a + 1.0) / (a + b + 2.0) {
        beta_fraction(a, b, x, y)
    } else {
        1.0 - beta_fraction(b, a, y, x)
    }
}

/// `x^a y^b / B(a, b)` divided by the continued fraction of DiDonato and Morris (1992), by Lentz's
/// method. Its terms contain `a y − b x`, which does not suffer from cancellation, instead of
/// `1 − (a+b) x/(a+1)`, which does.
fn beta_fraction(a: f64, b: f64, x: f64, y: f64) -> f64 {
    const MAX_TERMS: usize = 100_000;
    let ln_front = a * ln_given_complement(x, y) + b * ln_given_complement(y, x) - ln_beta(a, b);
    let lambda = a * y - b * x;
    let denominator = |m: f64| {
        m + m * (b - m) * x / (a + 2.0 * m - 1.0)
            + (a + m) * (lambda + 1.0 + m * (1.0 + y)) / (a + 2.0 * m + 1.0)
    };
    let numerator = |m: f64| {
        let t = x / (a + 2.0 * m - 1.0);
        (a + m - 1.0) * (a + b + m - 1.0) * m * (b - m) * t * t
    };
    let mut fraction = a * (lambda + 1.0) / (a + 1.0);
    let (mut c, mut d) = (fraction, 0.0);
    for term in 1..MAX_TERMS {
        let m = term as f64;
        d = 1.0 / (denominator(m) + numerator(m) * d);
        c = denominator(m) + numerator(m) / c;
        fraction *= c * d;
        if (c * d - 1.0).abs() <= f64::EPSILON {
            break;
        }
    }
    ln_front.exp() / fraction
}

/// `ln Γ(x)`.
pub fn ln_gamma(x: f64) -> f64 {
    Gamma::ln_gamma(x).0
}

/// `ln x`, computed from `1 − x` if that is the smaller one.
fn ln_given_complement(x: f64, complement: f64) -> f64 {
    if complement < 0.5 { (-complement).ln_1p() } else { x.ln() }
}

/// `ln B(a, b)` without the cancellation of three large log-gammas.
fn ln_beta(a: f64, b: f64) -> f64 {
    let (small, large) = if a < b { (a, b) } else { (b, a) };
    let ln_gamma_small = if small == 0.5 { LN_SQRT_PI } else { ln_gamma(small) };
    if large < STIRLING_FROM {
        return ln_gamma_small + ln_gamma(large) - ln_gamma(small + large);
    }
    let total = small + large;
    if small < STIRLING_FROM {
        // ln Γ(l) − ln Γ(l + s), by Stirling's series
        return ln_gamma_small - small * large.ln() - (total - 0.5) * (small / large).ln_1p()
            + small
            + stirling_remainder(large)
            - stirling_remainder(total);
    }
    HALF_LN_TWO_PI - 0.5 * small.ln()
        + (large - 0.5) * ln_given_complement(large / total, small / total)
        + small * (small / total).ln()
        + stirling_remainder(small)
        + stirling_remainder(large)
        - stirling_remainder(total)
}

/// `ln Γ(x) − [(x − 1/2) ln x − x + ½ ln 2π]` for x ≥ [`STIRLING_FROM`].
fn stirling_remainder(x: f64) -> f64 {
    const B: [f64; 6] =
        [1.0 / 12.0, -1.0 / 360.0, 1.0 / 1260.0, -1.0 / 1680.0, 1.0 / 1188.0, -691.0 / 360_360.0];
    let z = 1.0 / (x * x);
    B.iter().rev().fold(0.0, |sum, &b| sum * z + b) / x
}

/// Half of the half-width h of the interval that contains 95.45 %: the equivalent of the sigma of a normal
/// variable. A variable is outside with probability `outside(h)`; `unit` is the order of magnitude of h.
pub fn two_sigma(outside: impl Fn(f64) -> f64, unit: f64) -> f64 {
    0.5 * unit * solve_decreasing(|h| outside(h * unit), OUTSIDE_TWO_SIGMA)
}

/// An end of a bracket.
#[derive(Clone, Copy, PartialEq)]
enum End {
    Low,
    High,
}

/// Finds the x > 0 with `f(x) = target`, where f decreases from at most +∞ to 0. The method is false
/// position (Illinois) on logarithmic axes, on which tails are nearly straight. The result is 0 or +∞
/// if f is below or above the target everywhere, and nan if f is.
fn solve_decreasing(f: impl Fn(f64) -> f64, target: f64) -> f64 {
    const MAX_STEPS: usize = 400;
    const LEAST: f64 = -1e300;
    let ln_target = target.ln();
    let excess = |s: f64| {
        let ln = f(s.exp()).ln();
        if ln < LEAST { LEAST - ln_target } else { ln - ln_target }
    };
    let (mut low, mut high) = (0.0_f64, 0.0_f64);
    let mut f_low = excess(low);
    let mut f_high = f_low;
    let mut step = 1.0;
    while f_low < 0.0 && low.exp() > 0.0 {
        low -= step;
        f_low = excess(low);
        step *= 2.0;
    }
    step = 1.0;
    while f_high > 0.0 && high.exp() < f64::INFINITY {
        high += step;
        f_high = excess(high);
        step *= 2.0;
    }
    if f_low < 0.0 || f_high > 0.0 {
        return if f_low < 0.0 { 0.0 } else { f64::INFINITY };
    }
    let (mut before, mut moved) = (high - low, None);
    for iteration in 0..MAX_STEPS {
        if f_low.is_nan() || f_high.is_nan() {
            return f64::NAN;
        }
        if f_low == 0.0 || high - low <= f64::EPSILON * low.abs().max(0.25) {
            return low.exp();
        }
        if f_high == 0.0 {
            return high.exp();
        }
        // a bracket that two steps have not halved is halved, so that flat ends cannot stall the search
        if iteration % 3 == 0 {
            before = high - low;
        }
        let stalls = iteration % 3 == 2 && high - low > 0.5 * before;
        let s = if stalls || f_high < -1e3 {
            0.5 * (low + high)
        } else {
            (low * f_high - high * f_low) / (f_high - f_low)
        };
        if s <= low || s >= high {
            return s.exp();
        }
        // if an end moves twice in succession, the value at the other one is halved
        let value = excess(s);
        let end = if value >= 0.0 { End::Low } else { End::High };
        let factor = if moved == Some(end) { 0.5 } else { 1.0 };
        match end {
            End::Low => (low, f_low, f_high) = (s, value, factor * f_high),
            End::High => (high, f_high, f_low) = (s, value, factor * f_low),
        }
        moved = Some(end);
    }
    (0.5 * (low + high)).exp()
}

#[cfg(test)]
#[allow(clippy::excessive_precision)] // expected values are printed with 17 digits
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    #[test]
    fn what_has_no_solution_ends_the_search() {
        assert!(two_sigma(|_| f64::NAN, 1.0).is_nan());
        assert!(two_sigma(|h| if h < 1.0 { 1.0 } else { f64::NAN }, 1.0).is_nan());
        assert!(two_sigma(|h| if h < 1.2 { f64::NAN } else { 0.0 }, 1.0).is_nan());
        assert_eq!(two_sigma(|_| 0.0, 1.0), 0.0);
        assert_eq!(two_sigma(|_| 1.0, 1.0), f64::INFINITY);
        assert!(student_two_sided_quantile(f64::NAN, 3.0).is_nan());
    }

    /// Expected values by mpmath with 50 digits.
    #[test]
    fn tails_against_high_precision() {
        for (t, nu, expected) in STUDENT {
            assert_within(1e-13, student_two_sided(t, nu), expected);
        }
        for (f, nu1, nu2, expected) in FISHER {
            // exponents of the size of ν cancel if both ν are large
            let tolerance = 1e-13 * (1.0 + nu1.min(nu2) / 300.0);
            assert_within(tolerance, fisher_upper(f, nu1, nu2), expected);
        }
    }

    /// Expected values by mpmath with 50 digits.
    #[test]
    fn chi_square_against_high_precision() {
        for (x, nu, expected) in CHI_SQUARE {
            assert_within(2e-13, chi_square_upper(x, nu), expected);
        }
        for p in [0.999, 0.5, 1e-3, 1e-12] {
            for nu in [1, 2, 3, 10, 501] {
                assert_within(1e-11, chi_square_upper(chi_square_upper_quantile(p, nu), nu), p);
            }
        }
    }

    #[test]
    fn quantiles_invert_the_tails() {
        for p in [0.999, 0.5, 0.05, 1e-3, 1e-6, 1e-12] {
            assert_within(1e-13, normal_two_sided(normal_two_sided_quantile(p)), p);
            for nu in [1.0, 2.0, 8.0, 98.0, 1e4, 1e6] {
                assert_within(1e-13, student_two_sided(student_two_sided_quantile(p, nu), nu), p);
                assert_within(1e-13, fisher_upper(fisher_upper_quantile(p, 9.0, nu), 9.0, nu), p);
            }
        }
    }

    const CHI_SQUARE: [(f64, usize, f64); 23] = [
        (1e-10, 1, 0.9999920211543921),
        (0.3, 1, 0.58388242077036518),
        (9.0, 1, 0.0026997960632601891),
        (800.0, 1, 5.3958656116079009e-176),
        (1e-10, 2, 0.99999999995),
        (0.3, 2, 0.86070797642505781),
        (60.0, 2, 9.3576229688401746e-14),
        (0.01, 3, 0.99973483494134439),
        (4.0, 3, 0.26146412994911062),
        (90.0, 3, 2.1905701192853111e-19),
        (2.0, 10, 0.99634015317265629),
        (15.0, 10, 0.13206185628772061),
        (200.0, 10, 1.6139305336977305e-37),
        (80.0, 101, 0.93903447477050436),
        (130.0, 101, 0.02753140475353209),
        (900.0, 1000, 0.98928276190871026),
        (1200.0, 1000, 1.2255942330622904e-5),
        (9500.0, 10000, 0.99983561383564118),
        (10300.0, 10000, 0.0176381174473454),
        (42.8, 980, 1.0),
        (700.0, 985, 0.99999999999958649),
        (1.0, 500, 1.0),
        (0.5, 100, 1.0),
    ];
    const STUDENT: [(f64, f64, f64); 21] = [
        (0.5, 1.0, 0.70483276469913345),
        (2.5, 1.0, 0.2422378831816868),
        (8.0, 1.0, 0.079166848321131084),
        (0.5, 3.0, 0.65144796484815099),
        (2.5, 3.0, 0.087706647008065547),
        (8.0, 3.0, 0.0040765775877854682),
        (0.5, 8.0, 0.63053607555697634),
        (2.5, 8.0, 0.036942037713624105),
        (8.0, 8.0, 4.3668260313280251e-5),
        (0.5, 98.0, 0.61819594793669484),
        (2.5, 98.0, 0.014079755374771979),
        (8.0, 98.0, 2.536943394094079e-12),
        (0.5, 998.0, 0.61718530124730382),
        (2.5, 998.0, 0.012578887688909303),
        (8.0, 998.0, 3.4333447106990372e-15),
        (0.5, 100000.0, 0.61707617765441804),
        (2.5, 100000.0, 0.012420919192559045),
        (8.0, 100000.0, 1.2573919876256374e-15),
        (0.5, 10000000.0, 0.61707508845401508),
        (2.5, 10000000.0, 0.01241934653657847),
        (8.0, 10000000.0, 1.2443234802806785e-15),
    ];
    const FISHER: [(f64, f64, f64, f64); 6] = [
        (5.68647609236586, 3.0, 15.0, 0.0083333333333333327),
        (0.5, 4.0, 36.0, 0.73584848119600851),
        (2.5, 9.0, 81.0, 0.014119880412544853),
        (1.2, 199.0, 1990.0, 0.035483089095472698),
        (3.0, 40.0, 4000.0, 9.6207910563779446e-10),
        (1.05, 3000.0, 50000.0, 0.031691242982848512),
    ];
}
