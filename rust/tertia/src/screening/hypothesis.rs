//! Tests of a single value, of the most deviating value, and of the largest variance.

use super::others::moments_of_others;
use crate::base::distribution::{
    fisher_upper, fisher_upper_quantile, normal_two_sided, normal_two_sided_quantile,
    student_two_sided, student_two_sided_quantile,
};
use crate::base::error::{
    Result, require, require_count, require_each, require_finite, require_positive, require_sample,
    require_significance,
};
use crate::base::moments::Moments;

/// A test statistic with its p-value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlierTest {
    /// The test statistic.
    pub statistic: f64,
    /// Probability of a statistic at least as large if there is no outlier.
    pub pvalue: f64,
}

/// The tests with a [`critical_value`]; `n` has the meaning stated for each test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Test {
    /// (R1): a value against n others with known sigma.
    ZTest,
    /// (R2), (R3): a value against n others, from which sigma is estimated.
    TTest,
    /// (M4): a value against the other values of a sample of n.
    LeaveOneOut,
    /// (M1) for a value chosen beforehand, in a sample of n including this value (Thompson's τ).
    ThompsonTau,
    /// The most deviating of n values.
    Grubbs,
    /// The largest of n variances as a share of their sum; each has these degrees of freedom.
    Cochran(f64),
}

/// Returns the threshold of `test` at this significance for sample size `n`.
///
/// Exact, except for `Grubbs` and `Cochran`, which use Bonferroni's bound. The bound is exact as long as two
/// values cannot exceed the threshold at once (G > √((N−1)/2), C > 1/2); otherwise the false-alarm rate is
/// at most `significance`.
///
/// # Errors
/// If n is too small for the test, or the significance is outside (0, 1).
pub fn critical_value(n: usize, significance: f64, test: Test) -> Result<f64> {
    require_significance(significance)?;
    require("n", n as f64, n >= minimum(test), minimum_text(test))?;
    let count = n as f64;
    Ok(match test {
        Test::ZTest => normal_two_sided_quantile(significance),
        Test::TTest => {
            student_two_sided_quantile(significance, count - 1.0) * ((count + 1.0) / count).sqrt()
        }
        Test::LeaveOneOut => {
            student_two_sided_quantile(significance, count - 2.0) * (count / (count - 1.0)).sqrt()
        }
        Test::ThompsonTau => tau(student_two_sided_quantile(significance, count - 2.0), count),
        Test::Grubbs => tau(student_two_sided_quantile(significance / count, count - 2.0), count),
        Test::Cochran(degrees) => {
            require_degrees(degrees)?;
            let f = fisher_upper_quantile(significance / count, degrees, degrees * (count - 1.0));
            1.0 / (1.0 + (count - 1.0) / f)
        }
    })
}

/// Probability that `test` with threshold `k` raises an alarm in a clean sample: the inverse of
/// [`critical_value`].
///
/// # Errors
/// If n is too small for the test, or k ≤ 0.
pub fn false_alarm_probability(k: f64, n: usize, test: Test) -> Result<f64> {
    require_positive("k", k)?;
    require("n", n as f64, n >= minimum(test), minimum_text(test))?;
    let count = n as f64;
    Ok(match test {
        Test::ZTest => normal_two_sided(k),
        Test::TTest => student_two_sided(k * (count / (count + 1.0)).sqrt(), count - 1.0),
        Test::LeaveOneOut => student_two_sided(k * ((count - 1.0) / count).sqrt(), count - 2.0),
        Test::ThompsonTau => tau_pvalue(k, count),
        Test::Grubbs => (count * tau_pvalue(k, count)).min(1.0),
        Test::Cochran(degrees) => {
            require_degrees(degrees)?;
            let f = k * (count - 1.0) / (1.0 - k).max(0.0);
            (count * fisher_upper(f, degrees, degrees * (count - 1.0))).min(1.0)
        }
    })
}

/// Requires valid degrees of freedom; above the upper limit the tails lose more than four digits.
fn require_degrees(degrees: f64) -> Result<()> {
    let holds = (1.0..=1e9).contains(&degrees);
    require("degrees_of_freedom", degrees, holds, "between 1 and 1e9")
}

fn minimum(test: Test) -> usize {
    match test {
        Test::ZTest => 1,
        Test::TTest | Test::Cochran(_) => 2,
        Test::LeaveOneOut | Test::ThompsonTau | Test::Grubbs => 3,
    }
}

