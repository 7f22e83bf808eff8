//! Reads scenes of Gaussians from common file formats or safetensors arrays.

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};

use glam::DAffine3;
use safetensors::SafeTensorError;
use safetensors::tensor::{Dtype, TensorView};
use sharp::camera::{CameraError, Intrinsics, affine_from_row_major};
use sharp::gaussian_files::MarkedRule;
use sharp::gaussians::{Gaussians, Harmonics, LengthMismatch};
use sharp::ply::{
    self, ColorSpace, GaussianScene, Generator, PlyError, PlyReason, StoredColors, StoredForm,
    Suspicion,
};
use sharp::render::Rule;
use sharp_checkpoint::{Checkpoint, CheckpointError};

use super::atomic_files::{FileError, write_atomic};

/// Gaussians, and the camera if the file stores one.
#[derive(Debug, Clone)]
pub struct GaussianFile {
    /// Gaussians in the coordinate system of the program that wrote the file.
    pub gaussians: Gaussians,
    pub camera: Option<(Intrinsics, DAffine3)>,
    /// How the Gaussians are to be rendered.
    pub rule: Rule,
    /// Reason for choosing this rule; `None` if the file or the user states the rule.
    pub rule_note: Option<String>,
    /// How the stored numbers were interpreted.
    pub reading: StoredForm,
    /// Evidence against the interpretation in `reading`.
    pub doubts: Vec<Suspicion>,
}

/// Why a scene could not be read; names the file.
#[derive(Debug, thiserror::Error)]
pub enum GaussianFileError {
    #[error(transparent)]
    Ply(#[from] PlyError),
    #[error(transparent)]
    Arrays(#[from] CheckpointError),
    #[error("{}: {name} has shape {shape:?}, expected [N, {columns}]", path.display())]
    Shape {
        path: PathBuf,
        name: &'static str,
        shape: Vec<usize>,
        columns: usize,
    },
    #[error("{}: {source}", path.display())]
    Lengths {
        path: PathBuf,
        source: LengthMismatch,
    },
    #[error("{}: {source}", path.display())]
    Camera { path: PathBuf, source: CameraError },
    /// The values cannot be those of a scene.
    #[error("{}: {source}", path.display())]
    Stored { path: PathBuf, source: PlyReason },
    /// View-dependent colours cannot be blended in linear light.
    #[error(
        "{}: colours depend on the view ({coefficients} coefficients f_rest_*), which is not rendered; either \
         render only the constant term (`harmonics=drop`), or bake the colours of the source's view into the \
         constant term", path.display()
    )]
    ViewDependent { path: PathBuf, coefficients: usize },
    #[error("{}: sh has shape {shape:?}, expected [N, (degree + 1)², 3] with a degree up to 4", path.display())]
    Harmonics { path: PathBuf, shape: Vec<usize> },
    /// The rendering rule is stated neither in the file nor by the user.
    #[error(
        "{}: it does not state which renderer it was made for; set the rule with rendering=RULE (--rendering RULE), \
         probably {likely} ({why}); for a file from SHARP, set color_space= instead", path.display()
    )]
    RuleUnknown {
        path: PathBuf,
        likely: Rule,
        why: &'static str,
    },
}

/// Reads a scene of Gaussians. A file named `.safetensors` (in any case) has the arrays `means` `[N, 3]`, `quats_wxyz`
/// `[N, 4]`, `scales` `[N, 3]`, `opacities` `[N]`, and `colors_linear` `[N, 3]` or `sh` `[N, (degree + 1)², 3]`. The
/// format of any other file is detected from its content ([`sharp::gaussian_files`]).
///
/// `reading` states how numbers are stored, and, for files that do not state it, how colours are
/// encoded. `rule` determines the colour space for blending. If `rule` is `None`, the rule stated
/// in the file is used. If the file states no rule, SHARP's rule is used, provided that the
/// encoding of colours is known and nothing suggests another rule.
pub fn read(
    path: &Path,
    reading: impl Into<StoredForm>,
    rule: Option<Rule>,
) -> Result<GaussianFile, GaussianFileError> {
    let mut reading = reading.into();
    let extension = path.extension().unwrap_or_default();
    if extension.eq_ignore_ascii_case("safetensors") {
        return read_arrays_as(path, reading, rule);
    }
    let (scene, rule, rule_note) = match rule {
        Some(rule) => {
            reading.blending = rule.blending;
            reading.is_ruled = true;
            let scene = read_scene(path, reading)?;
            let stated = MarkedRule::of(&scene.marks);
            let differs = stated.is_stated && stated.rule != rule;
            let note = (differs && reading.marks != Some(ply::Marks::Ignore)).then(|| {
                format!(
                    "rendered with the rule {rule}, as requested, but the file was made for {} ({})",
                    stated.rule, stated.why
                )
            });
            (scene, rule, note)
        }
        None => read_as_marked(path, reading)?,
    };
    let camera_from_world = match scene.extrinsics {
        None => DAffine3::IDENTITY,
        Some(m) => affine_from_row_major(&m.map(f64::from)).map_err(|source| {
            GaussianFileError::Camera {
                path: path.to_owned(),
                source,
            }
        })?,
    };
    let mut doubts = scene.doubts;
    doubts.extend(undrawn(&scene.gaussians, &rule));
    Ok(GaussianFile {
        camera: scene.intrinsics.map(|k| (k, camera_from_world)),
        gaussians: scene.gaussians,
        rule,
        rule_note,
        reading: scene.reading,
        doubts,
    })
}

