//! Scenes of Gaussians from files: PLY, or safetensors arrays.

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};

use glam::DAffine3;
use safetensors::SafeTensorError;
use safetensors::tensor::{Dtype, TensorView};
use sharp::camera::{CameraError, Intrinsics, affine_from_row_major};
use sharp::color::{linear_from_srgb, srgb_from_linear};
use sharp::gaussians::{Gaussians, Harmonics, LengthMismatch};
use sharp::ply::{self, ColorSpace, PlyError, PlyReason, StoredColors, StoredForm, Suspicion};
use sharp_checkpoint::{Checkpoint, CheckpointError};

use super::atomic_files::{FileError, write_atomic};

/// Gaussians and, where the file stores one, the camera to look from.
#[derive(Debug, Clone)]
pub struct GaussianFile {
    /// In the space of the file's producer.
    pub gaussians: Gaussians,
    pub camera: Option<(Intrinsics, DAffine3)>,
    /// How its numbers were read.
    pub reading: StoredForm,
    /// What contradicts that reading.
    pub doubts: Vec<Suspicion>,
}

/// Why a scene could not be read; names the file.
#[derive(Debug, thiserror::Error)]
pub enum GaussianFileError {
    #[error(transparent)]
    Ply(#[from] PlyError),
    #[error(transparent)]
    Arrays(#[from] CheckpointError),
    #[error("{}: {name} has shape {shape:?}, [N, {columns}] is needed", path.display())]
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
    #[error("{}: {}", path.display(), match foreign {
        Some(foreign) => format!("not a .ply or .safetensors file but {foreign}"),
        None => "a scene is a .ply or .safetensors file".to_owned(),
    })]
    Extension {
        path: PathBuf,
        /// Its format, and what converts it.
        foreign: Option<String>,
    },
    /// Values that a scene cannot have.
    #[error("{}: {source}", path.display())]
    Stored { path: PathBuf, source: PlyReason },
    /// Only Gaussians of one colour from all sides are rendered.
    #[error(
        "{}: colours depend on the view ({coefficients} coefficients f_rest_*), which is not rendered; \
         `harmonics=drop` draws the constant term alone, or bake them into it for the source's view", path.display()
    )]
    ViewDependent { path: PathBuf, coefficients: usize },
    #[error(
        "{}: `sh` of degree {degree} belongs to encoded colours, which is not rendered in linear light: name the rule it \
         is for, such as --rendering inria or gsplat-classic", path.display()
    )]
    EncodedHarmonics { path: PathBuf, degree: usize },
    #[error("{}: sh has shape {shape:?}, [N, (degree + 1)², 3] with a degree up to 4 is needed", path.display())]
    Harmonics { path: PathBuf, shape: Vec<usize> },
}

/// Reads `.ply` (with or without the release's extra elements) or `.safetensors` (`means` [N, 3], `quats_wxyz` [N, 4],
/// `scales` `[N, 3]`, `opacities` `[N]`, `colors_linear` `[N, 3]`), whatever the case of the extension. `reading` is how
/// numbers are read that are stored otherwise, and how a PLY's colours are encoded where it does not say.
pub fn read(
    path: &Path,
    reading: impl Into<StoredForm>,
) -> Result<GaussianFile, GaussianFileError> {
    read_blended(path, reading, ColorSpace::Linear)
}

