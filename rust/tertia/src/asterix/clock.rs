use std::collections::HashMap;

const DAY: f64 = 86_400.0;
/// Truncated times start again after this many seconds, and at midnight.
const TRUNCATED: f64 = 512.0;
/// Stands for all sources, for those that never report a full time. No number does: records without a source
/// have one, too.
const ANY: Option<i64> = None;

/// Completes truncated times of day from full ones.
///
/// The arguments contain for each record, in order: the full time in seconds, or nan; the truncated time, or
/// nan; and the source that reports. A truncated time becomes the time of day nearest to the last time of
/// the same source, or of any source if this source never reports a full time. If there is no full time
/// at all, the first truncated time of a source remains unchanged, and its later ones continue from it. O(n).
pub fn complete_times(full: &[f64], truncated: &[f64], source: &[i64]) -> Vec<f64> {
    let mut last = HashMap::new();
    for (&time, &source) in full.iter().zip(source).rev().filter(|(time, _)| time.is_finite()) {
        last.insert(Some(source), time);
        last.insert(ANY, time);
    }
    let records = full.iter().zip(truncated).zip(source);
    records
        .map(|((&full, &truncated), &source)| {
            let known = last.contains_key(&Some(source)) || !last.contains_key(&ANY);
            let source = if known { Some(source) } else { ANY };
            let time = match last.get(&source) {
                _ if full.is_finite() => full,
                Some(&near) if truncated.is_finite() => nearest(truncated, near),
                _ => truncated,
            };
            if time.is_finite() {
                last.insert(source, time);
            }
            if full.is_finite() {
                last.insert(ANY, full);
            }
            time
        })
        .collect()
}

/// Time of day nearest to another one, also across midnight, whose truncated form is given.
fn nearest(truncated: f64, near: f64) -> f64 {
    let most = ((DAY - truncated) / TRUNCATED).ceil() - 1.0;
    let candidates = [-DAY, 0.0, DAY].map(|day| {
        let near = near.rem_euclid(DAY) + day;
        let time =
            ((near - truncated) / TRUNCATED).round().min(most).max(0.0) * TRUNCATED + truncated;
        ((time - near).abs(), time)
    });
    candidates
        .into_iter()
        .min_by(|one, other| one.0.total_cmp(&other.0))
        .map_or(truncated, |one| one.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: f64 = f64::NAN;

    #[test]
    fn times_are_completed_by_their_source() {
        let full = [NONE, 1_000.0, 40_000.0, NONE, NONE, NONE, NONE];
        let truncated = [480.0, NONE, NONE, 489.0, 65.0, 70.0, NONE];
        let found = complete_times(&full, &truncated, &[1, 1, 2, 1, 2, 3, 1]);
        assert_eq!(found[..6], [992.0, 1_000.0, 40_000.0, 1_001.0, 40_001.0, 40_006.0]);
        assert!(found[6].is_nan());
    }

    #[test]
    fn without_service_messages_they_go_on() {
        let truncated: Vec<f64> = (0..50).map(|k| f64::from(100 * k) % TRUNCATED).collect();
        let found = complete_times(&[NONE; 50], &truncated, &[7; 50]);
        assert_eq!(found, (0..50).map(|k| f64::from(100 * k)).collect::<Vec<_>>());
    }

    #[test]
    fn a_record_without_a_source_tells_nothing_about_others() {
        let found = complete_times(&[NONE; 3], &[10.0, 500.0, 5.0], &[i64::MIN, 7, 7]);
        assert_eq!(found, [10.0, 500.0, 517.0]);
    }

    /// A day is not a whole number of periods of 512 seconds.
    #[test]
    fn midnight_is_passed() {
        let times: Vec<f64> = (0..200).map(|k| (86_300.0 + f64::from(k)) % DAY).collect();
        let truncated: Vec<f64> = times.iter().map(|time| time % TRUNCATED).collect();
        let mut full = vec![NONE; 200];
        full[0] = times[0];
        assert_eq!(complete_times(&full, &truncated, &[7; 200]), times);
    }
}
