//! `transforms.json` as written by nerfstudio, instant-ngp, Blender and ScanNet++: intrinsics and camera-to-world poses
//! in OpenGL's axes (x right, y up, z backwards).

use std::sync::Arc;

use glam::DVec3;
use serde_json::{Map, Value};
use sharp::camera::{CameraError, RigidTransform};

use super::{FormatError, lenient_json};
use crate::lens::{Distortion, Lens, LensError};

#[derive(Debug)]
pub struct Transforms {
    /// `frames`, in file order.
    pub frames: Vec<JsonFrame>,
    /// `test_frames` (ScanNet++), in file order.
    pub test_frames: Vec<JsonFrame>,
    /// `applied_scale`: the factor by which translations were multiplied; 1 if absent.
    pub applied_scale: f64,
    /// `integer_depth_scale` (instant-ngp): the depth of one level of integer depth maps, in the poses' unit.
    pub depth_level: Option<f64>,
}

#[derive(Debug)]
pub struct JsonFrame {
    /// Path as written; may start with `./` and may have no extension.
    pub file_path: String,
    /// `depth_file_path`, or instant-ngp's `depth_path`.
    pub depth_file_path: Option<String>,
    pub mask_path: Option<String>,
    /// True if the pose is unreliable (ScanNet++).
    pub is_bad: bool,
    /// Camera to world in OpenCV's axes, with the translation as in the file, or the reason why the
    /// pose is invalid.
    pub world_from_camera: Result<RigidTransform, CameraError>,
    intrinsics: RawIntrinsics,
    /// Intrinsics that the file states for all its frames.
    shared: Arc<RawIntrinsics>,
    /// True if the frame's own intrinsics differ from the file's. The frame's own are used unless
    /// [`JsonFrame::prefer_file`] is called.
    pub contradicts_file: bool,
}

/// Intrinsics as written, before the picture's size is known.
#[derive(Debug, Clone, Default, PartialEq)]
struct RawIntrinsics {
    numbers: Map<String, Value>,
}

const INTRINSIC_KEYS: [&str; 18] = [
    "fl_x",
    "fl_y",
    "cx",
    "cy",
    "w",
    "h",
    "camera_angle_x",
    "camera_angle_y",
    "camera_model",
    "k1",
    "k2",
    "k3",
    "k4",
    "k5",
    "k6",
    "p1",
    "p2",
    "is_fisheye",
];

/// Parses a `transforms.json`.
///
/// # Errors
/// If the text is not JSON, has no frames, or a frame has no path or a matrix that is neither 4×4 nor 3×4. A pose that
/// is not finite or not rigid is not an error here; the frame records it.
pub fn parse(text: &str) -> Result<Transforms, FormatError> {
    let document = lenient_json::parse(text)?;
    let top = document
        .as_object()
        .ok_or("the document is not an object")?;
    let frames = top
        .get("frames")
        .and_then(Value::as_array)
        .ok_or("there is no list of 'frames'")?;
    let test_frames = top.get("test_frames").and_then(Value::as_array);
    let shared = Arc::new(RawIntrinsics::of(top));
    let read = |list: &[Value]| {
        list.iter()
            .enumerate()
            .map(|(i, frame)| frame_of(frame, &shared).map_err(|e| invalid!("frame {i}: {e}")))
            .collect::<Result<Vec<_>, _>>()
    };
    let applied_scale = match top.get("applied_scale") {
        None | Some(Value::Null) => 1.0,
        Some(value) => value
            .as_f64()
            .filter(|s| *s > 0.0)
            .ok_or_else(|| invalid!("applied_scale is {value}, not a number above zero"))?,
    };
    Ok(Transforms {
        frames: read(frames)?,
        test_frames: read(test_frames.map_or(&[], Vec::as_slice))?,
        applied_scale,
        depth_level: top.get("integer_depth_scale").and_then(Value::as_f64),
    })
}

fn frame_of(value: &Value, shared: &Arc<RawIntrinsics>) -> Result<JsonFrame, FormatError> {
    let object = value.as_object().ok_or("is not an object")?;
    let text = |key: &str| object.get(key).and_then(Value::as_str).map(str::to_owned);
    let file_path = text("file_path").ok_or("has no 'file_path'")?;
    let written = object
        .get("transform_matrix")
        .ok_or("has no 'transform_matrix'")?;
    let rows = matrix(written).ok_or("its 'transform_matrix' is neither 4x4 nor 3x4")?;
    let own = RawIntrinsics::of(object);
    Ok(JsonFrame {
        contradicts_file: own
            .numbers
            .iter()
            .any(|(key, v)| shared.numbers.get(key).is_some_and(|s| s != v)),
        intrinsics: shared.overridden_by(&own),
        shared: Arc::clone(shared),
        file_path,
        depth_file_path: text("depth_file_path").or_else(|| text("depth_path")),
        mask_path: text("mask_path"),
        is_bad: object
            .get("is_bad")
            .and_then(Value::as_bool)
            .unwrap_or(false),
        world_from_camera: pose(&rows),
    })
}