fn minimum_text(test: Test) -> &'static str {
    match minimum(test) {
        1 => "at least 1 for this test",
        2 => "at least 2 for this test",
        _ => "at least 3 for this test",
    }
}

/// `τ = t (N−1) / √(N (N−2+t²))`.
fn tau(t: f64, n: f64) -> f64 {
    // in terms of 1/t², because t² may overflow
    (n - 1.0) / (n * (1.0 + (n - 2.0) / (t * t))).sqrt()
}

/// P-value of `|y_i − M| / √D` for a value chosen beforehand.
fn tau_pvalue(tau: f64, n: f64) -> f64 {
    // t² = τ² N (N−2) / ((N−1)² − N τ²)
    let room = (n - 1.0) * (n - 1.0) - n * tau * tau;
    if room <= 0.0 {
        return 0.0;
    }
    student_two_sided(tau * (n * (n - 2.0) / room).sqrt(), n - 2.0)
}

/// P-value of `x` against n others with these moments: `t = (|x − ȳ|/s) √(n/(n+1))`, ν = n − 1.
fn pvalue_against(others: &Moments, x: f64) -> f64 {
    let n = others.count();
    let deviation = others.deviation(x).abs();
    if deviation == 0.0 {
        return 1.0;
    }
    let t = deviation / others.variance().sqrt() * (n / (n + 1.0)).sqrt();
    student_two_sided(t, n - 1.0)
}

/// Tests whether `x` is an outlier against n others with these moments and known sigma (R1):
/// `t = |x − ȳ| / (σ √((n+1)/n))`. O(1).
///
/// # Errors
/// No other values, an x that is not finite, or sigma ≤ 0.
pub fn z_test(x: f64, others: &Moments, sigma: f64) -> Result<OutlierTest> {
    require_positive("sigma", sigma)?;
    require_others(x, others, 1)?;
    let n = others.count();
    let statistic = others.deviation(x).abs() / (sigma * ((n + 1.0) / n).sqrt());
    Ok(OutlierTest { statistic, pvalue: normal_two_sided(statistic) })
}

/// Tests whether `x` is an outlier against n others with these moments and estimated sigma (R2), (R3):
/// `t = |x − ȳ| / s`. O(1).
///
/// # Errors
/// Fewer than two other values, or an x that is not finite.
pub fn t_test(x: f64, others: &Moments) -> Result<OutlierTest> {
    require_others(x, others, 2)?;
    let statistic = standardised(others, x);
    Ok(OutlierTest { statistic, pvalue: pvalue_against(others, x) })
}

/// `|x − M| / √D`; zero if x is the mean of a constant sample.
fn standardised(moments: &Moments, x: f64) -> f64 {
    match moments.deviation(x).abs() {
        0.0 => 0.0,
        deviation => deviation / moments.variance().sqrt(),
    }
}

fn require_others(x: f64, others: &Moments, minimum: usize) -> Result<()> {
    require_count("y", others.count() as usize, minimum)?;
    require_finite("x", &[x])
}

/// Computes Thompson's τ of every value, `|y_i − M| / √D`, and its p-value for a value chosen
/// beforehand. O(N).
///
/// # Errors
/// Fewer than 3 values, a value that is not finite, or deviations out of range.
///
/// # Panics
/// If the slices differ in length.
pub fn thompson_tau(y: &[f64], statistic: &mut [f64], pvalue: &mut [f64]) -> Result<()> {
    assert!(y.len() == statistic.len() && y.len() == pvalue.len());
    require_sample("y", y, 3)?;
    let moments = Moments::of("y", y)?;
    let mut scratch = Vec::new();
    for (i, (t, p)) in statistic.iter_mut().zip(pvalue).enumerate() {
        let others = moments_of_others(y, i, &moments, &mut scratch)?;
        *t = standardised(&moments, y[i]);
        *p = pvalue_against(&others, y[i]);
    }
    Ok(())
}

/// Grubbs' test: returns the index of the most deviating value, `G = |y_i − M| / √D` and its two-sided
/// p-value (Bonferroni's bound, exact if G > √((N−1)/2)). O(N).
///
/// # Errors
/// Fewer than 3 values, a value that is not finite, or deviations out of range.
pub fn grubbs(y: &[f64]) -> Result<(usize, OutlierTest)> {
    require_sample("y", y, 3)?;
    let moments = Moments::of("y", y)?;
    let index = index_of_largest(y.iter().map(|&v| moments.deviation(v).abs()));
    let others = moments_of_others(y, index, &moments, &mut Vec::new())?;
    let statistic = standardised(&moments, y[index]);
    let pvalue = (moments.count() * pvalue_against(&others, y[index])).min(1.0);
    Ok((index, OutlierTest { statistic, pvalue }))
}

