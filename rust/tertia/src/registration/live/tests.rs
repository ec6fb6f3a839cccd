use super::*;
use crate::registration::exchange::Changed;
use crate::registration::sighting::tests::{PRIOR, close, radar};
use crate::registration::sums::Sums;
use nalgebra::{Matrix2, Matrix4, Vector2};

impl Updates for Vec<Update> {
    fn count(&self) -> usize {
        self.len()
    }

    fn target(&self, row: usize) -> i64 {
        self[row].plot.target
    }

    fn get(&self, row: usize) -> Update {
        self[row].clone()
    }
}

impl Changed for Vec<Update> {
    fn change(&mut self, _: usize, _: &[f64; 4], _: &[f64; 16]) {}
}

fn registrar() -> Registrar {
    Registrar::new(
        vec![radar([0.0; 3], 50.0, 0.08)],
        vec![false],
        vec![[0.0; ERRORS]],
        vec![PRIOR],
        &[[0.0; ERRORS]],
    )
}

#[test]
fn what_the_errors_add_to_a_track() {
    let mut registrar = registrar();
    registrar.known.covariance = 0.09 * DMatrix::identity(4, 4);
    let (radar, time, range, height) = (0, 4.0, 5e4, f64::NAN);
    let azimuth = 30_000_f64.atan2(40_000.0);
    let report = Report { radar, time, range, azimuth, height, place: None };
    let velocity = [180.0, 90.0];
    // half of the displacement of the plot by the errors
    let seen = Sighting::new(&report, height, &registrar.radars[0], [1.0; 2]).unwrap();
    let design = seen.design(velocity.into());
    let axes = Matrix2::from_columns(&seen.axes);
    let half = std::array::from_fn(|j| {
        let own = axes * Vector2::new(design[0][j], design[1][j]) * PRIOR[j];
        [0.5 * own[0], 0.5 * own[1]]
    });
    let mut track = Followed::new(0.0);
    track.update(&seen, &[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]], &half);
    let place = registrar.tracks.place(1, || 0.0);
    *registrar.tracks.at(place.0) = track;
    // the predicted covariance, corrected by the plot
    let mut p = Matrix4::from_diagonal(&[900.0, 1600.0, 25.0, 25.0].into());
    for axis in 0..2 {
        p[(axis, axis + 2)] = 100.0;
        p[(axis + 2, axis)] = 100.0;
    }
    let r = axes
        * Matrix2::from_diagonal(&Vector2::new(seen.sigma[0].powi(2), seen.sigma[1].powi(2)))
        * axes.transpose();
    let h = p.fixed_view::<2, 2>(0, 0) + r;
    let gain = p.fixed_columns::<2>(0) * h.try_inverse().unwrap();
    let corrected = p - gain * p.fixed_rows::<2>(0);
    let covariance = std::array::from_fn(|i| corrected[(i / 4, i % 4)]);
    let plot = TargetPlot { report, target: 1, turn_probability: 0.0 };
    let (confirmed, position) = (true, [0.0; 2]);
    let (innovation, innovation_covariance) = ([f64::NAN; 2], [f64::NAN; 4]);
    let stated = [[registrar.own_noise(0); 2]];
    let update = Update {
        plot,
        confirmed,
        position,
        velocity,
        covariance,
        innovation,
        innovation_covariance,
        other: None,
    };
    let (unknowns, errors) =
        (registrar.unknowns(), registrar.blocks(registrar.known.covariance.clone()));
    let added = registrar.carry(&update, (place.0, false), &stated, &unknowns).added(&errors);
    close(added[0] + corrected[(0, 0)], 1020.719237257);
    close(added[1] + corrected[(0, 1)], 20.87698829836);
    close(added[5] + corrected[(1, 1)], 1455.49754268);
    let expected = [
        [37.57517266496, 10.14448506073, 40.48868928593, -10.93922690507],
        [56.01444323224, 15.12268985752, -32.35202152351, -6.74605805618],
        [0.8416858516619, 0.2272370009886, 0.6202338051158, -0.2154696561192],
        [1.000902702015, 0.2702221117752, -0.3857551714744, -0.1403786285112],
    ];
    for (i, row) in expected.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            close(registrar.tracks.at(place.0).parts[0].part[j][i], *value);
        }
    }
}

