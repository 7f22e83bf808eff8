//! Marks in a PLY file of other formats, and of rendering rules that are not supported here.

use super::table::{Element, Header};

/// Advice for converting another format.
const CONVERT: &str = "convert it with `npx @playcanvas/splat-transform IN OUT.ply`";

/// Format of a file that is not a PLY, by its first bytes and its name, with advice; `None` if unknown.
pub fn foreign_format(bytes: &[u8], name: &str) -> Option<String> {
    let name = name.to_ascii_lowercase();
    let is = |end: &str| name.ends_with(end);
    let format = match bytes {
        [b'g', b'l', b'T', b'F', ..] => "glTF",
        [b'N', b'G', b'S', b'P', ..] => "SPZ",
        _ if is(".spz") => "SPZ",
        [0x1f, 0x8b, ..] => {
            return Some("gzip; unpack it (gunzip), or where it is SPZ, name it .spz".to_owned());
        }
        _ if is(".sog") || is("meta.json") => "SOG",
        [b'P', b'K', ..] => "a zip archive (SOG?)",
        _ if is(".ksplat") => "KSPLAT",
        _ if is(".splat") => ".splat",
        _ if is(".glb") || is(".gltf") => "glTF",
        _ if is(".npz") || is(".npy") => "NumPy arrays",
        _ => return None,
    };
    Some(format!("{format}, which is not read; {CONVERT}"))
}

/// Names a form of Gaussians that is not read, with advice.
pub(super) fn other_form(header: &Header, vertex: &Element) -> Option<String> {
    let has = |name: &str| vertex.number(name).is_some();
    let is_chunked = header.elements.iter().any(|e| e.name == "chunk");
    if is_chunked || has("packed_position") {
        return Some(format!(
            "a compressed PLY of PlayCanvas or SuperSplat, which is not read; {CONVERT}"
        ));
    }
    if has("scale_1") && !has("scale_2") {
        return Some(
            "2D Gaussian Splatting (two scales), whose flat Gaussians are not drawn; store a third scale, or render it with \
             the method's own program and score the pictures with `imported`"
                .to_owned(),
        );
    }
    let has_rgb = ["red", "green", "blue"].iter().all(|name| has(name));
    if has_rgb && has("opacity") && !has("f_dc_0") {
        return Some(
            "colours are in red, green, blue instead of f_dc_0, f_dc_1, f_dc_2: `colors=rgb255` reads them".to_owned(),
        );
    }
    None
}

/// Rules of rendering that the file asks for and that are not drawn here, in words.
pub(super) fn other_rule(header: &Header, vertex: &Element) -> Option<String> {
    let comments = header.comments.iter().rev();
    let mut values = comments.filter_map(|comment| {
        let comment = comment.to_ascii_lowercase();
        let (key, value) = comment.split_once([':', ' '])?;
        let value = value.trim().trim_start_matches(':').trim().to_owned();
        matches!(key.trim(), "splatrendermode" | "antialiased")
            .then_some((key.trim().to_owned(), value))
    });
    // The last one counts.
    let mode = values.next();
    match mode
        .as_ref()
        .map(|(key, value)| (key.as_str(), value.as_str()))
    {
        Some(("splatrendermode", "mip") | ("antialiased", "1" | "true")) => {
            return Some("an antialiased rasteriser (SplatRenderMode: mip), whose compensated low-pass filter is not drawn".into());
        }
        Some(("splatrendermode", "2dgs")) => {
            return Some(
                "2D Gaussian Splatting (SplatRenderMode: 2dgs), whose flat Gaussians are not drawn"
                    .into(),
            );
        }
        _ => {}
    }
    vertex.number("filter_3D").map(|_| {
        "Mip-Splatting (property filter_3D), whose filter has to be folded into scales and opacities: export it with \
         save_fused_ply"
            .to_owned()
    })
}

/// True for a nerfstudio export of degree 0, whose coefficients are logits of colours.
pub(super) fn has_logit_colors(header: &Header, coefficients: usize) -> bool {
    let by_nerfstudio = |comment: &String| {
        let comment = comment.to_ascii_lowercase();
        comment.contains("nerfstudio") || comment.contains("nerstudio")
    };
    coefficients == 0 && header.comments.iter().any(by_nerfstudio)
}