/// A suspicion if the rule draws fewer harmonics than the file has.
fn undrawn(gaussians: &Gaussians, rule: &Rule) -> Option<Suspicion> {
    let degree = gaussians.harmonics.degree;
    (degree > rule.degree).then(|| {
        let text = format!(
            "the rule {rule} ignores harmonics above degree {}, but the file has some of degree \
             {degree}",
            rule.degree
        );
        Suspicion::new("degree", text)
    })
}

/// Reads a scene for the rule that the file states, or else for SHARP's rule. Returns the scene,
/// the rule, and the reason for choosing the rule.
fn read_as_marked(
    path: &Path,
    reading: StoredForm,
) -> Result<(GaussianScene, Rule, Option<String>), GaussianFileError> {
    let encoded = StoredForm {
        blending: ColorSpace::Srgb,
        ..reading
    };
    let ignores_marks = reading.marks == Some(ply::Marks::Ignore);
    let marked = |scene: &GaussianScene| MarkedRule::of(&scene.marks);
    match read_scene(path, reading) {
        Ok(scene) if ignores_marks || scene.marks.generator == Some(Generator::Sharp) => {
            Ok((scene, Rule::SHARP, None))
        }
        Ok(scene) if !marked(&scene).is_stated => {
            let note = format!(
                "rendered with the rule {} (blended in linear light); for a file trained by 3D Gaussian Splatting, set \
                 rendering=RULE, probably {}",
                Rule::SHARP,
                marked(&scene).rule
            );
            Ok((scene, Rule::SHARP, Some(note)))
        }
        Err(error) if ignores_marks => Err(error),
        // The file states another rule, or its colours cannot be represented in linear light.
        linear => match read_scene(path, encoded) {
            Ok(scene) => {
                let MarkedRule {
                    rule,
                    is_stated,
                    why,
                } = marked(&scene);
                if !is_stated {
                    return Err(GaussianFileError::RuleUnknown {
                        path: path.to_owned(),
                        likely: rule,
                        why,
                    });
                }
                let note = format!(
                    "rendered with the rule {rule} ({why}); to use another rule, set rendering=RULE"
                );
                Ok((scene, rule, Some(note)))
            }
            // Report the error of reading the file as requested.
            Err(error) => Err(linear.err().unwrap_or(error)),
        },
    }
}

fn read_arrays_as(
    path: &Path,
    reading: StoredForm,
    rule: Option<Rule>,
) -> Result<GaussianFile, GaussianFileError> {
    let file = Checkpoint::open(path)?;
    let mut format = reading.of_arrays();
    let (mut gaussians, rule) = if file.shape("sh").is_ok() {
        let rule = rule.ok_or_else(|| GaussianFileError::RuleUnknown {
            path: path.to_owned(),
            likely: Rule::GSPLAT_CLASSIC,
            why: "arrays with sh",
        })?;
        let (constant, harmonics) = read_sh(&file)?;
        if rule.blending == ColorSpace::Linear && harmonics.degree > 0 {
            return Err(GaussianFileError::ViewDependent {
                path: path.to_owned(),
                coefficients: 3 * harmonics.per_gaussian(),
            });
        }
        format.color_space = Some(ColorSpace::Srgb);
        format.colors = Some(StoredColors::Dc);
        let mut gaussians = with_colors(&file, constant)?;
        gaussians.harmonics = harmonics;
        (gaussians, rule)
    } else {
        let gaussians = with_colors(&file, rows(&file, "colors_linear")?)?;
        (gaussians, rule.unwrap_or_default())
    };
    format.blending = rule.blending;
    let lengths = |source| GaussianFileError::Lengths {
        path: path.to_owned(),
        source,
    };
    gaussians.check_lengths().map_err(lengths)?;
    let stored = |source| GaussianFileError::Stored {
        path: path.to_owned(),
        source,
    };
    let mut doubts = ply::suspicions(&gaussians, &reading, &format);
    doubts.extend(undrawn(&gaussians, &rule));
    ply::check_stored(&gaussians, &format).map_err(stored)?;
    format.decode(&mut gaussians);
    if let Some(value) = ply::enormous_scale(&gaussians) {
        return Err(stored(PlyReason::Impossible {
            what: "a standard deviation",
            value,
            advice: "that is wider than any scene; `scales=log` reads logarithms",
        }));
    }
    Ok(GaussianFile {
        gaussians,
        camera: None,
        rule,
        rule_note: None,
        reading: format,
        doubts,
    })
}