#[test]
fn noise_fades() {
    let mut registrar = registrar();
    registrar.squares = vec![[12.0, 60.0]];
    registrar.redundancy = vec![[8.0; 2]];
    let mut sums = Sums::new(4, 1);
    registrar.learn_noise(&sums, &registrar.factor.clone());
    close(registrar.factor[0][0], 1.105541596785);
    close(registrar.factor[0][1], 1.972026594367);
    // residuals are relative to the noise found
    let squares = |axis: usize, sum: f64| sum / registrar.factor[0][axis].powi(2);
    sums.square = vec![[squares(0, 200.0), squares(1, 300.0)]];
    sums.redundancy = vec![[150.0; 2]];
    registrar.learn_noise(&sums, &registrar.factor.clone());
    close(registrar.squares[0][0], 201.2658227848);
    close(registrar.squares[0][1], 341.7721518987);
    close(registrar.factor[0][0], 1.149091550924);
    close(registrar.factor[0][1], 1.48275957234);
}

#[test]
fn a_vote_throws_open_blocks_away() {
    let mut registrar = registrar();
    let (radar, velocity) = (0, [0.0; 2]);
    for i in 0..10 {
        let (azimuth, range) = (0.5 + 0.1 * f64::from(i), 4e4 + 3e3 * f64::from(i));
        let position = [range * azimuth.sin(), range * azimuth.cos()];
        let report =
            |time, azimuth| Report { radar, time, range, azimuth, height: f64::NAN, place: None };
        let mut track = Followed::new(35.0);
        track.see(35.0, radar, position, velocity);
        let plot =
            TargetPlot { report: report(35.0, azimuth), target: i.into(), turn_probability: 0.0 };
        let (place, _) = registrar.tracks.place(i.into(), || 35.0);
        *registrar.tracks.at(place) = track;
        registrar.open.insert(i.into(), vec![plot]);
        registrar.loose.push(report(39.5, azimuth + 0.5_f64.to_radians()));
    }
    registrar.vote(41.0);
    assert_eq!(registrar.changes(), [(41.0, radar)]);
    assert!((registrar.errors()[0][2] - 0.5_f64.to_radians()).abs() < 1e-9);
    assert!(registrar.open.is_empty());
    // blocks that are opened before the next vote remain
    registrar.open.insert(1, Vec::new());
    registrar.vote(42.0);
    assert_eq!(registrar.open.len(), 1);
}

#[test]
fn a_clock_is_taken_out_by_steps() {
    let mut registrar = registrar();
    registrar.known.mean[CLOCK] = -25.0;
    for expected in [-1.0, -2.0, -2.5, -2.5] {
        registrar.learn(&mut Vec::new(), &[], &[], (0.0, None));
        let clock = registrar.taken_out()[0][CLOCK];
        assert!((clock - expected).abs() < 1e-12, "{clock} {expected}");
        assert!((registrar.errors()[0][CLOCK] + 2.5).abs() < 1e-12);
    }
}

/// Rows of a track with plots of two radars every two seconds; the second radar measures ranges 150 m too
/// long.
fn rows() -> Vec<Update> {
    let places = [[0.0; 2], [6e4, 0.0]];
    let row = |i: usize| {
        let (time, radar) = (2.0 * i as f64, i % 2);
        let position = [2e4 + 180.0 * time, 3e4 + 90.0 * time];
        let (east, north) = (position[0] - places[radar][0], position[1] - places[radar][1]);
        let (range, azimuth) = (east.hypot(north) + 150.0 * radar as f64, east.atan2(north));
        let report = Report { radar, time, range, azimuth, height: f64::NAN, place: None };
        Update {
            plot: TargetPlot { report, target: 1, turn_probability: 0.0 },
            confirmed: true,
            position,
            velocity: [180.0, 90.0],
            covariance: std::array::from_fn(|n| if n % 5 == 0 { 900.0 } else { 0.0 }),
            innovation: [f64::NAN; 2],
            innovation_covariance: [f64::NAN; 4],
            other: None,
        }
    };
    (0..5).map(row).collect()
}