/// 16 numbers from nested lists of 4×4 or 3×4; `null` becomes NaN.
fn matrix(value: &Value) -> Option<[f64; 16]> {
    let rows = value.as_array()?;
    if rows.len() != 3 && rows.len() != 4 {
        return None;
    }
    let mut out = [0.0; 16];
    out[15] = 1.0;
    for (i, row) in rows.iter().enumerate() {
        let row = row.as_array().filter(|row| row.len() == 4)?;
        for (j, entry) in row.iter().enumerate() {
            out[4 * i + j] = match entry {
                Value::Null => f64::NAN,
                other => other.as_f64()?,
            };
        }
    }
    Some(out)
}

/// Converts OpenGL's camera axes to OpenCV's by negating y and z.
fn pose(rows: &[f64; 16]) -> Result<RigidTransform, CameraError> {
    let mut flipped = *rows;
    for row in 0..3 {
        flipped[4 * row + 1] = -flipped[4 * row + 1];
        flipped[4 * row + 2] = -flipped[4 * row + 2];
    }
    RigidTransform::from_row_major(&flipped)
}

impl RawIntrinsics {
    fn of(object: &Map<String, Value>) -> Self {
        let numbers = INTRINSIC_KEYS
            .iter()
            .filter_map(|key| Some(((*key).to_owned(), object.get(*key)?.clone())))
            .collect();
        Self { numbers }
    }

    fn overridden_by(&self, other: &Self) -> Self {
        let mut numbers = self.numbers.clone();
        numbers.extend(other.numbers.iter().map(|(k, v)| (k.clone(), v.clone())));
        Self { numbers }
    }

    fn number(&self, key: &str) -> Result<Option<f64>, FormatError> {
        match self.numbers.get(key) {
            None => Ok(None),
            Some(value) => match value.as_f64() {
                Some(number) => Ok(Some(number)),
                None => Err(invalid!("'{key}' is {value}, not a number")),
            },
        }
    }
}

impl JsonFrame {
    /// Makes the file's intrinsics override the frame's, as in nerfstudio.
    pub fn prefer_file(&mut self) {
        self.intrinsics = self.intrinsics.overridden_by(&self.shared);
    }

    /// Width and height, if stated.
    ///
    /// # Errors
    /// If width or height is not a valid pixel count (integers may be written as floats).
    pub fn size(&self) -> Result<Option<(u32, u32)>, FormatError> {
        let side = |key: &str| match self.intrinsics.number(key)? {
            None => Ok(None),
            Some(n) if n >= 1.0 && n <= f64::from(u32::MAX) && n.fract() == 0.0 => {
                Ok(Some(n as u32))
            }
            Some(n) => Err(invalid!("'{key}' is {n}, not a number of pixels")),
        };
        Ok(side("w")?.zip(side("h")?))
    }

    /// The camera for a picture of the given `size`.
    ///
    /// # Errors
    /// [`FormatError::Lens`] for an unknown camera model or invalid intrinsics, [`FormatError::Invalid`] if there is no
    /// focal length.
    pub fn lens(&self, size: (u32, u32)) -> Result<Lens, FormatError> {
        let raw = &self.intrinsics;
        let (w, h) = (f64::from(size.0), f64::from(size.1));
        let focal = |key: &str, angle_key: &str, side: f64| -> Result<Option<f64>, FormatError> {
            if let Some(focal) = raw.number(key)? {
                return Ok(Some(focal));
            }
            match raw.number(angle_key)? {
                Some(angle) if !(angle > 0.0 && angle < std::f64::consts::PI) => Err(invalid!(
                    "'{angle_key}' is {angle}, but angles of view are in radians, between 0 and 3.14; if it is in \
                     degrees, write {:.4}",
                    angle.to_radians()
                )),
                angle => Ok(angle.map(|angle| 0.5 * side / (0.5 * angle).tan())),
            }
        };
        let fx = focal("fl_x", "camera_angle_x", w)?;
        let fy = focal("fl_y", "camera_angle_y", h)?;
        let (fx, fy) = match (fx, fy) {
            (Some(fx), Some(fy)) => (fx, fy),
            (Some(f), None) | (None, Some(f)) => (f, f),
            (None, None) => {
                return Err("there is no focal length, neither 'fl_x' nor 'camera_angle_x'".into());
            }
        };
        let center = (
            raw.number("cx")?.unwrap_or(w / 2.0),
            raw.number("cy")?.unwrap_or(h / 2.0),
        );
        let lens = Lens::new((fx, fy), center, size, self.distortion()?);
        Ok(lens.map_err(LensError::from)?)
    }

