//! COLMAP's binary files: little-endian, packed. Errors contain the reason only.

use std::collections::BTreeMap;

use glam::DVec3;

use super::FormatError;
use super::colmap_records::{ColmapCamera, ColmapImage, ColmapPoint, pose, size};
use crate::lens::COLMAP_MODELS;

/// Maximum number of parameters tried for an unknown camera model; COLMAP's own have at most 16.
const MAX_PARAMS: usize = 32;

/// Parses `cameras.bin`. Records do not state their length, so the number of parameters of an unknown camera model is
/// inferred. There may be only one unknown model, and exactly one number of parameters must make the last record end
/// with the file. The model is then named by its number.
///
/// # Errors
/// If the file is truncated, states more records than its bytes can contain, or has camera models of unknown length.
pub fn cameras(bytes: &[u8]) -> Result<BTreeMap<u32, ColmapCamera>, FormatError> {
    let mut unknown = None;
    let known = cameras_with(bytes, &mut |model| {
        unknown = Some(model);
        None
    });
    let Some(unknown) = unknown else {
        return known;
    };
    let mut fitting = (0..=MAX_PARAMS).filter_map(|params| {
        cameras_with(bytes, &mut |model| (model == unknown).then_some(params)).ok()
    });
    match (fitting.next(), fitting.next()) {
        (Some(cameras), None) => Ok(cameras),
        _ => known,
    }
}

/// Reads cameras. For a model that is not built in, `params_of` returns an assumed number of parameters, if any. With
/// such an assumption, the records must fill the file exactly.
fn cameras_with(
    bytes: &[u8],
    params_of: &mut dyn FnMut(i32) -> Option<usize>,
) -> Result<BTreeMap<u32, ColmapCamera>, FormatError> {
    let mut reader = RecordReader { rest: bytes };
    let count = reader.count(24)?;
    let mut cameras = BTreeMap::new();
    let mut is_guessed = false;
    for _ in 0..count {
        let id = reader.u32()?;
        let model_id = reader.u32()? as i32;
        let (width, height) = (reader.u64()?, reader.u64()?);
        let known = usize::try_from(model_id).ok();
        let known = known.and_then(|i| COLMAP_MODELS.get(i));
        let (model, params) = match known {
            Some((model, params)) => ((*model).to_owned(), *params),
            None => {
                is_guessed = true;
                let params = params_of(model_id).ok_or_else(|| {
                    invalid!(
                        "camera {id} has unknown model {model_id}; make pinhole pictures with `colmap \
                         image_undistorter`"
                    )
                })?;
                (model_id.to_string(), params)
            }
        };
        let camera = ColmapCamera {
            model,
            size: size(width, height)?,
            params: (0..params)
                .map(|_| reader.f64())
                .collect::<Result<_, _>>()?,
        };
        cameras.insert(id, camera);
    }
    if is_guessed && (!reader.rest.is_empty() || cameras.len() < count) {
        return Err("the last record does not end at the end of the file".into());
    }
    Ok(cameras)
}

/// Parses `images.bin`.
///
/// # Errors
/// If the file is truncated, or states more records than its bytes can contain.
pub fn images(bytes: &[u8]) -> Result<Vec<ColmapImage>, FormatError> {
    let mut reader = RecordReader { rest: bytes };
    let count = reader.count(73)?;
    (0..count)
        .map(|_| {
            let id = reader.u32()?;
            let mut values = [0.0; 7];
            for value in &mut values {
                *value = reader.f64()?;
            }
            let [w, x, y, z, tx, ty, tz] = values;
            let camera_id = reader.u32()?;
            let name = reader.name()?;
            let observations = reader.count(24)?;
            reader.take(24 * observations)?;
            Ok(ColmapImage {
                id,
                camera_id,
                name,
                camera_from_world: pose([w, x, y, z], [tx, ty, tz]),
            })
        })
        .collect()
}

/// Parses `points3D.bin`.
///
/// # Errors
/// If the file is truncated, or states more records than its bytes can contain.
pub fn points(bytes: &[u8]) -> Result<Vec<ColmapPoint>, FormatError> {
    let mut reader = RecordReader { rest: bytes };
    let count = reader.count(51)?;
    (0..count)
        .map(|_| {
            reader.u64()?;
            let position = DVec3::new(reader.f64()?, reader.f64()?, reader.f64()?);
            reader.take(3 + 8)?;
            let track = reader.count(8)?;
            let seen_by = (0..track)
                .map(|_| {
                    let image = reader.u32()?;
                    reader.u32()?;
                    Ok(image)
                })
                .collect::<Result<_, FormatError>>()?;
            Ok(ColmapPoint { position, seen_by })
        })
        .collect()
}

const TRUNCATED: &str = "the file ends early (truncated?)";

struct RecordReader<'a> {
    rest: &'a [u8],
}