fn two() -> Registrar {
    let radars = vec![radar([0.0; 3], 50.0, 0.08), radar([6e4, 0.0, 0.0], 50.0, 0.08)];
    Registrar::new(
        radars,
        vec![false; 2],
        vec![[0.0; ERRORS]; 2],
        vec![PRIOR; 2],
        &[[0.0; ERRORS]; 2],
    )
}

fn first(registrar: &Registrar) -> &Followed {
    registrar.tracks.all().next().unwrap()
}

#[test]
fn the_first_block_teaches_and_moves_the_track() {
    let mut registrar = two();
    registrar.learn(&mut rows(), &[], &[[[0.0; 2]; 2]; 2], (8.0, None));
    assert_eq!(registrar.known.mean.amax(), 0.0);
    let before = first(&registrar).clone();
    let tracks = registrar.learn(&mut Vec::new(), &[], &[[[0.0; 2]; 2]; 2], (60.0, None));
    let offset = registrar.errors()[1][0];
    assert!((50.0..150.0).contains(&offset), "{offset}");
    assert!(registrar.sigmas()[1][0] < 0.9 * PRIOR[0]);
    let mean = &registrar.known.mean;
    let of = |k: usize, j: usize| if j < KINDS { mean[KINDS * k + j] } else { 0.0 };
    let by = [0, 1].map(|k| std::array::from_fn(|j| of(k, j)));
    let (number, _, moved) = tracks[0];
    assert_eq!((number, moved), (1, before.moved(&by)));
    assert!(moved[0].hypot(moved[1]) > 5.0, "{moved:?}");
    assert!((first(&registrar).position[0] - before.position[0] - moved[0]).abs() < 1e-9);
}

#[test]
fn innovations_in_turns_say_nothing_of_noise() {
    let mut registrar = two();
    let mut row = rows()[0].clone();
    row.innovation_covariance = [1e4, 0.0, 0.0, 1e4];
    let seen = |registrar: &Registrar, row: &Update| {
        let report = &row.plot.report;
        Sighting::new(report, 0.0, &registrar.radars[0], [1.0; 2]).unwrap()
    };
    for (turning, grown) in [(0.5, false), (0.0, true)] {
        row.plot.turn_probability = turning;
        for i in 0..20 {
            row.innovation = [600.0, 600.0].map(|off| if i % 2 == 0 { off } else { -off });
            row.plot.report.time += 0.1;
            let seen = seen(&registrar, &row);
            let used = registrar.own_noise(0);
            registrar.watch(&row, &seen, used);
        }
        assert_eq!(registrar.factor[0] != [1.0; 2], grown);
    }
}

#[test]
fn unknown_gain_and_clock_count_at_the_distance_and_speed_of_the_tracks() {
    let mut registrar = registrar();
    let noise = |registrar: &Registrar| registrar.noise()[0];
    let expected = |far: f64, speed: f64| {
        let ([offset, gain, azimuth, clock, ..], [range, angle]) = (PRIOR, registrar.own_noise(0));
        let late = 0.5 * (speed * clock).powi(2);
        let along = range * range + offset * offset + (far * gain).powi(2) + late;
        let across = angle * angle + azimuth * azimuth + late / (far * far);
        [along.sqrt(), across.sqrt()]
    };
    let cases = [expected(80e3, 200.0), expected(5e3, 25.0)];
    let equal = |found: [f64; 2], case: [f64; 2]| (0..2).for_each(|i| close(found[i], case[i]));
    equal(noise(&registrar), cases[0]);
    for (number, position, velocity) in [(1, [0.0, -1e3], [15.0, 20.0]), (2, [3e3, 4e3], [1.0; 2])]
    {
        let (place, _) = registrar.tracks.place(number, || 0.0);
        registrar.tracks.at(place).see(0.0, 0, position, velocity);
    }
    registrar.tracks.close();
    equal(noise(&registrar), cases[1]);
    // far and fast tracks count no more than before
    let (place, _) = registrar.tracks.place(3, || 0.0);
    registrar.tracks.at(place).see(0.0, 0, [2e5, 0.0], [300.0, 0.0]);
    registrar.tracks.close();
    equal(noise(&registrar), cases[0]);
}
