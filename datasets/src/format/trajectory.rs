//! Trajectory files: Tanks and Temples' `.log` and `_trans.txt`, WildRGB-D's `cam_poses.txt`.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3};
use sharp::camera::{CameraError, RigidTransform, affine_from_row_major};

use super::FormatError;

/// A frame number with its pose (camera to world in OpenCV's axes) or the reason why the pose is
/// invalid.
#[derive(Debug, Clone, PartialEq)]
pub struct NumberedPose {
    /// Frame number as written.
    pub frame: i64,
    /// Pose in the file's units.
    pub world_from_camera: Result<RigidTransform, CameraError>,
}

/// The blocks and poses of a `.log` file.
#[derive(Debug, Clone, PartialEq)]
pub struct Log {
    /// Indices of all blocks, in order; 0 belongs to the first picture.
    pub blocks: Vec<i64>,
    /// Poses, sorted by the index of their block. Blocks whose second number is −1 represent pictures without a pose
    /// and are omitted.
    pub poses: Vec<NumberedPose>,
}

/// Parses a `.log`: blocks of three integers and a 4×4 matrix, separated by any white space. The
/// first integer is the block's index. If all blocks have the same index, the indices are ignored
/// and the blocks are numbered from 0 instead.
///
/// # Errors
/// If a block is incomplete, something is not a number, or an index is negative or repeated.
pub fn parse_log(text: &str) -> Result<Log, FormatError> {
    let numbers = numbers(text)?;
    let mut blocks = Vec::new();
    for (i, block) in numbers.chunks(19).enumerate() {
        let block = <[f64; 19]>::try_from(block).map_err(|_| {
            invalid!(
                "block {i} has {} numbers instead of 19 (truncated?)",
                block.len()
            )
        })?;
        if block[..3].iter().any(|n| n.fract() != 0.0) {
            return Err(invalid!("block {i} does not start with three integers"));
        }
        blocks.push(block);
    }
    let says_nothing = blocks.len() > 1 && blocks.iter().all(|block| block[0] == blocks[0][0]);
    let mut by_index = BTreeMap::new();
    for (i, block) in blocks.iter().enumerate() {
        let index = if says_nothing { i as f64 } else { block[0] };
        // Beyond 2^53, f64 cannot represent every integer.
        if !(0.0..=9e15).contains(&index) {
            return Err(invalid!(
                "block {i} states the index {index}, which is negative or too large"
            ));
        }
        if by_index.insert(index as i64, block).is_some() {
            return Err(invalid!("two blocks state the index {index}"));
        }
    }
    Ok(Log {
        blocks: by_index.keys().copied().collect(),
        poses: by_index
            .into_iter()
            .filter(|(_, block)| block[1] != -1.0)
            .map(|(frame, block)| NumberedPose {
                frame,
                world_from_camera: pose(&block[3..]),
            })
            .collect(),
    })
}

/// Parses a `cam_poses.txt`: a frame number and a 4×4 matrix per row.
///
/// # Errors
/// If a row does not have 17 numbers; names it.
pub fn parse_rows(text: &str) -> Result<Vec<NumberedPose>, FormatError> {
    text.lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'))
        .map(|(i, line)| {
            let row = numbers(line).map_err(|e| invalid!("row {}: {e}", i + 1))?;
            if row.len() != 17 || row[0].fract() != 0.0 {
                return Err(invalid!(
                    "row {} has {} numbers; expected 17, an integer frame number and the 16 of its pose",
                    i + 1,
                    row.len()
                ));
            }
            Ok(NumberedPose {
                frame: row[0] as i64,
                world_from_camera: pose(&row[1..]),
            })
        })
        .collect()
}

/// A similarity between two coordinate systems: `x' = scale · rotation · x + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimilarityTransform {
    /// Destination units (metres) per source unit.
    pub scale: f64,
    affine: DAffine3,
}

impl SimilarityTransform {
    /// Creates a similarity from a row-major 4×4 matrix.
    ///
    /// # Errors
    /// If the matrix is not finite, not affine, mirroring, or not a rotation times a scale.
    pub fn from_row_major(m: &[f64; 16]) -> Result<Self, FormatError> {
        let affine = affine_from_row_major(m).map_err(|e| invalid!("{e}"))?;
        let determinant = affine.matrix3.determinant();
        if determinant <= 0.0 || !determinant.is_finite() {
            return Err(invalid!(
                "the determinant of the similarity is {determinant}, but must be above zero"
            ));
        }
        let scale = determinant.cbrt();
        RigidTransform::new(affine.matrix3 * (1.0 / scale), affine.translation)
            .map_err(|e| invalid!("{e}"))?;
        Ok(Self { scale, affine })
    }

