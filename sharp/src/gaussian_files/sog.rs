//! PlayCanvas' SOG: lossless WebP pictures whose pixels hold the attributes, and a `meta.json` that
//! describes them.

use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::path::Path;

use image::codecs::webp::WebPDecoder;
use image::{DynamicImage, ImageDecoder};
use serde_json::Value;

use super::MAX_EXPANSION;
use crate::ply::{
    Decoded, FileMarks, Generator, PlyReason, SplatRenderMode, StoredColors, StoredForm,
    StoredOpacity, StoredScales, completed, degree_of,
};

/// Number of palette entries of view-dependent colour per row of the palette's picture.
const PALETTE_COLUMNS: usize = 64;

fn damaged(what: impl Into<String>) -> PlyReason {
    PlyReason::Damaged {
        format: "SOG",
        what: what.into(),
    }
}

/// Reads the files that the `meta.json` of a folder lists.
pub(super) fn from_folder(folder: &Path) -> Result<Decoded, PlyReason> {
    read(|name| crate::files::read(&folder.join(name)).map_err(|error| error.to_string()))
}

/// Reads a SOG from the bytes of a zip archive.
pub(super) fn from_archive(bytes: &[u8]) -> Result<Decoded, PlyReason> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes))
        .map_err(|_| damaged("its zip archive has no list of files at its end: truncated?"))?;
    if archive.index_for_name("meta.json").is_none() {
        let what = "a zip archive without meta.json, so not a SOG; unpack it (unzip)";
        return Err(PlyReason::Foreign(what.to_owned()));
    }
    let limit = bytes.len().saturating_mul(MAX_EXPANSION) as u64;
    read(|name| {
        let file = archive.by_name(name).map_err(|error| match error {
            zip::result::ZipError::FileNotFound => "it is not in the archive",
            _ => "its bytes in the archive are damaged",
        })?;
        let mut content = Vec::new();
        let read = file.take(limit).read_to_end(&mut content);
        read.map_err(|error| super::unfolding(&error))?;
        Ok(content)
    })
}

fn read(mut file: impl FnMut(&str) -> Result<Vec<u8>, String>) -> Result<Decoded, PlyReason> {
    let mut file = |name: &str| file(name).map_err(|error| damaged(format!("{name}: {error}")));
    let meta = file("meta.json")?;
    let meta: Value = serde_json::from_slice(&meta).map_err(|error| {
        let (line, column) = (error.line(), error.column());
        damaged(format!(
            "meta.json: not valid JSON from line {line}, column {column}"
        ))
    })?;
    let names = ["means", "scales", "quats", "sh0", "shN"];
    let mut files = BTreeMap::new();
    for attribute in names.into_iter().filter(|name| meta.get(name).is_some()) {
        let listed = meta[attribute]["files"].as_array();
        for name in listed.into_iter().flatten().filter_map(Value::as_str) {
            // Only files directly in the folder are read.
            if name.contains(['/', '\\']) || name == ".." {
                return Err(damaged(format!("meta.json names the file {name:?}")));
            }
            files.insert(name.to_owned(), file(name)?);
        }
    }
    Sog { meta, files }.decode()
}

struct Sog {
    meta: Value,
    files: BTreeMap<String, Vec<u8>>,
}