/// Reads a scene in any format other than arrays. Fails if view-dependent colours cannot be
/// blended.
fn read_scene(path: &Path, reading: StoredForm) -> Result<GaussianScene, GaussianFileError> {
    let scene = sharp::gaussian_files::load(path, reading)?;
    let is_lost = scene.is_view_dependent && reading.blending == ColorSpace::Linear;
    if is_lost && reading.harmonics != Some(ply::Harmonics::Drop) {
        return Err(GaussianFileError::ViewDependent {
            path: path.to_owned(),
            coefficients: scene.color_coefficients,
        });
    }
    Ok(scene)
}

/// Extensions of Gaussian files, in search order.
pub const EXTENSIONS: [&str; 6] = [
    "ply",
    "safetensors",
    "compressed.ply",
    "spz",
    "sog",
    "splat",
];

/// Whether a folder is an unpacked SOG.
pub fn is_sog_folder(path: &Path) -> bool {
    path.join("meta.json").is_file()
}

/// An f32 array of a safetensors file; stored little-endian on every machine.
pub(crate) struct Array {
    pub(crate) name: &'static str,
    pub(crate) shape: Vec<usize>,
    pub(crate) bytes: Vec<u8>,
}

impl Array {
    pub(crate) fn new(name: &'static str, shape: &[usize], values: &[f32]) -> Self {
        Self {
            name,
            shape: shape.to_vec(),
            bytes: values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }
}

pub(crate) fn write_arrays(
    path: &Path,
    arrays: &[Array],
    metadata: Option<HashMap<String, String>>,
) -> Result<(), FileError> {
    let encode = || -> Result<Vec<u8>, SafeTensorError> {
        let mut views = Vec::new();
        for Array { name, shape, bytes } in arrays {
            views.push((*name, TensorView::new(Dtype::F32, shape.clone(), bytes)?));
        }
        safetensors::serialize(views, metadata)
    };
    let bytes = encode().map_err(|e| FileError::new(path, "encode")(io::Error::other(e)))?;
    write_atomic(path, &bytes)
}

pub fn read_arrays(path: &Path) -> Result<Gaussians, GaussianFileError> {
    let file = Checkpoint::open(path)?;
    with_colors(&file, rows(&file, "colors_linear")?)
}

fn with_colors(file: &Checkpoint, colors: Vec<[f32; 3]>) -> Result<Gaussians, GaussianFileError> {
    let opacities = rows::<1>(file, "opacities")?;
    Gaussians::new(
        rows(file, "means")?,
        rows(file, "quats_wxyz")?,
        rows(file, "scales")?,
        opacities.into_iter().map(|[v]| v).collect(),
        colors,
    )
    .map_err(|source| GaussianFileError::Lengths {
        path: file.path().to_owned(),
        source,
    })
}

/// Reads `sh` of a file: the constant coefficients, and the remaining coefficients as harmonics.
fn read_sh(file: &Checkpoint) -> Result<(Vec<[f32; 3]>, Harmonics), GaussianFileError> {
    let shape = file.shape("sh")?.to_vec();
    let each = match shape[..] {
        [_, each @ (1 | 4 | 9 | 16 | 25), 3] => each,
        _ => {
            return Err(GaussianFileError::Harmonics {
                path: file.path().to_owned(),
                shape,
            });
        }
    };
    let values = file.tensor_f32("sh")?;
    let coefficients = values.as_chunks::<3>().0.chunks_exact(each);
    Ok((
        coefficients.clone().map(|of_one| of_one[0]).collect(),
        Harmonics {
            degree: each.isqrt() - 1,
            coefficients: coefficients
                .flat_map(|of_one| of_one[1..].to_vec())
                .collect(),
        },
    ))
}

/// A tensor of shape [N, K], or [N] for K = 1.
fn rows<const K: usize>(
    file: &Checkpoint,
    name: &'static str,
) -> Result<Vec<[f32; K]>, GaussianFileError> {
    let shape = file.shape(name)?;
    if !(matches!(shape, [_, k] if *k == K) || (K == 1 && shape.len() == 1)) {
        return Err(GaussianFileError::Shape {
            path: file.path().to_owned(),
            name,
            shape: shape.to_vec(),
            columns: K,
        });
    }
    let values = file.tensor_f32(name)?;
    Ok(values.as_chunks::<K>().0.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A PLY with one Gaussian, `comments` and the additional `properties`, all 0.25.
    fn ply(comments: &[&str], properties: &[&str]) -> String {
        let mut text = "ply\nformat ascii 1.0\n".to_owned();
        for comment in comments {
            text += &format!("comment {comment}\n");
        }
        text += "element vertex 1\n";
        let own = [
            "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1",
            "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
        ];
        for name in own.iter().chain(properties) {
            text += &format!("property float {name}\n");
        }
        let more = " 0.25".repeat(properties.len());
        text + "end_header\n0 0 2 0.1 0.2 0.3 1 -3 -3 -3 1 0 0 0" + &more + "\n"
    }

    fn read_text(text: &str, settings: &[(&str, &str)]) -> Result<GaussianFile, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("scene.ply");
        std::fs::write(&path, text).unwrap();
        let (mut reading, mut rule) = (StoredForm::default(), None);
        for (key, value) in settings {
            match *key {
                "rendering" => rule = Some(value.parse().unwrap()),
                _ => assert!(reading.set(key, value).unwrap()),
            }
        }
        read(&path, reading, rule).map_err(|error| error.to_string())
    }

    const NORMALS: [&str; 3] = ["nx", "ny", "nz"];

    fn harmonics() -> Vec<String> {
        (0..9).map(|k| format!("f_rest_{k}")).collect()
    }

    #[test]
    fn a_file_that_says_how_it_is_drawn_is_drawn_so() {
        let cases = [
            (vec!["Exported from Brush"], vec![], "gsplat-1.5.3-classic"),
            (
                vec!["Exported from Brush", "SplatRenderMode: mip"],
                vec![],
                "brush-mip",
            ),
            (vec!["SplatRenderMode: mip"], vec![], "gsplat-antialiased"),
            (vec!["antialiased 0"], vec![], "gsplat-classic"),
            (vec![], vec!["filter_3D"], "mip-splatting"),
        ];
        for (comments, properties, rule) in cases {
            let file = read_text(&ply(&comments, &properties), &[]).unwrap();
            assert_eq!(file.rule.to_string(), rule);
            assert!(file.rule_note.unwrap().contains(rule));
            assert_eq!(file.reading.blending, ColorSpace::Srgb);
        }
    }

    #[test]
    fn one_that_does_not_is_refused_with_the_likely_rule() {
        let rest = harmonics();
        let rest: Vec<&str> = rest.iter().map(String::as_str).collect();
        for (comments, properties, likely) in [
            (vec![], NORMALS.to_vec(), "inria-general"),
            (vec![], vec![], "gsplat-classic"),
            (vec![], rest.clone(), "gsplat-classic"),
            (
                vec!["Generated by Nerstudio 1.1.5"],
                rest.clone(),
                "gsplat-classic",
            ),
        ] {
            let text = ply(&comments, &properties);
            let error = read_text(&text, &[]).unwrap_err();
            assert!(error.contains("rendering=RULE"), "{error}");
            assert!(error.contains(&format!("probably {likely}")), "{error}");
            let named = read_text(&text, &[("rendering", likely)]).unwrap();
            assert_eq!(named.rule.to_string(), likely);
            assert_eq!(named.rule_note, None);
            let degree = usize::from(properties == rest);
            assert_eq!(named.gaussians.harmonics.degree, degree);
        }
    }

    /// Encoded values are ½ + 0.28209479 · f_dc; decode them for linear light.
    #[test]
    fn an_encoding_alone_keeps_linear_light_and_says_so() {
        let text = ply(&[], &NORMALS);
        let linear = read_text(&text, &[("color_space", "srgb")]).unwrap();
        assert_eq!(linear.rule, Rule::SHARP);
        assert!(linear.rule_note.unwrap().contains("probably inria-general"));
        let encoded = read_text(&text, &[("rendering", "inria")]).unwrap();
        let own = 0.5 + 0.282_094_8 * 0.1;
        assert!((encoded.gaussians.colors[0][0] - own).abs() < 1e-6);
        let decoded = sharp::color::linear_from_srgb(own);
        assert!((linear.gaussians.colors[0][0] - decoded).abs() < 1e-6);
        let ignored = read_text(
            &ply(&["SplatRenderMode: mip"], &[]),
            &[("color_space", "srgb"), ("marks", "ignore")],
        );
        assert_eq!(ignored.unwrap().rule, Rule::SHARP);
    }
}