    fn distortion(&self) -> Result<Distortion, FormatError> {
        let k = |key: &str| Ok::<f64, FormatError>(self.intrinsics.number(key)?.unwrap_or(0.0));
        let [k1, k2, k3, k4] = [k("k1")?, k("k2")?, k("k3")?, k("k4")?];
        let p = [k("p1")?, k("p2")?];
        let fisheye = self.intrinsics.numbers.get("is_fisheye") == Some(&Value::Bool(true));
        let model = match self.intrinsics.numbers.get("camera_model") {
            Some(Value::String(model)) => model.as_str(),
            _ if fisheye => "OPENCV_FISHEYE",
            _ => "OPENCV",
        };
        // Like nerfstudio, uses distortion coefficients, if present, even if the model's name excludes distortion.
        let model = match model {
            "PINHOLE" | "SIMPLE_PINHOLE" | "PERSPECTIVE" => "OPENCV",
            other => other,
        };
        let distortion = match model {
            "SIMPLE_RADIAL" | "RADIAL" => Distortion::perspective("RADIAL", &[k1, k2], [0.0; 2]),
            // nerfstudio's k3 and k4 extend the radial polynomial of OPENCV.
            "OPENCV" if k4 != 0.0 => {
                return Err("camera model OPENCV with k4 is not supported".into());
            }
            "OPENCV" if k3 == 0.0 => Distortion::perspective("OPENCV", &[k1, k2], p),
            "OPENCV" => Distortion::perspective("FULL_OPENCV", &[k1, k2, k3], p),
            "FULL_OPENCV" => {
                let radial = [k1, k2, k3, k4, k("k5")?, k("k6")?];
                Distortion::perspective("FULL_OPENCV", &radial, p)
            }
            "OPENCV_FISHEYE" => Distortion::OpenCvFisheye {
                k: [k1, k2, k3, k4],
            },
            other => {
                let model = other.to_owned();
                return Err(LensError::UnsupportedModel { model }.into());
            }
        };
        let all = [k1, k2, k3, k4, p[0], p[1]];
        if all.iter().all(|v| v.is_finite()) {
            Ok(distortion)
        } else {
            Err("a distortion parameter is not finite".into())
        }
    }
}