impl<'a> RecordReader<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], FormatError> {
        let (taken, rest) = self.rest.split_at_checked(n).ok_or(TRUNCATED)?;
        self.rest = rest;
        Ok(taken)
    }

    /// Reads a record count, and checks that the rest of the file can hold that many records of at least `smallest`
    /// bytes.
    fn count(&mut self, smallest: usize) -> Result<usize, FormatError> {
        let n = self.u64()?;
        match usize::try_from(n) {
            Ok(count) if count <= self.rest.len() / smallest => Ok(count),
            _ => Err(invalid!(
                "{n} records do not fit the {} bytes that follow",
                self.rest.len()
            )),
        }
    }

    fn chunk<const N: usize>(&mut self) -> Result<[u8; N], FormatError> {
        let (chunk, rest) = self.rest.split_first_chunk().ok_or(TRUNCATED)?;
        self.rest = rest;
        Ok(*chunk)
    }

    fn u32(&mut self) -> Result<u32, FormatError> {
        self.chunk().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, FormatError> {
        self.chunk().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, FormatError> {
        self.chunk().map(f64::from_le_bytes)
    }

    /// Reads a name that ends with a zero byte.
    fn name(&mut self) -> Result<String, FormatError> {
        let end = self
            .rest
            .iter()
            .position(|b| *b == 0)
            .ok_or("the file ends within an image's name")?;
        let name = String::from_utf8_lossy(&self.rest[..end]).into_owned();
        self.rest = &self.rest[end + 1..];
        Ok(name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image_bytes() -> Vec<u8> {
        let mut b = 1_u64.to_le_bytes().to_vec();
        b.extend(7_u32.to_le_bytes());
        for v in [2.0_f64, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0] {
            b.extend(v.to_le_bytes());
        }
        b.extend(0_u32.to_le_bytes());
        b.extend(b"sub dir/a b.JPG\0");
        b.extend(1_u64.to_le_bytes());
        b.extend([0; 24]);
        b
    }

    #[test]
    fn images_are_read_and_every_truncation_is_noticed() {
        let bytes = image_bytes();
        let images = images(&bytes).unwrap();
        assert_eq!(images[0].name, "sub dir/a b.JPG");
        assert_eq!((images[0].id, images[0].camera_id), (7, 0));
        let pose = images[0].camera_from_world.unwrap();
        assert_eq!(pose.rotation, glam::DMat3::IDENTITY);
        assert_eq!(pose.translation, DVec3::new(1.0, 2.0, 3.0));
        for cut in 0..bytes.len() {
            assert!(super::images(&bytes[..cut]).is_err(), "{cut}");
        }
    }

    #[test]
    fn huge_counts_allocate_nothing() {
        let bytes = [u64::MAX.to_le_bytes().as_slice(), &[0; 100]].concat();
        assert!(
            cameras(&bytes)
                .unwrap_err()
                .to_string()
                .contains("do not fit")
        );
        assert!(
            images(&bytes)
                .unwrap_err()
                .to_string()
                .contains("do not fit")
        );
        assert!(
            points(&bytes)
                .unwrap_err()
                .to_string()
                .contains("do not fit")
        );
    }

    #[test]
    fn unknown_models_are_named() {
        let camera = |model: i32| {
            let mut b = 1_u64.to_le_bytes().to_vec();
            b.extend(1_u32.to_le_bytes());
            b.extend(model.to_le_bytes());
            b.extend(640_u64.to_le_bytes());
            b.extend(480_u64.to_le_bytes());
            b.extend([0; 96]);
            b
        };
        assert_eq!(cameras(&camera(7)).unwrap()[&1].model, "FOV");
        assert_eq!(cameras(&camera(10)).unwrap()[&1].params.len(), 12);
        for unknown in [18, -1] {
            let bytes = camera(unknown);
            let read = &cameras(&bytes).unwrap()[&1];
            assert_eq!(
                (read.model.as_str(), read.params.len()),
                (&*unknown.to_string(), 12)
            );
            assert!(read.lens().is_err());
            // No whole number of parameters fills the file.
            let error = cameras(&bytes[..bytes.len() - 4]).unwrap_err();
            assert!(
                error
                    .to_string()
                    .contains(&format!("unknown model {unknown}")),
                "{error}"
            );
        }
    }

    fn file(cameras: &[(u32, i32, &[f64])]) -> Vec<u8> {
        let mut b = (cameras.len() as u64).to_le_bytes().to_vec();
        for (id, model, params) in cameras {
            b.extend(id.to_le_bytes());
            b.extend(model.to_le_bytes());
            b.extend(640_u64.to_le_bytes());
            b.extend(480_u64.to_le_bytes());
            params
                .iter()
                .for_each(|value| b.extend(value.to_le_bytes()));
        }
        b
    }

    const PINHOLE: &[f64] = &[500.0, 500.0, 320.0, 240.0];

    #[test]
    fn one_unknown_model_costs_its_own_cameras() {
        let odd: &[f64] = &[510.0, 511.0, 321.0, 241.0, 0.1, 0.2, 0.3];
        let read = cameras(&file(&[
            (1, 1, PINHOLE),
            (2, 99, odd),
            (3, 99, odd),
            (4, 1, PINHOLE),
        ]));
        let read = read.unwrap();
        assert_eq!(
            (read[&2].params.as_slice(), read[&3].params.as_slice()),
            (odd, odd)
        );
        assert!(read[&1].lens().is_ok() && read[&4].lens().is_ok());
        let error = read[&2].lens().unwrap_err().to_string();
        assert!(error.contains("'99' is not supported"), "{error}");
    }

    #[test]
    fn two_unknown_models_are_of_unknown_length() {
        let error = cameras(&file(&[(1, 98, PINHOLE), (2, 99, PINHOLE)])).unwrap_err();
        assert!(error.to_string().contains("unknown model 98"), "{error}");
    }
}
