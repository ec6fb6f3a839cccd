//! Figures of an independent program (NumPy), for one target.

use super::mixture::{Fix, Mixture, State};
use super::motion::{MODELS, Movement, OWN, SPEED, STATES, STRAIGHT, TURN};
use super::passes::Record;
use super::two_filter::{Instant, Models, Place, TwoFilter};
use super::vertical::{CLIMB, Vertical};
use crate::base::checks::assert_within;

const PLOTS: [[f64; 2]; 7] = [
    [0.0, 0.0],
    [790.0, 30.0],
    [1610.0, -20.0],
    [2390.0, 60.0],
    [3180.0, 210.0],
    [3900.0, 590.0],
    [4520.0, 1090.0],
];

type Target = Mixture<STATES, MODELS>;

/// The target at the first `count` plots, and at 14 s.
fn smoothed(count: usize) -> (Vec<Target>, Target) {
    let models = Movement::default();
    let state = State::new([0.0, 0.0, 200.0, 0.0, 0.0], [2500.0, 4900.0, 400.0, 400.0, 0.0]);
    let start = models.start(state, [0.85, 0.1, 0.05]);
    let fixes = PLOTS.map(|value| Fix::new(value, [[2500.0, 0.0], [0.0, 4900.0]]));
    let instants: Vec<_> =
        (0..count).map(|k| Instant { time: 4.0 * k as f64, first: k, end: k + 1 }).collect();
    let filter = TwoFilter { models: &models, instants: &instants, fixes: &fixes };
    let (mut at, mut between) = (vec![start; count], start);
    let times: &[f64] = if count > 4 { &[14.0] } else { &[] };
    filter.run(start, times, |place, _, with| match place {
        Place::At(k) => at[k] = *with,
        Place::Between(_) => between = *with,
    });
    (at, between)
}

fn assert_all<const K: usize>(tolerance: f64, values: [f64; K], expected: [f64; K]) {
    for (value, expected) in values.into_iter().zip(expected) {
        assert_within(tolerance, value, expected);
    }
}

fn four(values: &[f64]) -> [f64; 4] {
    std::array::from_fn(|i| values[i])
}

fn variances<const N: usize>(state: &State<N>) -> [f64; 4] {
    std::array::from_fn(|i| state.covariance[i][i])
}

/// Variance of a model's own state over all models, if the other models have `variance`.
fn variance_of_own<const N: usize, const M: usize>(
    target: &Mixture<N, M>,
    model: usize,
    variance: f64,
) -> f64 {
    let (state, share) = (&target.states[model], target.probability[model]);
    let square = state.covariance[N - 1][N - 1] + state.mean[N - 1].powi(2);
    share * square + (1.0 - share) * variance - target.own()[model].powi(2)
}

#[test]
fn probabilities_of_changes() {
    let changes = Movement::default().changes(4.0);
    let expected = [
        [0.986_347_759_84, 0.009_372_683_012_2, 0.004_279_557_147_68],
        [0.107_146_052_602, 0.888_975_905_256, 0.003_878_042_142_37],
        [0.064_126_587_746_7, 0.003_952_230_440_51, 0.931_921_181_813],
    ];
    changes.into_iter().zip(expected).for_each(|(row, of)| assert_all(1e-11, row, of));
}

/// After a million mean durations the changes are in balance, however long the time is.
#[test]
fn changes_over_any_time_are_probabilities() {
    let models = Movement::default();
    for time in [1e6, 1e8, 1e10, 1e12] {
        let changes = models.changes(time);
        changes.into_iter().for_each(|row| assert_all(1e-6, row, models.stationary()));
    }
}

#[test]
fn filtered_in_a_turn() {
    let (at, _) = smoothed(4);
    assert_all(
        1e-10,
        at[3].probability,
        [0.889_680_661_874, 0.057_484_477_466_9, 0.052_834_860_659],
    );
    let expected = [2_395.987_324_1, 35.039_589_449_4, 199.721_634_014, 3.141_201_729_2];
    assert_all(1e-10, four(&at[3].moments().mean), expected);
}