/// For a camera-to-world pose, undoes the change of world axes that nerfstudio applies to COLMAP
/// models. ScanNet++'s files have the same change but do not state it.
pub fn undo_colmap_axes(world_from_camera: &RigidTransform) -> RigidTransform {
    // (x, y, z) was written as (y, x, −z), which is its own inverse.
    let swap = |v: DVec3| DVec3::new(v.y, v.x, -v.z);
    let mut rotation = world_from_camera.rotation;
    rotation.x_axis = swap(rotation.x_axis);
    rotation.y_axis = swap(rotation.y_axis);
    rotation.z_axis = swap(rotation.z_axis);
    RigidTransform {
        rotation,
        translation: swap(world_from_camera.translation),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDENTITY: &str = "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";

    fn one(keys: &str, frame_keys: &str) -> Transforms {
        let text = format!(
            "{{{keys}\"frames\": [{{\"file_path\": \"a.png\", {frame_keys}\"transform_matrix\": {IDENTITY}}}]}}"
        );
        parse(&text).unwrap()
    }

    #[test]
    fn opengl_axes_become_opencvs() {
        let file = one("", "");
        let pose = file.frames[0].world_from_camera.as_ref().unwrap();
        // A point in front of an OpenCV camera (z > 0) is behind an OpenGL camera with the same axes.
        assert_eq!(
            pose.apply(DVec3::new(0.5, 1.0, 2.0)),
            DVec3::new(1.5, 1.0, 1.0)
        );
    }

    #[test]
    fn depth_has_two_names() {
        let own = one(
            "",
            "\"depth_file_path\": \"own.png\", \"depth_path\": \"other.png\",",
        );
        assert_eq!(own.frames[0].depth_file_path.as_deref(), Some("own.png"));
        let ngp = one(
            "\"integer_depth_scale\": 0.0002,",
            "\"depth_path\": \"z.png\",",
        );
        assert_eq!(ngp.frames[0].depth_file_path.as_deref(), Some("z.png"));
        assert_eq!([own.depth_level, ngp.depth_level], [None, Some(0.0002)]);
    }

    #[test]
    fn focal_lengths_come_from_angles_and_floats_are_sizes() {
        let file = one(
            "\"camera_angle_x\": 1.5707963267948966, \"w\": 1080.0, \"h\": 720,",
            "",
        );
        assert_eq!(file.frames[0].size(), Ok(Some((1080, 720))));
        let lens = file.frames[0].lens((1080, 720)).unwrap();
        assert!((lens.intrinsics().fx - 540.0).abs() < 1e-9);
        assert_eq!(lens.intrinsics().fy, lens.intrinsics().fx);
        assert_eq!(lens.intrinsics().cx, 540.0);
        let degrees = one("\"camera_angle_x\": 58.1,", "");
        let error = degrees.frames[0].lens((4, 3)).unwrap_err().to_string();
        assert!(
            error.contains("in radians") && error.contains("1.0140"),
            "{error}"
        );
        let unused = one("\"camera_angle_x\": 58.1, \"fl_x\": 5,", "");
        assert!(unused.frames[0].lens((4, 3)).is_ok());
        assert!(one("\"w\": 10.5, \"h\": 1,", "").frames[0].size().is_err());
        assert!(one("", "").frames[0].lens((2, 2)).is_err());
    }

    #[test]
    fn distortion_follows_the_model() {
        let of = |keys: &str| {
            let file = one(&format!("\"fl_x\": 5, {keys}"), "");
            file.frames[0].lens((8, 8)).map(|lens| lens.distortion())
        };
        assert_eq!(of("\"k1\": 0,"), Ok(Distortion::None));
        assert_eq!(
            of("\"k1\": 0.1, \"p2\": 0.2,"),
            Ok(Distortion::perspective("OPENCV", &[0.1], [0.0, 0.2]))
        );
        assert_eq!(
            of("\"camera_model\": \"OPENCV_FISHEYE\", \"k4\": 0.1,"),
            Ok(Distortion::OpenCvFisheye {
                k: [0.0, 0.0, 0.0, 0.1]
            })
        );
        // Coefficients are used even if the model's name is that of a pinhole.
        assert_eq!(
            of("\"camera_model\": \"PINHOLE\", \"k1\": 0.1,"),
            of("\"k1\": 0.1,")
        );
        assert_eq!(
            of("\"camera_model\": \"PINHOLE\", \"k1\": 0.0,"),
            Ok(Distortion::None)
        );
        assert!(of("\"camera_model\": \"EQUIRECTANGULAR\",").is_err());
        assert!(of("\"k1\": \"x\",").is_err());
    }

    #[test]
    fn a_frames_intrinsics_count_unless_the_files_are_preferred() {
        let mut file = one("\"fl_x\": 5,", "\"fl_x\": 6, \"cx\": 3,");
        let frame = &mut file.frames[0];
        assert!(frame.contradicts_file);
        let numbers = |frame: &JsonFrame| {
            let k = frame.lens((8, 8)).unwrap().intrinsics();
            (k.fx, k.cx, k.cy)
        };
        assert_eq!(numbers(frame), (6.0, 3.0, 4.0));
        frame.prefer_file();
        assert_eq!(numbers(frame), (5.0, 3.0, 4.0));
        assert!(!one("\"fl_x\": 5,", "\"fl_x\": 5,").frames[0].contradicts_file);
    }

    #[test]
    fn the_axis_swap_undoes_itself() {
        let file = one("", "");
        let pose = file.frames[0].world_from_camera.as_ref().unwrap();
        let twice = undo_colmap_axes(&undo_colmap_axes(pose));
        assert_eq!(&twice, pose);
        let once = undo_colmap_axes(pose);
        assert_eq!(once.translation, DVec3::new(2.0, 1.0, -3.0));
        assert!((once.rotation.determinant() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn broken_files_are_explained() {
        for (text, reason) in [
            ("[]", "not an object"),
            ("{}", "no list of 'frames'"),
            ("{\"frames\": [{}]}", "frame 0: has no 'file_path'"),
            (
                "{\"frames\": [{\"file_path\": \"a\"}]}",
                "no 'transform_matrix'",
            ),
            (
                "{\"frames\": [{\"file_path\": \"a\", \"transform_matrix\": [[1]]}]}",
                "neither 4x4 nor 3x4",
            ),
            (
                "{\"frames\": [], \"applied_scale\": 0}",
                "applied_scale is 0",
            ),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.to_string().contains(reason), "{error}");
        }
    }
}
