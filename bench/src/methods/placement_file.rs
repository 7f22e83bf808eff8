//! Reads the map from a file's coordinates to its [`FileSpace`](super::file_reading::FileSpace) from JSON: nerfstudio's
//! `dataparser_transforms.json`, or a matrix.

use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};
use serde::Deserialize;

/// A matrix is a similarity if its columns are equally long and orthogonal up to this share of their squared length.
const SIMILARITY: f64 = 1e-3;

#[derive(Deserialize)]
#[serde(untagged)]
enum File {
    /// `x_file = scale · (transform · [x_world; 1])`.
    Nerfstudio {
        /// Three or four rows.
        transform: Vec<[f64; 4]>,
        scale: f64,
    },
    /// Map from the file's coordinates to its `FileSpace`.
    Matrix([[f64; 4]; 4]),
}

/// Reads the map from a file's coordinates to its `FileSpace`. Errors do not name the file.
pub(super) fn read(path: &Path) -> Result<DAffine3, String> {
    let text = sharp::files::read_text(path).map_err(|error| error.to_string())?;
    let needed = |_| {
        "expected nerfstudio's dataparser_transforms.json (transform, scale) or a matrix of 4 rows of 4 numbers".to_owned()
    };
    let (rows, scale) = match serde_json::from_str(&text).map_err(needed)? {
        File::Nerfstudio { transform, scale } => (transform, Some(scale)),
        File::Matrix(rows) => (rows.to_vec(), None),
    };
    let (Some([x, y, z]), None | Some([0.0, 0.0, 0.0, 1.0])) = (rows.first_chunk(), rows.get(3))
    else {
        return Err("expected either three rows, or four rows with 0 0 0 1 as the last".to_owned());
    };
    let linear =
        DMat3::from_cols_array_2d(&[x, y, z].map(|row| [row[0], row[1], row[2]])).transpose();
    let shift = DVec3::from([x, y, z].map(|row| row[3]));
    let map = DAffine3::from_mat3_translation(
        linear * scale.unwrap_or(1.0),
        shift * scale.unwrap_or(1.0),
    );
    check(&map)?;
    Ok(match scale {
        Some(_) => map.inverse(),
        None => map,
    })
}

/// Accepts only rotation, scale and translation, because other maps would shear Gaussians or mirror the scene.
pub(super) fn check(map: &DAffine3) -> Result<(), String> {
    let [x, y, z] = [map.matrix3.x_axis, map.matrix3.y_axis, map.matrix3.z_axis];
    let determinant = map.matrix3.determinant();
    if !(map.is_finite() && determinant != 0.0) {
        return Err("the transform is not invertible".to_owned());
    }
    if determinant < 0.0 {
        return Err("the transform mirrors the scene (its determinant is negative)".to_owned());
    }
    let size = x.length_squared();
    let is_off = |value: f64| value.abs() > SIMILARITY * size;
    let unequal = [y, z]
        .into_iter()
        .any(|axis| is_off(axis.length_squared() - size));
    if unequal || [x.dot(y), y.dot(z), z.dot(x)].into_iter().any(is_off) {
        return Err(
            "the transform must consist of a rotation, a uniform scale and a translation"
                .to_owned(),
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Result<DAffine3, String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read(file.path())
    }

    #[test]
    fn nerfstudios_transform_is_undone_and_a_matrix_is_taken_as_it_is() {
        let given = r#"{"transform": [[0,-1,0,1],[1,0,0,2],[0,0,1,3]], "scale": 0.5}"#;
        // x_world = (2, 4, 6) maps to (-4 + 1, 2 + 2, 6 + 3) / 2.
        let found = of(given)
            .unwrap()
            .transform_point3(DVec3::new(-1.5, 2.0, 4.5));
        assert!(
            (found - DVec3::new(2.0, 4.0, 6.0)).length() < 1e-12,
            "{found}"
        );
        let matrix = of("[[2,0,0,1],[0,2,0,0],[0,0,2,0],[0,0,0,1]]").unwrap();
        assert_eq!(matrix.transform_point3(DVec3::X), DVec3::new(3.0, 0.0, 0.0));
    }

    #[test]
    fn mirrors_and_shears_are_refused() {
        for (text, part) in [
            ("[[1,0,0,0],[0,1,0,0],[0,0,-1,0],[0,0,0,1]]", "mirrors"),
            (
                "[[1,1,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]",
                "a uniform scale",
            ),
            ("[[1,0,0,0],[0,1,0,0],[0,0,0,0],[0,0,0,1]]", "invertible"),
            ("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,1,1]]", "0 0 0 1"),
            ("{}", "dataparser_transforms.json"),
        ] {
            let error = of(text).unwrap_err();
            assert!(error.contains(part), "{error}");
        }
    }
}