#[test]
fn smoothed_in_a_turn() {
    let (at, between) = smoothed(7);
    let middle = at[3].moments();
    assert_within(2e-2, at[3].probability[STRAIGHT] + at[3].probability[SPEED], 4.7e-13);
    let expected = [2_396.719_442_69, 85.133_955_035_3, 200.112_293_197, 42.652_313_325_6];
    assert_all(2e-11, four(&middle.mean), expected);
    assert_within(1e-11, at[3].own()[TURN], 0.033_910_959_625_4);
    let expected = [518.834_648_828, 1_368.362_048_7, 10.225_332_301_6, 16.581_163_324_7];
    assert_all(1e-10, four(&variances(&middle)), expected);
    let rate = variance_of_own(&at[3], TURN, Movement::default().variances()[TURN]);
    assert_within(1e-11, rate, 2.747_529_099_34e-5);

    let first = at[0].moments();
    let expected = [0.499_048_203_914, 0.488_496_717_44, 0.012_455_078_645_7];
    assert_all(1e-10, at[0].probability, expected);
    let expected = [-6.870_340_076_45, 4.133_186_248_84, 201.648_874_191, -16.923_330_059_2];
    assert_all(1e-10, four(&first.mean), expected);

    let later = between.moments();
    let expected = [2_780.957_029_87, 174.853_504_286, 197.233_319_811, 54.626_409_131_8];
    assert_all(2e-11, four(&later.mean), expected);
    assert_within(1e-11, between.own()[TURN], 0.036_474_956_903);
    let expected = [546.992_049_609, 1_356.647_164_26, 10.341_126_475_2, 22.060_178_072_1];
    assert_all(1e-10, four(&variances(&later)), expected);
}

#[test]
fn the_last_state_is_that_of_the_filter() {
    let (at, _) = smoothed(7);
    let expected = [0.038_093_729_603_7, 0.960_591_220_19, 0.001_315_050_205_9];
    assert_all(1e-10, at[6].probability, expected);
    let expected = [4_583.939_923_33, 1_047.717_578_25, 166.686_103_667, 124.500_028_519];
    assert_all(1e-11, four(&at[6].moments().mean), expected);
}

/// Heights every 4 s: level flight, a climb, and level flight.
const HEIGHTS: [f64; 10] =
    [3048.0, 3048.0, 3048.0, 3048.0, 3078.48, 3108.96, 3139.44, 3169.92, 3200.4, 3200.4];

#[test]
fn heights_of_a_climb() {
    let models = Vertical;
    let fixes = HEIGHTS.map(|h| Fix::new([h], [[100.0]]));
    let instants: Vec<_> =
        (0..10).map(|k| Instant { time: 4.0 * k as f64, first: k, end: k + 1 }).collect();
    let filter = TwoFilter { models: &models, instants: &instants, fixes: &fixes };
    let start = models.begin(&State::new([HEIGHTS[0], 0.0], [0.0; 2]), [0.5; 2]);
    let mut at = [start; 10];
    filter.run(start, &[], |place, _, with| {
        if let Place::At(k) = place {
            at[k] = *with;
        }
    });
    // fewer digits agree than elsewhere, because of the start, about which nothing is known
    let expected = [0.129_956_989_534, 0.999_999_999_729, 0.855_282_409_097];
    assert_all(2e-7, [1, 4, 9].map(|k| at[k].probability[CLIMB]), expected);
    let of = |k: usize| [at[k].moments().mean[0], at[k].own()[CLIMB]];
    assert_all(3e-7, of(1), [3_047.327_682_66, 0.233_316_314_162]);
    assert_all(3e-7, of(4), [3_082.020_167_99, 6.668_714_334_47]);
    assert_all(3e-7, of(9), [3_210.088_833_03, 4.832_871_372_4]);
    let climb = variance_of_own(&at[4], CLIMB, models.variances()[CLIMB]);
    let spread = [at[4].moments().covariance[0][0], climb];
    assert_all(3e-7, spread, [25.124_123_954_6, 0.787_872_438_756]);
}