/// Cochran's test: returns the index of the largest of L variances, its share C of their sum, and the
/// p-value (Bonferroni's bound, exact if C > 1/2). O(L).
///
/// # Errors
/// Fewer than 2 variances, a variance that is negative or not finite, only zeros, or degrees of freedom
/// below 1.
pub fn cochran(variances: &[f64], degrees_of_freedom: f64) -> Result<(usize, OutlierTest)> {
    require_sample("variances", variances, 2)?;
    require_finite("variances", variances)?;
    require_degrees(degrees_of_freedom)?;
    require_each("variances", variances, |d| d >= 0.0, "a variance must not be negative")?;
    let index = index_of_largest(variances.iter().copied());
    let largest = variances[index];
    require("the largest of variances", largest, largest > 0.0, "positive")?;
    // scaled by the largest, so that no sum overflows
    let others = variances[..index].iter().chain(&variances[index + 1..]);
    let others: f64 = others.map(|d| d / largest).sum();
    let count = variances.len() as f64;
    let degrees_others = degrees_of_freedom * (count - 1.0);
    let pvalue = extreme_variance_pvalue(1.0, degrees_of_freedom, others, degrees_others, count);
    Ok((index, OutlierTest { statistic: 1.0 / (1.0 + others), pvalue }))
}

/// P-value of one of `count` variances, `d` with `nu` degrees of freedom, against the pooled others,
/// whose sum of squares is `sum_others · nu` with `nu_others` degrees of freedom.
pub(crate) fn extreme_variance_pvalue(
    d: f64,
    nu: f64,
    sum_others: f64,
    nu_others: f64,
    count: f64,
) -> f64 {
    if d <= 0.0 {
        return 1.0;
    }
    let pooled = sum_others * nu / nu_others;
    (count * fisher_upper(d / pooled, nu, nu_others)).min(1.0)
}

/// Index of the largest value; of equal values, the first.
fn index_of_largest(values: impl Iterator<Item = f64>) -> usize {
    let mut best = (0, f64::NEG_INFINITY);
    for (i, v) in values.enumerate() {
        if v > best.1 {
            best = (i, v);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_close;

    const OTHERS: [f64; 5] = [10.1, 9.8, 10.3, 10.0, 9.9];

    #[test]
    fn one_value_against_the_others() {
        let others = Moments::of("y", &OTHERS).unwrap();
        let known = z_test(12.6, &others, 1.0).unwrap();
        assert_close(known.statistic, 2.355_206_997_272_21);
        assert_close(known.pvalue, 0.018_512_390_089_309_6);
        let unknown = t_test(10.8, &others).unwrap();
        assert_close(unknown.statistic, 4.055_026_910_298_28);
        assert_close(unknown.pvalue, 0.020_804_163_965_268_6);
    }

    /// The leave-one-out rule and (R3) with n − 1 others are the same test.
    #[test]
    fn leave_one_out_is_a_t_test_with_one_fewer() {
        for n in [3, 10, 1000] {
            for significance in [0.05, 0.01, 0.001] {
                let k = critical_value(n, significance, Test::LeaveOneOut).unwrap();
                assert_close(k, critical_value(n - 1, significance, Test::TTest).unwrap());
            }
        }
    }

    #[test]
    fn critical_values_invert_false_alarm_probabilities() {
        for test in [
            Test::ZTest,
            Test::TTest,
            Test::LeaveOneOut,
            Test::ThompsonTau,
            Test::Grubbs,
            Test::Cochran(4.0),
        ] {
            for n in [3, 8, 200] {
                let k = critical_value(n, 0.01, test).unwrap();
                assert_close(false_alarm_probability(k, n, test).unwrap(), 0.01);
            }
        }
    }

    #[test]
    fn the_most_extreme_is_found() {
        let (index, test) = grubbs(&[9.8, 10.1, 25.0, 10.0, 9.9]).unwrap();
        assert!(index == 2 && test.pvalue < 1e-4);
        let (index, test) = cochran(&[0.176, 0.22, 0.0896, 0.03, 7.929, 0.1493], 3.0).unwrap();
        assert!(index == 4 && test.statistic > 0.9 && test.pvalue < 1e-4);
    }
}
