//! Conversion of recorded arrivals to a scene that can be solved.

use super::group::{Line, align, group};
use super::scene::{Arrival, Scene, Undetermined};

/// Recorded arrivals, one element for each.
#[derive(Clone, Copy, Debug)]
pub struct Heard<'a> {
    /// Reading of the receiver's clock in seconds.
    pub time: &'a [f64],
    /// Number of the receiver.
    pub sensor: &'a [usize],
    /// Number of the emitter's identity.
    pub identity: &'a [usize],
    /// Number of the emission, if emissions are known; none: the arrival is not used.
    pub emission: Option<&'a [Option<usize>]>,
}

/// Adds rows and lines of clocks to the scene, and returns the row of each arrival.
///
/// # Errors
/// Receivers share too few emissions with the others, or no emission has two arrivals.
pub fn arrange<const D: usize>(
    scene: &mut Scene<D>,
    heard: &Heard<'_>,
) -> Result<Vec<Option<usize>>, Undetermined> {
    let k = scene.is_base.len();
    let all: Vec<usize> = (0..heard.time.len())
        .filter(|&at| heard.emission.is_none_or(|emission| emission[at].is_some()))
        .collect();
    let of = |values: &[usize]| all.iter().map(|&at| values[at]).collect::<Vec<_>>();
    let (sensor, identity) = (of(heard.sensor), of(heard.identity));
    let time: Vec<f64> = all.iter().map(|&at| heard.time[at]).collect();
    let known: Option<Vec<usize>> =
        heard.emission.map(|emission| all.iter().filter_map(|&at| emission[at]).collect());
    let mut alignment = align(&time, &sensor, known.as_ref().unwrap_or(&identity), k);
    let apart: Vec<usize> =
        (0..k).filter(|k| alignment.lines[*k].is_none() && sensor.contains(k)).collect();
    if !apart.is_empty() {
        return Err(Undetermined::Apart(apart));
    }
    let base = (0..k).find(|&k| scene.is_base[k]).and_then(|k| alignment.lines[k]);
    let base = base.unwrap_or_default();
    for (line, is_base) in alignment.lines.iter_mut().zip(&scene.is_base) {
        let own = if *is_base { Line::default() } else { line.unwrap_or(base).relative_to(&base) };
        *line = Some(own);
    }
    scene.lines = alignment.lines.iter().flatten().copied().collect();
    let emission = match known {
        Some(known) => known.into_iter().map(Some).collect(),
        None => group(&alignment, &time, &sensor, &identity, widest(scene)),
    };
    let mut rows: Vec<(usize, Arrival)> = emission
        .iter()
        .enumerate()
        .filter_map(|(at, emission)| {
            let time = scene.lines[sensor[at]].corrected(time[at]);
            let (identity, sensor) = (identity[at], sensor[at]);
            Some((at, Arrival { emission: (*emission)?, identity, sensor, time }))
        })
        .collect();
    rows.sort_by(|(_, a), (_, b)| a.emission.cmp(&b.emission).then(a.time.total_cmp(&b.time)));
    let mut emissions: Vec<&[(usize, Arrival)]> = rows
        .chunk_by(|(_, a), (_, b)| a.emission == b.emission)
        .filter(|one| one.len() > 1)
        .collect();
    emissions.sort_by(|a, b| a[a.len() / 2].1.time.total_cmp(&b[b.len() / 2].1.time));
    if emissions.is_empty() {
        return Err(Undetermined::Nothing);
    }
    let mut row_of = vec![None; heard.time.len()];
    scene.rows.clear();
    for (emission, arrivals) in emissions.into_iter().enumerate() {
        for &(at, arrival) in arrivals {
            row_of[all[at]] = Some(scene.rows.len());
            scene.rows.push(Arrival { emission, ..arrival });
        }
    }
    Ok(row_of)
}

/// Longest travel time between two receivers, which arrivals of one emission cannot exceed.
fn widest<const D: usize>(scene: &Scene<D>) -> f64 {
    let receivers = &scene.sites[..scene.is_base.len()];
    let square = |a: &[f64; D], b: &[f64; D]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    let pairs = receivers.iter().flat_map(|a| receivers.iter().map(move |b| square(a, b)));
    pairs.fold(0.0_f64, |widest, square: f64| widest.max(square)).sqrt() / scene.speed
}