/// Plots every 4 s of a flight that turns in its middle, with errors that are not random but
/// repeat.
fn flight(count: usize) -> Record<2> {
    let (mut position, mut course) = ([0.0, 0.0], 0.3_f64);
    let mut fixes = Vec::with_capacity(count);
    for k in 0..count {
        let error = [(2.4 * k as f64).sin() * 60.0, (1.7 * k as f64).cos() * 80.0];
        let value = [position[0] + error[0], position[1] + error[1]];
        fixes.push(Fix::new(value, [[2500.0, 300.0], [300.0, 4900.0]]));
        if k.abs_diff(count / 2) < 8 {
            course += 0.1;
        }
        position = [position[0] + 800.0 * course.cos(), position[1] + 800.0 * course.sin()];
    }
    let time = (0..count).map(|k| 4.0 * k as f64).collect();
    Record { time, fixes, used: vec![true; count] }
}

#[test]
fn backwards_in_time_it_is_the_same() {
    // changes between any two models are made equally frequent in both directions
    let mut models = Movement::default();
    let likelihood = [1.0, 35.0 / 400.0, 60.0 / 900.0];
    let total: f64 = likelihood.iter().sum();
    models.stationary = likelihood.map(|p| p / total);
    let balanced = models.rates[TURN][SPEED] * likelihood[TURN] / likelihood[SPEED];
    models.rates[SPEED][SPEED] -= balanced - models.rates[SPEED][TURN];
    models.rates[SPEED][TURN] = balanced;

    let count = 400;
    let mut record = flight(count);
    let mut reversed = Record {
        time: record.time.iter().rev().map(|t| -t).collect(),
        fixes: record.fixes.iter().rev().copied().collect(),
        used: record.used.clone(),
    };
    let times = (record.time.clone(), reversed.time.clone());
    let forwards = record.smooth(&models, &times.0, f64::INFINITY).solutions;
    let backwards = reversed.smooth(&models, &times.1, f64::INFINITY).solutions;
    for k in count / 2 - 20..count / 2 + 20 {
        let (one, other) = (forwards[k].unwrap(), backwards[count - 1 - k].unwrap());
        let other_state = other.state.reversed(&Movement::SIGNS);
        for i in 0..OWN {
            let sigma = one.state.covariance[i][i].sqrt();
            let off = (one.state.mean[i] - other_state.mean[i]).abs() / sigma;
            assert!(off < 1e-6, "state {i} of {k} is {off} sigma off");
        }
        for (model, variance) in models.variances().into_iter().enumerate() {
            let off = one.own[model] + other.own[model];
            assert!(off.abs() < 1e-6 * variance.sqrt(), "{off} of model {model} at {k}");
        }
    }
}

/// Straight flights before and after a gap of any length.
#[test]
fn long_gaps() {
    let half: Vec<f64> = (0..25).map(|k| 4.0 * f64::from(k)).collect();
    for gap in [1e4, 1e6, 1e8, 1e10] {
        let time: Vec<f64> = half.iter().copied().chain(half.iter().map(|t| t + gap)).collect();
        let fix = |t: &f64| Fix::new([200.0 * t, 0.0], [[2500.0, 0.0], [0.0, 2500.0]]);
        let fixes = half.iter().chain(&half).map(fix).collect();
        let mut record = Record { time: time.clone(), fixes, used: vec![true; time.len()] };
        let found = record.smooth(&Movement::default(), &time, f64::INFINITY).solutions;
        for (k, found) in found.into_iter().enumerate() {
            let state = found.unwrap().state;
            let off = [state.mean[0] - 200.0 * half[k % 25], state.mean[1], state.mean[2] - 200.0];
            for (i, off) in off.into_iter().enumerate() {
                let sigma = state.covariance[i][i].sqrt();
                assert!(off.abs() < 0.5 * sigma && sigma < 50.0, "{gap} {k} {i}: {off} {sigma}");
            }
        }
    }
}
