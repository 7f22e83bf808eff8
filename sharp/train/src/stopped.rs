//! The inputs of a step that went wrong, for someone who wants to know why.

use std::fs;
use std::io;
use std::path::Path;

use serde_json::json;

use crate::objective::TERMS;
use crate::self_supervision::MaskedSample;

/// Writes pictures, depth (f32, little endian, row by row), cameras and losses into a folder.
pub(crate) fn save(
    folder: &Path,
    samples: &[MaskedSample],
    terms: &[f64; TERMS.len()],
) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let mut described = Vec::new();
    for (k, MaskedSample { sample, .. }) in samples.iter().enumerate() {
        let mut views = serde_json::Map::new();
        for (role, view) in [("source", &sample.source), ("target", &sample.target)] {
            let stem = format!("{k}-{role}");
            let picture = folder.join(format!("{stem}.png"));
            view.image.save(&picture).map_err(io::Error::other)?;
            let depth: Vec<u8> = view.depth.iter().flat_map(|d| d.to_le_bytes()).collect();
            fs::write(folder.join(format!("{stem}-depth.f32")), depth)?;
            let k = view.intrinsics;
            let camera = json!({
                "intrinsics": [k.fx, k.fy, k.cx, k.cy],
                "size": [k.width, k.height],
                "camera_from_world": view.camera_from_world.to_row_major(),
            });
            views.insert(role.to_owned(), camera);
        }
        described.push(json!({ "id": sample.id, "views": views }));
    }
    // JSON knows no NaN: what is not finite is written as text.
    let losses = TERMS.iter().zip(terms);
    let losses: serde_json::Map<_, _> = losses
        .map(|(term, value)| ((*term).to_owned(), json!(value.to_string())))
        .collect();
    let text = json!({ "samples": described, "losses": losses }).to_string();
    fs::write(folder.join("step.json"), text)
}
