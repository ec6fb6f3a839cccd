//! The columns of a table of tracks. This is their only definition: bindings, files and pages are derived
//! from it.

use super::row::Row;
use crate::base::plane::Plane;

/// A column of a table of tracks.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Its name.
    pub name: &'static str,
    /// Its unit; empty if it has none.
    pub unit: &'static str,
    /// Shape of its value in a row; empty for a single number.
    pub shape: &'static [usize],
    /// How it is read from a row.
    pub values: Values,
    /// Its meaning, as a phrase.
    pub doc: &'static str,
}

/// How the values of a column are read from a row, by their type.
#[derive(Clone, Copy, Debug)]
pub enum Values {
    /// Writes as many numbers as the column is wide.
    Numbers(fn(&Row, &mut [f64])),
    /// Writes the elements on and above the diagonal of a symmetric matrix, row by row.
    Symmetric(fn(&Row, &mut [f64])),
    /// An integer; negative if there is none.
    Integers(fn(&Row) -> i64),
    /// The number of a callsign; negative if there is none.
    Callsigns(fn(&Row) -> i64),
    /// Yes or no.
    Flags(fn(&Row) -> bool),
}
use Values::{Callsigns, Flags, Integers, Numbers, Symmetric};

impl Column {
    const fn new(
        name: &'static str,
        unit: &'static str,
        shape: &'static [usize],
        values: Values,
        doc: &'static str,
    ) -> Self {
        Self { name, unit, shape, values, doc }
    }

    /// Number of values that are stored in a row: only one triangle of a symmetric matrix.
    pub(in crate::tracker) fn stored(&self) -> usize {
        match (self.values, self.shape) {
            (Symmetric(_), [order, ..]) => order * (order + 1) / 2,
            (_, shape) => shape.iter().product(),
        }
    }
}

/// All columns.
pub const COLUMNS: [Column; 25] = [
    Column::new("time", "s", &[], Numbers(|row, out| out[0] = row.time), "time of the row"),
    Column::new(
        "track",
        "",
        &[],
        Integers(|row| row.track),
        "number of the track, from 1; 2**40 and more while late plots may change it",
    ),
    Column::new("sensor", "", &[], Integers(|row| row.radar as i64), "index of the sensor"),
    Column::new(
        "plot",
        "",
        &[],
        Integers(|row| index(row.plot)),
        "index of the plot among all that the tracker was given; -1 for a missed detection",
    ),
    Column::new(
        "position",
        "m",
        &[2],
        Numbers(|row, out| out.copy_from_slice(&row.estimate.mean.as_slice()[..2])),
        "east and north",
    ),
    Column::new(
        "velocity",
        "m/s",
        &[2],
        Numbers(|row, out| out.copy_from_slice(&row.estimate.mean.as_slice()[2..])),
        "east and north",
    ),
    Column::new(
        "covariance",
        "m², m²/s, m²/s²",
        &[4, 4],
        Symmetric(|row, out| {
            let [a, b, c, d] = row.estimate.covariance.data.0;
            out.copy_from_slice(&[a[0], a[1], a[2], a[3], b[1], b[2], b[3], c[2], c[3], d[3]]);
        }),
        "of position and velocity",
    ),
    Column::new(
        "innovation",
        "m",
        &[2],
        Numbers(|row, out| out.copy_from_slice(&row.innovation)),
        "plot minus its prediction; nan for a missed detection",
    ),
    Column::new(
        "innovation_covariance",
        "m²",
        &[2, 2],
        Symmetric(|row, out| {
            let Plane { xx, xy, yy } = row.innovation_covariance;
            out.copy_from_slice(&[xx, xy, yy]);
        }),
        "covariance of the innovation",
    ),
    Column::new(
        "turn_probability",
        "",
        &[],
        Numbers(|row, out| out[0] = row.turn_probability),
        "probability that the target turns",
    ),
    Column::new(
        "speed_change_probability",
        "",
        &[],
        Numbers(|row, out| out[0] = row.speed_change_probability),
        "probability that the speed of the target changes; 0 while it follows a plan",
    ),
    Column::new(
        "association_probability",
        "",
        &[],
        Numbers(|row, out| out[0] = row.association_probability),
        "probability that the plots of the track belong to it; 1 if no alternative is likely",
    ),
    Column::new(
        "existence_probability",
        "",
        &[],
        Numbers(|row, out| out[0] = row.existence_probability),
        "probability that the track belongs to a target and not to false plots",
    ),
    Column::new(
        "height",
        "m",
        &[],
        Numbers(|row, out| out[0] = row.height),
        "height; nan if none was reported",
    ),
    Column::new(
        "vertical_rate",
        "m/s",
        &[],
        Numbers(|row, out| out[0] = row.vertical_rate),
        "rate of climb, positive upward; nan if no height was reported",
    ),
    Column::new(
        "icao_address",
        "",
        &[],
        Integers(|row| row.identities.icao_address.into()),
        "24-bit address; -1 if it is not known",
    ),
    Column::new(
        "mode_3a",
        "",
        &[],
        Integers(|row| row.identities.mode_3a.into()),
        "mode 3/A code; -1 if it is not known",
    ),
    Column::new(
        "callsign",
        "",
        &[],
        Callsigns(|row| row.identities.callsign),
        "aircraft identification; empty if it is not known",
    ),
    Column::new(
        "identity",
        "",
        &[],
        Integers(|row| row.identities.identity),
        "any other number that stays with the target; -1 if there is none",
    ),
    Column::new(
        "plan",
        "",
        &[],
        Integers(|row| index(row.plan)),
        "index of the flight plan; -1 if the track has none",
    ),
    Column::new(
        "plan_status",
        "",
        &[],
        Integers(|row| row.plan_status as i64),
        "how the track came to its plan, or why it has none: a `CorrelationStatus`",
    ),
    Column::new(
        "merged",
        "",
        &[],
        Flags(|row| row.merged),
        "whether another track shares the plot, because the radar did not resolve both targets",
    ),
    Column::new(
        "confirmed",
        "",
        &[],
        Flags(|row| row.confirmed),
        "whether the track was confirmed at this time",
    ),
    Column::new(
        "conforms",
        "",
        &[],
        Flags(|row| row.conforms),
        "whether the target follows its plan; false while the plan is blocked",
    ),
    Column::new(
        "final",
        "",
        &[],
        Flags(|row| row.is_final),
        "whether the row is final; false while late plots may still change it",
    ),
];

/// The index, or −1 if there is none.
fn index(index: Option<usize>) -> i64 {
    index.map_or(-1, |index| index as i64)
}