impl Sog {
    fn decode(&self) -> Result<Decoded, PlyReason> {
        let meta = &self.meta;
        let is_first = match meta.get("version").map(Value::as_u64) {
            None => true,
            Some(Some(2)) => false,
            Some(_) => {
                let what = format!(
                    "version {} is not supported; only versions 1 and 2 are",
                    meta["version"]
                );
                return Err(damaged(what));
            }
        };
        let count = if is_first {
            &meta["means"]["shape"][0]
        } else {
            &meta["count"]
        };
        let count = count.as_u64().and_then(|count| usize::try_from(count).ok());
        let count =
            count.ok_or_else(|| damaged("meta.json does not state the number of Gaussians"))?;
        let of = |attribute: &'static str, file: usize| self.pixels(attribute, file, count);
        let [low, high, scales, turns, colors] = [
            of("means", 0)?,
            of("means", 1)?,
            of("scales", 0)?,
            of("quats", 0)?,
            of("sh0", 0)?,
        ];
        let means = Range::of(&meta["means"]).ok_or_else(|| missing("means"))?;
        let scale = Levels::of(&meta["scales"], is_first).ok_or_else(|| missing("scales"))?;
        let color = Levels::of(&meta["sh0"], is_first).ok_or_else(|| missing("sh0"))?;
        let opacity = if is_first {
            StoredOpacity::Logit
        } else {
            StoredOpacity::Byte
        };
        let mut out = Decoded {
            form: StoredForm {
                opacity: Some(opacity),
                scales: Some(StoredScales::Log),
                colors: Some(StoredColors::Dc),
                ..StoredForm::default()
            },
            marks: self.marks(),
            ..Decoded::default()
        };
        let stored = &mut out.stored;
        for k in 0..count {
            stored.means.push([0, 1, 2].map(|axis| {
                let word = u16::from_le_bytes([low.at(k)[axis], high.at(k)[axis]]);
                let log = means.at(axis, f64::from(word) / 65535.0);
                (log.abs().exp_m1().copysign(log)) as f32
            }));
            stored
                .scales
                .push([0, 1, 2].map(|axis| scale.at(axis, scales.at(k)[axis])));
            stored
                .colors
                .push([0, 1, 2].map(|axis| color.at(axis, colors.at(k)[axis])));
            let alpha = colors.at(k)[3];
            stored.opacities.push(if is_first {
                color.at(3, alpha)
            } else {
                alpha.into()
            });
            stored.quaternions.push(rotation_of(turns.at(k)));
        }
        if meta.get("shN").is_some() {
            self.harmonics(count, is_first, &mut out)?;
        }
        Ok(out)
    }

    /// Reads view-dependent colours, which are stored as one palette index per Gaussian.
    fn harmonics(&self, count: usize, is_first: bool, out: &mut Decoded) -> Result<(), PlyReason> {
        let levels = Levels::of(&self.meta["shN"], is_first).ok_or_else(|| missing("shN"))?;
        let palette = self.pixels("shN", 0, 0)?;
        let labels = self.pixels("shN", 1, count)?;
        let each = palette.width / PALETTE_COLUMNS;
        let degree = degree_of(3 * each).filter(|degree| (1..=3).contains(degree));
        let is_whole = palette.width == PALETTE_COLUMNS * each;
        let degree = degree.filter(|_| is_whole).ok_or_else(|| {
            damaged(format!(
                "its palette of view-dependent colours has an unsupported width of {} pixels",
                palette.width
            ))
        })?;
        out.color_coefficients = 3 * each;
        let harmonics = &mut out.stored.harmonics;
        harmonics.degree = degree;
        for k in 0..count {
            let [low, high, ..] = labels.at(k);
            let entry = usize::from(u16::from_le_bytes([low, high]));
            let first = entry / PALETTE_COLUMNS * palette.width + entry % PALETTE_COLUMNS * each;
            let pixels = palette.pixels.get(first..first + each);
            let pixels = pixels.ok_or_else(|| {
                damaged(format!(
                    "Gaussian {k} refers to entry {entry}, beyond the end of the palette"
                ))
            })?;
            let value = |pixel: &[u8; 4]| [0, 1, 2].map(|channel| levels.at(0, pixel[channel]));
            harmonics.coefficients.extend(pixels.iter().map(value));
        }
        let mut values = harmonics.coefficients.iter().flatten();
        out.is_view_dependent = values.any(|v| *v != 0.0);
        Ok(())
    }

    fn marks(&self) -> FileMarks {
        let generator = self.meta["asset"]["generator"].as_str().unwrap_or_default();
        let mut marks = FileMarks {
            generator: generator
                .starts_with("splat-transform")
                .then_some(Generator::SplatTransform),
            ..FileMarks::default()
        };
        match self.meta["model"].as_str() {
            Some("antialiased") => marks.antialiased = Some(true),
            Some("2dgs") => marks.set_mode(SplatRenderMode::Flat),
            // The program spark writes this entry.
            _ if self.meta["antialias"] == true => marks.antialiased = Some(true),
            _ => {}
        }
        marks
    }

