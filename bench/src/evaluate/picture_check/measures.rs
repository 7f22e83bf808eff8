//! What is measured in a stored picture and kept in its record.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The least-squares equations of a picture's shift, divided by the number of displacements: matrix elements xx, xy and
/// yy; right-hand side x and y; sum of squared displacements, which is the error without a shift.
pub(crate) type ShiftEquations = [f32; 6];

/// A cell's number, row by row, and its mean levels in the picture and in the target.
pub(crate) type Cell = (u16, u8, u8);

/// Levels of a picture, its target and its source at the 10th, 30th, 50th, 70th and 90th percentile, by channel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Tone {
    pub(super) picture: [[u8; 5]; 3],
    pub(super) target: [[u8; 5]; 3],
    pub(super) source: [[u8; 5]; 3],
    /// For the corners and halfway to them: natural logarithm of the ratio of the picture's brightness to the target's,
    /// minus the same logarithm in the middle, in thousandths.
    pub(super) corners: Option<[i16; 2]>,
    /// Share of the green light in the picture's red, of the red in its green and of the green in its blue, in
    /// thousandths; `None` if the target has too little colour.
    pub(super) mixed: Option<[i16; 3]>,
}
