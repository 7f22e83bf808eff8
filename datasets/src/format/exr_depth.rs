//! Depth in OpenEXR files: a channel named Z, depth, V or Y, or the only channel.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::{
    FlatSamples, MetaData, ReadChannels as _, ReadLayers as _, f16, read as exr_reader,
};

use sharp::camera::Intrinsics;

use super::{FloatMap, FormatError};
use crate::DatasetError;

/// Reads the first layer that has a depth channel; values are returned as stored.
///
/// # Errors
/// If the file is not EXR, has no such channel, is damaged, or states a size that a file of its length cannot contain.
pub fn parse(bytes: &[u8]) -> Result<FloatMap, FormatError> {
    size(bytes)?;
    let image = exr_reader()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| invalid!("{e}"))?;
    for layer in &image.layer_data {
        let channels = &layer.channel_data.list;
        let named = |name: &str| {
            channels
                .iter()
                .find(|c| c.name.to_string().eq_ignore_ascii_case(name))
        };
        let channel = ["Z", "depth", "V", "Y"]
            .iter()
            .find_map(|name| named(name))
            .or_else(|| channels.first().filter(|_| channels.len() == 1));
        let Some(channel) = channel else { continue };
        let values: Vec<f32> = match &channel.sample_data {
            FlatSamples::F16(v) => v.iter().copied().map(f16::to_f32).collect(),
            FlatSamples::F32(v) => v.clone(),
            FlatSamples::U32(v) => v.iter().map(|v| *v as f32).collect(),
        };
        let side = |n: usize| u32::try_from(n).ok().filter(|n| *n > 0);
        return side(layer.size.width())
            .zip(side(layer.size.height()))
            .and_then(|(w, h)| FloatMap::from_vec(w, h, values))
            .ok_or_else(|| "the depth channel is subsampled".into());
    }
    Err("there are several channels, none of which is named Z, depth, V or Y".into())
}

/// Width and height of the largest layer, read from the header.
///
/// # Errors
/// If the file is not EXR, states a size that a file of its length cannot contain, or has more samples than four
/// pictures of the maximum camera size.
pub(super) fn size(bytes: &[u8]) -> Result<(u32, u32), FormatError> {
    let meta =
        MetaData::read_from_buffered(Cursor::new(bytes), true).map_err(|e| invalid!("{e}"))?;
    let (mut largest, mut all) = ((0, 0), 0_usize);
    for header in &meta.headers {
        let (width, height) = (header.layer_size.width(), header.layer_size.height());
        let pixels = width.saturating_mul(height);
        let samples = pixels.saturating_mul(header.channels.list.len());
        all = all.saturating_add(samples);
        // Deflate, EXR's strongest compression, shrinks data at most 1032-fold.
        if samples / 1032 > bytes.len() || all as u64 / 4 > Intrinsics::MAX_PIXELS {
            return Err(invalid!(
                "the header declares {width}x{height} pixels, too many for a file of {} bytes or for any map",
                bytes.len()
            ));
        }
        if pixels > largest.0 * largest.1 {
            largest = (width, height);
        }
    }
    let side = |n: usize| u32::try_from(n).ok().filter(|n| *n > 0);
    let sides = side(largest.0).zip(side(largest.1));
    sides.ok_or_else(|| "the file contains no pixels".into())
}

/// Writes a map as channel Z of an EXR file.
///
/// # Errors
/// If the file cannot be written.
pub fn write(path: &Path, map: &FloatMap) -> Result<(), DatasetError> {
    use exr::prelude::{
        AnyChannel, AnyChannels, Encoding, Image, Layer, LayerAttributes, SmallVec,
        WritableImage as _,
    };
    let channel = AnyChannel::new("Z", FlatSamples::F32(map.as_raw().clone()));
    let layer = Layer::new(
        (map.width() as usize, map.height() as usize),
        LayerAttributes::named("depth"),
        Encoding::SMALL_FAST_LOSSLESS,
        AnyChannels::sort(SmallVec::from_vec(vec![channel])),
    );
    Image::from_layer(layer)
        .write()
        .to_file(path)
        .map_err(|e| DatasetError::malformed(path, e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let map = FloatMap::from_fn(19, 7, |x, y| image::Luma([x as f32 * 0.1 + y as f32]));
        write(&path, &map).unwrap();
        assert_eq!(parse(&std::fs::read(&path).unwrap()).unwrap(), map);
        let bytes = std::fs::read(&path).unwrap();
        for cut in [0, 4, 40, bytes.len() / 2, bytes.len() - 1] {
            assert!(parse(&bytes[..cut]).is_err(), "{cut}");
        }
    }
}
