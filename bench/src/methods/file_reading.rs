//! Settings for reading a Gaussian file: how its numbers are stored, and how its coordinates relate to the source's
//! camera.

use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};
use sharp::camera::{Intrinsics, target_camera_from_source_ndc};
use sharp::ply::StoredForm;
use sharp::render::Rule;

use super::placement_file;
use crate::pairs::PosedCamera;

/// Coordinate space of a file's means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileSpace {
    /// The source camera's space.
    Camera,
    /// The target camera's space; each pair has its own file.
    Target,
    /// The dataset's world space.
    World,
    /// SHARP's normalised space of the source.
    Normalized,
}

/// Directions of a file's x, y and z axes: for each axis, `r` or `l`, `u` or `d`, `f` or `b` (right, left, up, down,
/// forward, backward). OpenCV's axes are `rdf`, OpenGL's `rub`. In world space, directions are relative to the
/// dataset's axes, which count as `rdf`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Axes([u8; 3]);

impl Axes {
    pub const OPENCV: Self = Self(*b"rdf");

    /// Parses `opencv`, `opengl` or three letters.
    pub fn parse(text: &str) -> Option<Self> {
        let letters = match text {
            "opencv" => *b"rdf",
            "opengl" => *b"rub",
            _ => <[u8; 3]>::try_from(text.as_bytes()).ok()?,
        };
        let axis = |letter: u8| match letter {
            b'r' | b'l' => Some(0),
            b'd' | b'u' => Some(1),
            b'f' | b'b' => Some(2),
            _ => None,
        };
        let [x, y, z] = letters.map(axis);
        let is_frame = x.is_some() && y.is_some() && z.is_some() && x != y && y != z && x != z;
        is_frame.then_some(Self(letters))
    }

    /// Matrix from these axes to OpenCV's; its determinant is −1 if the axes are left-handed.
    fn matrix(self) -> DMat3 {
        let direction = |letter: u8| match letter {
            b'l' => DVec3::NEG_X,
            b'd' => DVec3::Y,
            b'u' => DVec3::NEG_Y,
            b'f' => DVec3::Z,
            b'b' => DVec3::NEG_Z,
            _ => DVec3::X,
        };
        let [x, y, z] = self.0.map(direction);
        DMat3::from_cols(x, y, z)
    }

    /// Parses axes that are flips of OpenCV's axes and returns the signs of x, y and z. The error
    /// lists the accepted values.
    pub fn parse_flip(text: &str) -> Result<[f32; 3], String> {
        let matrix = Self::parse(text).map_or(DMat3::ZERO, Self::matrix);
        let signs = [matrix.x_axis.x, matrix.y_axis.y, matrix.z_axis.z];
        if signs.iter().product::<f64>() == 1.0 {
            Ok(signs.map(|sign| sign as f32))
        } else {
            Err(format!("axes={text}: expected rdf, rub, luf or ldb"))
        }
    }

    /// All 48 possible systems of axes.
    pub fn every() -> impl Iterator<Item = Self> {
        let letters = || *b"rldufb";
        let all = letters()
            .into_iter()
            .flat_map(move |x| letters().map(|y| (x, y)));
        let all = all.flat_map(move |(x, y)| letters().map(|z| [x, y, z]));
        all.filter_map(|axes| Self::parse(str::from_utf8(&axes).unwrap_or_default()))
    }

    fn name(self) -> String {
        match self {
            Self::OPENCV => "opencv".to_owned(),
            Self(letters) => String::from_utf8_lossy(&letters).into_owned(),
        }
    }
}

/// Where the Gaussians of a file are: their coordinate space, and the map from the file's numbers to this space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    pub space: FileSpace,
    pub axes: Axes,
    /// Unit of the file in metres.
    pub scale: f64,
    /// Additional map to `space`, applied after the axes have been converted to OpenCV's and the unit to metres.
    pub transform: Option<DAffine3>,
    /// Shift (right, down) of the whole scene as seen by the source's camera, in pixels.
    pub shift: [f64; 2],
    /// Horizontal and vertical focal length used to unproject the file's points, as multiples of the source's.
    pub focal: [f64; 2],
}