    /// Transforms a camera-to-world pose: its centre is transformed, and its axes are rotated but not scaled.
    ///
    /// # Errors
    /// [`CameraError`] if the result is not rigid.
    pub fn apply_to_pose(
        &self,
        world_from_camera: &RigidTransform,
    ) -> Result<RigidTransform, CameraError> {
        let rotation: DMat3 = self.affine.matrix3 * (1.0 / self.scale) * world_from_camera.rotation;
        RigidTransform::new(
            rotation,
            self.affine.transform_point3(world_from_camera.translation),
        )
    }
}

/// Parses a `_trans.txt`: a 4×4 similarity.
///
/// # Errors
/// If the text does not have 16 numbers, or these do not form a similarity.
pub fn parse_similarity(text: &str) -> Result<SimilarityTransform, FormatError> {
    let row = <[f64; 16]>::try_from(numbers(text)?);
    let row = row.map_err(|row| invalid!("there are {} numbers instead of 16", row.len()))?;
    SimilarityTransform::from_row_major(&row)
}

fn pose(row: &[f64]) -> Result<RigidTransform, CameraError> {
    let mut m = [0.0; 16];
    m.copy_from_slice(row);
    RigidTransform::from_row_major(&m)
}

fn numbers(text: &str) -> Result<Vec<f64>, FormatError> {
    text.split_ascii_whitespace()
        .map(|t| t.parse().map_err(|_| invalid!("'{t}' is not a number")))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn a_similarity_scales_centres_and_only_turns_axes() {
        // 2 · (a quarter turn about z), then a shift.
        let m = [
            0.0, -2.0, 0.0, 10.0, 2.0, 0.0, 0.0, 20.0, 0.0, 0.0, 2.0, 30.0, 0.0, 0.0, 0.0, 1.0,
        ];
        let similarity = SimilarityTransform::from_row_major(&m).unwrap();
        assert!((similarity.scale - 2.0).abs() < 1e-15);
        let camera = RigidTransform {
            rotation: DMat3::IDENTITY,
            translation: DVec3::new(1.0, 0.0, 0.0),
        };
        let moved = similarity.apply_to_pose(&camera).unwrap();
        assert!((moved.translation - DVec3::new(10.0, 22.0, 30.0)).length() < 1e-14);
        assert!((moved.rotation.x_axis - DVec3::Y).length() < 1e-15);
        let mut mirrored = m;
        mirrored[10] = -2.0;
        assert!(SimilarityTransform::from_row_major(&mirrored).is_err());
        let mut sheared = m;
        sheared[0] = 1.0;
        assert!(SimilarityTransform::from_row_major(&sheared).is_err());
    }

    #[test]
    fn blocks_are_numbered_by_their_own_index_or_by_their_position() {
        let identity = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";
        let parse = |heads: &[&str]| {
            let text: String = heads.iter().map(|h| format!("{h}\n{identity}\n")).collect();
            parse_log(&text)
        };
        let frames = |log: &Log| log.poses.iter().map(|p| p.frame).collect::<Vec<_>>();
        let gap = parse(&["3 3 0", "0 0 0", "1 -1 0"]).unwrap();
        assert_eq!(
            (gap.blocks.as_slice(), frames(&gap)),
            (&[0, 1, 3][..], vec![0, 3])
        );
        let silent = parse(&["0 0 0", "0 -1 0", "0 0 0"]).unwrap();
        assert_eq!(
            (silent.blocks.as_slice(), frames(&silent)),
            (&[0, 1, 2][..], vec![0, 2])
        );
        for (heads, reason) in [
            (["0 0 0", "1 1 0", "1 1 0"], "two blocks state the index 1"),
            (["-1 0 0", "0 1 0", "1 1 0"], "block 0 states the index -1"),
            (
                ["0 0 0", "1e300 1 0", "1 1 0"],
                "block 1 states the index 1",
            ),
            (["0 0 0", "1 0.5 0", "2 1 0"], "block 1 does not start"),
        ] {
            let error = parse(&heads).unwrap_err();
            assert!(error.to_string().contains(reason), "{error}");
        }
    }

    #[test]
    fn rows_are_matched_by_their_numbers() {
        let identity = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";
        let poses = parse_rows(&format!("5 {identity}\n\n7 {identity}\n")).unwrap();
        assert_eq!(poses.iter().map(|p| p.frame).collect::<Vec<_>>(), [5, 7]);
        assert!(
            parse_rows("5 1 0 0")
                .unwrap_err()
                .to_string()
                .contains("row 1 has 4")
        );
        assert!(parse_rows(&format!("x {identity}")).is_err());
    }
}