/// As [`read`], with colours in the space in which they are blended. Encoded ones may depend on the view: `sh`
/// [N, (degree + 1)², 3] takes the place of `colors_linear` in arrays.
pub fn read_blended(
    path: &Path,
    reading: impl Into<StoredForm>,
    blending: ColorSpace,
) -> Result<GaussianFile, GaussianFileError> {
    let reading = reading.into();
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    match extension.to_ascii_lowercase().as_str() {
        "ply" => {
            let scene = ply::load(path, reading)?;
            if scene.is_view_dependent && reading.harmonics != Some(ply::Harmonics::Drop) {
                return Err(GaussianFileError::ViewDependent {
                    path: path.to_owned(),
                    coefficients: scene.color_coefficients,
                });
            }
            let camera_from_world = match scene.extrinsics {
                None => DAffine3::IDENTITY,
                Some(m) => affine_from_row_major(&m.map(f64::from)).map_err(|source| {
                    GaussianFileError::Camera {
                        path: path.to_owned(),
                        source,
                    }
                })?,
            };
            let mut gaussians = scene.gaussians;
            convert(&mut gaussians, ColorSpace::Linear, blending);
            Ok(GaussianFile {
                camera: scene.intrinsics.map(|k| (k, camera_from_world)),
                gaussians,
                reading: scene.reading,
                doubts: scene.doubts,
            })
        }
        "safetensors" => {
            let file = Checkpoint::open(path)?;
            let sh = file
                .shape("sh")
                .is_ok()
                .then(|| read_sh(&file))
                .transpose()?;
            let mut space = ColorSpace::Linear;
            let mut format = reading.of_arrays();
            let mut gaussians = match sh {
                None => with_colors(&file, rows(&file, "colors_linear")?)?,
                Some((constant, harmonics)) => {
                    if blending == ColorSpace::Linear && harmonics.degree > 0 {
                        return Err(GaussianFileError::EncodedHarmonics {
                            path: path.to_owned(),
                            degree: harmonics.degree,
                        });
                    }
                    space = ColorSpace::Srgb;
                    // Encoded values as they are.
                    format.color_space = Some(ColorSpace::Linear);
                    format.colors = Some(StoredColors::Dc);
                    let mut gaussians = with_colors(&file, constant)?;
                    gaussians.harmonics = harmonics;
                    gaussians
                }
            };
            let lengths = |source| GaussianFileError::Lengths {
                path: path.to_owned(),
                source,
            };
            gaussians.check_lengths().map_err(lengths)?;
            let stored = |source| GaussianFileError::Stored {
                path: path.to_owned(),
                source,
            };
            let doubts = ply::suspicions(&gaussians, &reading, &format);
            ply::check_stored(&gaussians, &format).map_err(stored)?;
            format.decode(&mut gaussians);
            if let Some(value) = ply::enormous_scale(&gaussians) {
                return Err(stored(PlyReason::Impossible {
                    what: "a standard deviation",
                    value,
                    advice: "that is wider than any scene; `scales=log` reads logarithms",
                }));
            }
            convert(&mut gaussians, space, blending);
            Ok(GaussianFile {
                gaussians,
                camera: None,
                reading: format,
                doubts,
            })
        }
        _ => Err(GaussianFileError::Extension {
            foreign: foreign(path),
            path: path.to_owned(),
        }),
    }
}

/// Converts colours that do not depend on the view.
fn convert(gaussians: &mut Gaussians, from: ColorSpace, to: ColorSpace) {
    let convert = match (from, to) {
        (ColorSpace::Linear, ColorSpace::Srgb) => srgb_from_linear,
        (ColorSpace::Srgb, ColorSpace::Linear) => linear_from_srgb,
        _ => return,
    };
    for color in &mut gaussians.colors {
        *color = color.map(convert);
    }
}

/// Names a format of Gaussians that is not read, with what converts it.
pub fn foreign(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_string_lossy();
    if path.join("meta.json").is_file() {
        return ply::foreign_format(&[], "meta.json");
    }
    let mut start = [0; 4];
    let mut file = std::fs::File::open(path).ok()?;
    let read = io::Read::read(&mut file, &mut start).ok()?;
    ply::foreign_format(&start[..read], &name)
}

/// An f32 array of a safetensors file, little endian on every machine.
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
    let colors = rows(&file, "colors_linear")?;
    with_colors(&file, colors)
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

/// The constant coefficients of `sh`, and the others.
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
