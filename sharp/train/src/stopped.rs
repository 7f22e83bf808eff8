//! Saves the example on which a step failed, for diagnosis.

use std::fs;
use std::io;
use std::path::Path;

use image::ExtendedColorType;
use serde_json::json;
use sharp::image_file::encode_png;

use crate::data::Sample;
use crate::losses::TERMS;

/// Writes the available pictures, depth (f32, little-endian, row by row), masks, cameras and losses
/// to a folder.
pub(crate) fn save(
    folder: &Path,
    sample: &Sample,
    terms: Option<[f64; TERMS.len()]>,
) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let mut views = serde_json::Map::new();
    for (role, view) in [("source", &sample.source), ("target", &sample.target)] {
        let picture = folder.join(format!("{role}.png"));
        png(
            &picture,
            &view.image,
            view.image.dimensions(),
            ExtendedColorType::Rgb8,
        )?;
        let depth: Vec<u8> = view.depth.iter().flat_map(|d| d.to_le_bytes()).collect();
        fs::write(folder.join(format!("{role}-depth.f32")), depth)?;
        if let Some(valid) = &view.valid {
            let (width, height) = view.image.dimensions();
            let levels = valid.iter().map(|counts| 255 * u8::from(*counts));
            let levels: Vec<u8> = levels.collect();
            let mask = folder.join(format!("{role}-mask.png"));
            png(&mask, &levels, (width, height), ExtendedColorType::L8)?;
        }
        let k = view.intrinsics;
        let camera = json!({
            "intrinsics": [k.fx, k.fy, k.cx, k.cy],
            "size": [k.width, k.height],
            "camera_from_world": view.camera_from_world.to_row_major(),
        });
        views.insert(role.to_owned(), camera);
    }
    // JSON has no NaN: non-finite values are written as text.
    let losses = TERMS.iter().zip(terms.into_iter().flatten());
    let losses: serde_json::Map<_, _> = losses
        .map(|(term, value)| ((*term).to_owned(), json!(value.to_string())))
        .collect();
    let text = json!({ "id": sample.id, "views": views, "losses": losses }).to_string();
    fs::write(folder.join("step.json"), text)
}

fn png(path: &Path, samples: &[u8], size: (u32, u32), color: ExtendedColorType) -> io::Result<()> {
    fs::write(
        path,
        encode_png(samples, size, color).map_err(io::Error::other)?,
    )
}
