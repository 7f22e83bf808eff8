//! COLMAP's binary files: little-endian, packed. Errors are bare reasons.

use std::collections::BTreeMap;

use glam::DVec3;

use super::FormatError;
use super::colmap_records::{ColmapCamera, ColmapImage, ColmapPoint, pose, size};
use crate::lens::COLMAP_MODELS;

/// `cameras.bin`.
///
/// # Errors
/// Truncated, or more records than the bytes can hold, or an unknown camera model.
pub fn cameras(bytes: &[u8]) -> Result<BTreeMap<u32, ColmapCamera>, FormatError> {
    let mut reader = RecordReader { rest: bytes };
    let count = reader.count(24)?;
    let mut cameras = BTreeMap::new();
    for _ in 0..count {
        let id = reader.u32()?;
        let model_id = reader.u32()? as i32;
        let (width, height) = (reader.u64()?, reader.u64()?);
        // The file does not say how many parameters follow: an unknown model ends the reading.
        let (model, params) = usize::try_from(model_id)
            .ok()
            .and_then(|i| COLMAP_MODELS.get(i))
            .ok_or_else(|| {
                invalid!(
                    "camera {id} is of unknown model {model_id} (`colmap image_undistorter` makes pinhole pictures)"
                )
            })?;
        let model = (*model).to_owned();
        let camera = ColmapCamera {
            model,
            size: size(width, height)?,
            params: (0..*params)
                .map(|_| reader.f64())
                .collect::<Result<_, _>>()?,
        };
        cameras.insert(id, camera);
    }
    Ok(cameras)
}

/// `images.bin`.
///
/// # Errors
/// Truncated, or more records than the bytes can hold.
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

/// `points3D.bin`.
///
/// # Errors
/// Truncated, or more records than the bytes can hold.
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

    /// A count of records of at least `smallest` bytes, which the rest of the file must hold.
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

    /// A name that ends with a zero byte.
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
        assert!(
            cameras(&camera(18))
                .unwrap_err()
                .to_string()
                .contains("model 18")
        );
        assert_eq!(cameras(&camera(7)).unwrap()[&1].model, "FOV");
        assert!(
            cameras(&camera(-1))
                .unwrap_err()
                .to_string()
                .contains("model -1")
        );
        assert_eq!(cameras(&camera(10)).unwrap()[&1].params.len(), 12);
    }
}