impl Default for Placement {
    fn default() -> Self {
        Self {
            space: FileSpace::Camera,
            axes: Axes::OPENCV,
            scale: 1.0,
            transform: None,
            shift: [0.0; 2],
            focal: [1.0; 2],
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FileReading {
    pub stored: StoredForm,
    pub placement: Placement,
    /// Rendering rule; `None` for the rule that the file states, or SHARP's if it states none.
    pub rule: Option<Rule>,
}

impl Placement {
    /// Values in the order of [`FileReading::PLACEMENT_KEYS`].
    fn values(&self) -> [String; 6] {
        let space = match self.space {
            FileSpace::Camera => "camera",
            FileSpace::Target => "target",
            FileSpace::World => "world",
            FileSpace::Normalized => "normalized",
        };
        let [x, y] = self.shift;
        let [across, down] = self.focal;
        [
            space.to_owned(),
            self.axes.name(),
            self.scale.to_string(),
            // Print the matrix (by columns) instead of the file's name, because the file may change or disappear.
            self.transform.map_or_else(
                || "none".to_owned(),
                |map| map.to_cols_array().map(|v| v.to_string()).join(":"),
            ),
            format!("{x}:{y}"),
            if across == down {
                across.to_string()
            } else {
                format!("{across}:{down}")
            },
        ]
    }

    /// Map from the file's coordinates to the camera space of `source`, in metres. For [`FileSpace::Target`], pass the
    /// target's camera as `source`.
    pub fn camera_from_file(&self, source: &PosedCamera) -> DAffine3 {
        let Intrinsics { fx, fy, .. } = source.intrinsics;
        let own = DAffine3::from_mat3(self.axes.matrix() * self.scale);
        let camera_from_space = match self.space {
            FileSpace::Camera | FileSpace::Target => DAffine3::IDENTITY,
            FileSpace::World => source.camera_from_world.to_affine(),
            FileSpace::Normalized => {
                target_camera_from_source_ndc(&source.intrinsics, &source.to(source))
            }
        };
        let [x, y] = self.shift;
        // A pixel corresponds to a direction, so shifting a point by pixels moves it in proportion to its depth.
        let shifted = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(x / fx, y / fy, 1.0));
        let widened = DMat3::from_diagonal(DVec3::new(self.focal[0], self.focal[1], 1.0));
        let space_from_file = self.transform.unwrap_or(DAffine3::IDENTITY) * own;
        DAffine3::from_mat3(shifted * widened) * camera_from_space * space_from_file
    }
}

/// Parses `none`, twelve numbers (a 3×4 matrix, column by column), or the path of a file that contains a matrix.
fn transform(text: &str) -> Result<Option<DAffine3>, String> {
    match twelve(text) {
        None if text == "none" => Ok(None),
        None => placement_file::read(Path::new(text)).map(Some),
        Some(map) => placement_file::check(&map).map(|()| Some(map)),
    }
}

fn twelve(text: &str) -> Option<DAffine3> {
    let numbers: Option<Vec<f64>> = text.split(':').map(|number| number.parse().ok()).collect();
    Some(DAffine3::from_cols_array(&numbers?.try_into().ok()?))
}

/// Whether `transform=` names a file.
pub fn is_transform_file(text: &str) -> bool {
    text != "none" && twelve(text).is_none() && !text.contains('{')
}

impl FileReading {
    pub(super) const PLACEMENT_KEYS: [&'static str; 6] =
        ["space", "axes", "scale", "transform", "shift", "focal"];

    pub(super) const RULE_KEY: &'static str = "rendering";

    /// The settings for arrays in memory, whose values are decoded and in the source camera's space.
    pub fn of_arrays() -> Self {
        Self {
            stored: StoredForm::default().of_arrays(),
            ..Self::default()
        }
    }

    pub fn keys() -> impl Iterator<Item = &'static str> {
        let keys = StoredForm::KEYS.into_iter().chain(Self::PLACEMENT_KEYS);
        keys.chain([Self::RULE_KEY])
    }

    /// Sets one of [`Self::keys`]; ignores other keys. The error lists the allowed values.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), String> {
        let needed = |what: &str| format!("{key}={value}: expected {what}");
        let number = |text: &str| text.parse::<f64>().ok().filter(|v| v.is_finite());
        let both = |value: &str| {
            let (x, y) = value.split_once([',', ':'])?;
            Some([number(x.trim())?, number(y.trim())?])
        };
        let placement = &mut self.placement;
        match key {
            "space" => {
                placement.space = match value {
                    "camera" | "source" => FileSpace::Camera,
                    "target" => FileSpace::Target,
                    "world" => FileSpace::World,
                    "normalized" => FileSpace::Normalized,
                    _ => return Err(needed("source, target, world or normalized")),
                }
            }
            "axes" => {
                let axes = Axes::parse(value);
                placement.axes = axes.ok_or_else(|| {
                    needed("opencv, opengl or the directions of x, y and z such as rdf or luf")
                })?;
            }
            "scale" => {
                let factor = number(value).filter(|v| *v > 0.0);
                placement.scale = factor.ok_or_else(|| needed("a positive number"))?;
            }
            "focal" => {
                let factors = both(value).or(number(value).map(|factor| [factor; 2]));
                let factors = factors.filter(|both| both.iter().all(|v| *v > 0.0));
                placement.focal =
                    factors.ok_or_else(|| needed("a positive number, or X:Y (across and down)"))?;
            }
            "transform" => {
                placement.transform = transform(value).map_err(|e| format!("{key}={value}: {e}"))?
            }
            "shift" => {
                placement.shift = both(value).ok_or_else(|| needed("X:Y in pixels"))?;
            }
            Self::RULE_KEY => {
                self.rule = Some(value.parse().map_err(|e| format!("{key}={value}: {e}"))?);
            }
            _ => {
                self.stored.set(key, value).map_err(|e| e.to_string())?;
            }
        }
        Ok(())
    }

    /// Settings that differ from the defaults, as the keys and values that [`Self::set`] accepts.
    pub fn settings(&self) -> Vec<(&'static str, String)> {
        self.changes_from(&Self::default())
    }

    /// Settings that differ from `other`, as the keys and values that [`Self::set`] accepts.
    pub fn changes_from(&self, other: &Self) -> Vec<(&'static str, String)> {
        let before = other.stored.settings();
        let stored = self.stored.settings().into_iter();
        let stored = stored.filter(|item| !before.contains(item));
        let stored = stored.map(|(key, value)| (key, value.to_owned()));
        let placed = self.placement.values().into_iter();
        let placed = placed.zip(other.placement.values());
        let placed = Self::PLACEMENT_KEYS.into_iter().zip(placed);
        let placed = placed.filter_map(|(key, (own, other))| (own != other).then_some((key, own)));
        let rule = self.rule.filter(|rule| other.rule != Some(*rule));
        let rule = rule.map(|rule| (Self::RULE_KEY, rule.to_string()));
        stored.chain(placed).chain(rule).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_name_a_frame_and_opengl_turns_about_x() {
        for bad in ["", "rd", "rdd", "rlf", "xyz", "rdfb"] {
            assert_eq!(Axes::parse(bad), None, "{bad}");
        }
        let point = DVec3::new(1.0, 2.0, 3.0);
        let opencv = |axes: &str| Axes::parse(axes).unwrap().matrix() * point;
        assert_eq!(opencv("opengl"), DVec3::new(1.0, -2.0, -3.0));
        assert_eq!(opencv("luf"), DVec3::new(-1.0, -2.0, 3.0));
        // x right, y forward, z up.
        assert_eq!(opencv("rfu"), DVec3::new(1.0, -3.0, 2.0));
    }

    #[test]
    fn settings_are_read_back_and_wrong_values_say_what_is_needed() {
        let mut reading = FileReading::default();
        assert_eq!(reading.settings(), []);
        let given = [
            ("opacity", "linear"),
            ("quaternions", "xyzw"),
            ("space", "world"),
            ("axes", "luf"),
            ("scale", "0.2"),
            ("transform", "0:2:0:-2:0:0:0:0:2:1:2:3.5"),
            ("shift", "0.5,-0.5"),
            ("focal", "1.2:1.1"),
            ("rendering", "inria,near=0.01"),
        ];
        for (key, value) in given {
            reading.set(key, value).unwrap();
        }
        let mut again = FileReading::default();
        for (key, value) in reading.settings() {
            again.set(key, &value).unwrap();
        }
        assert_eq!(again, reading);
        for (key, value, part) in [
            ("opacity", "percent", "logit or linear"),
            ("scale", "-1", "positive"),
            ("focal", "1:-1", "across and down"),
            ("shift", "1", "X:Y"),
            ("transform", "no.json", "no.json"),
            ("space", "moon", "target, world or normalized"),
            ("axes", "rdd", "rdf"),
            ("rendering", "graphdeco", "inria-general"),
        ] {
            let error = reading.set(key, value).unwrap_err();
            assert!(error.contains(part), "{error}");
        }
    }
}