    /// Decodes one of an attribute's files, which must have at least `count` pixels.
    fn pixels(
        &self,
        attribute: &'static str,
        file: usize,
        count: usize,
    ) -> Result<Pixels, PlyReason> {
        let name = self.meta[attribute]["files"][file].as_str();
        let name = name.ok_or_else(|| missing(attribute))?;
        let bytes = self.files.get(name).map(Vec::as_slice).unwrap_or_default();
        let picture = |error: String| damaged(format!("{name}: {error}"));
        let broken = |_| picture("not a complete WebP picture (truncated or damaged?)".to_owned());
        let decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(broken)?;
        let (width, height) = decoder.dimensions();
        let area = (width as usize).saturating_mul(height as usize);
        // A picture of a single colour takes hardly any bytes, so the limit is based on the size of
        // all files together.
        let held: usize = self.files.values().map(Vec::len).sum();
        if area / MAX_EXPANSION > held {
            return Err(picture(format!(
                "{width}×{height} pixels, which {held} bytes cannot hold"
            )));
        }
        if area < count {
            let what = format!("{width}×{height} pixels for {count} Gaussians");
            return Err(picture(what));
        }
        let image = DynamicImage::from_decoder(decoder).map_err(broken)?;
        Ok(Pixels {
            width: width as usize,
            pixels: image.into_rgba8().as_chunks::<4>().0.to_vec(),
        })
    }
}

fn missing(attribute: &str) -> PlyReason {
    damaged(format!("meta.json: `{attribute}` is missing or incomplete"))
}

struct Pixels {
    width: usize,
    /// Pixels row by row.
    pixels: Vec<[u8; 4]>,
}

impl Pixels {
    fn at(&self, k: usize) -> [u8; 4] {
        self.pixels[k]
    }
}

/// Minimum and maximum along each axis; a single number applies to all axes.
struct Range {
    least: Vec<f64>,
    most: Vec<f64>,
}

impl Range {
    fn of(attribute: &Value) -> Option<Self> {
        let numbers = |value: &Value| match value {
            Value::Array(all) => all.iter().map(Value::as_f64).collect(),
            value => Some(vec![value.as_f64()?; 4]),
        };
        let range = Self {
            least: numbers(&attribute["mins"])?,
            most: numbers(&attribute["maxs"])?,
        };
        (range.least.len() >= 3 && range.most.len() >= range.least.len()).then_some(range)
    }

    fn at(&self, axis: usize, share: f64) -> f64 {
        // A missing axis has zero width.
        let least = self.least.get(axis).copied().unwrap_or_default();
        let most = self.most.get(axis).copied().unwrap_or_default();
        least + (most - least) * share
    }
}

/// Conversion of an attribute's bytes to numbers.
enum Levels {
    /// Version 1: linear within a range.
    Range(Range),
    /// Version 2: a table with the value of each byte.
    Codebook(Box<[f32; 256]>),
}

impl Levels {
    fn of(attribute: &Value, is_first: bool) -> Option<Self> {
        if is_first {
            return Some(Self::Range(Range::of(attribute)?));
        }
        let numbers = attribute["codebook"].as_array()?.iter();
        let numbers: Option<Vec<f32>> = numbers.map(|v| Some(v.as_f64()? as f32)).collect();
        Some(Self::Codebook(numbers?.try_into().ok()?))
    }

    fn at(&self, axis: usize, byte: u8) -> f32 {
        match self {
            Self::Range(range) => range.at(axis, f64::from(byte) / 255.0) as f32,
            Self::Codebook(values) => values[usize::from(byte)],
        }
    }
}

/// Decodes a quaternion w, x, y, z. `last` identifies its largest component, which is positive; the other bytes are the
/// remaining components in order. An undefined `last` gives the identity.
fn rotation_of([a, b, c, last]: [u8; 4]) -> [f32; 4] {
    let Some(largest) = last.checked_sub(252).map(usize::from) else {
        return [1.0, 0.0, 0.0, 0.0];
    };
    let mut quaternion = [0.0; 4];
    let places = (0..4).filter(|place| *place != largest);
    for (place, byte) in places.zip([a, b, c]) {
        quaternion[place] = (f64::from(byte) / 255.0 * 2.0 - 1.0) * std::f64::consts::FRAC_1_SQRT_2;
    }
    completed(quaternion, largest)
}
