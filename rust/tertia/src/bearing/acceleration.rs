//! Extrapolation of the EM algorithm, whose error decreases by about the same factor at every step.

use super::modes::{MOST_BAD, Modes};
use crate::base::interrupt::poll;

/// Number of parameters: centre, width, persistence; offset, width and share of each bad mode.
const PARAMETERS: usize = 3 + 3 * MOST_BAD;
/// Longest extrapolation, in steps.
const LONGEST: f64 = 16.0;
/// EM ends when no parameter changes by more than this share of a standard error.
const TOLERANCE: f64 = 0.01;
const MOST_STEPS: usize = 80;

type Point = [f64; PARAMETERS];

/// Repeats EM steps until they converge; `step` returns the largest change of a parameter. After every
/// second step the parameters are extrapolated (Varadhan, Roland 2008, scheme S3).
pub(super) fn converge(modes: &mut Modes, mut step: impl FnMut(&mut Modes) -> f64) {
    for _ in 0..MOST_STEPS / 2 {
        poll();
        let origin = point(modes);
        if step(modes) < TOLERANCE {
            return;
        }
        let first = point(modes);
        if step(modes) < TOLERANCE {
            return;
        }
        let second = point(modes);
        let r: Point = std::array::from_fn(|i| first[i] - origin[i]);
        let v: Point = std::array::from_fn(|i| second[i] - first[i] - r[i]);
        let length = norm(&r) / norm(&v);
        if length > 1.0 {
            let a = length.min(LONGEST);
            let ahead = std::array::from_fn(|i| origin[i] + a * (2.0 * r[i] + a * v[i]));
            *modes = at(&ahead, modes);
        }
    }
}

fn norm(x: &Point) -> f64 {
    x.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn point(modes: &Modes) -> Point {
    let mut x = [0.0; PARAMETERS];
    (x[0], x[1], x[2]) = (modes.centre, modes.width.ln(), modes.persistence);
    for (j, bad) in modes.bad[..modes.kinds()].iter().enumerate() {
        x[3 + 3 * j..6 + 3 * j].copy_from_slice(&[bad.offset, bad.width.ln(), bad.share]);
    }
    x
}

/// Returns the modes at a point, limited to between half and twice their previous values.
fn at(x: &Point, modes: &Modes) -> Modes {
    let mut found = *modes;
    let within = |value: f64, known: f64| value.clamp(0.5 * known, 2.0 * known);
    found.centre = x[0].clamp(modes.centre - modes.width, modes.centre + modes.width);
    found.width = within(x[1].exp(), modes.width);
    found.persistence = x[2].clamp(0.5 * modes.persistence, 0.5 + 0.5 * modes.persistence);
    for (j, bad) in found.bad[..modes.kinds()].iter_mut().enumerate() {
        let known = &modes.bad[j];
        bad.offset = within(x[3 + 3 * j].abs(), known.offset.abs()).copysign(known.offset);
        bad.width = within(x[4 + 3 * j].exp(), known.width);
        bad.share = within(x[5 + 3 * j], known.share);
    }
    found.limit_shares();
    found
}

#[cfg(test)]
mod tests {
    use super::super::modes::{Mode, Shape};
    use super::*;

    /// A step towards a known end that leaves nine tenths of the distance.
    #[test]
    fn slow_steps_are_extrapolated_to_their_end() {
        let mode = Mode { offset: 3.0, width: 1.0, share: 0.2 };
        let start = Modes {
            shape: Shape::OneSided,
            centre: 0.0,
            width: 1.0,
            bad: [mode, Mode::default()],
            persistence: 0.0,
        };
        let (mut modes, mut steps) = (start, 0);
        converge(&mut modes, |modes| {
            steps += 1;
            let change = 0.1 * (0.5 - modes.centre);
            modes.centre += change;
            modes.bad[0].share += 0.1 * (0.3 - modes.bad[0].share);
            change.abs()
        });
        assert!((modes.centre - 0.5).abs() < 1e-9, "{modes:?}");
        assert!((modes.bad[0].share - 0.3).abs() < 1e-9, "{modes:?}");
        assert!(steps <= 4, "{steps} steps");
    }
}
