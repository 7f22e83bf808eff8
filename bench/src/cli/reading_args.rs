//! Arguments for reading a file of Gaussians.

use clap::Args;
use sharp::ply::{ColorSpace, StoredForm};

use crate::methods::file_reading::Axes;

#[derive(Debug, Clone, Args)]
pub(crate) struct ReadingArgs {
    /// Encoding of the colours, for a PLY that does not state it: linear or srgb
    #[arg(long, value_name = "SPACE")]
    color_space: Option<ColorSpace>,
    /// How the Gaussian file stores its values, as in --method gaussians: opacity=linear, scales=linear,
    /// quaternions=xyzw, colors=rgb01, harmonics=drop
    #[arg(long, value_name = "KEY=VALUE,…", value_delimiter = ',', value_parser = setting)]
    read: Vec<(String, String)>,
    /// Axes of the Gaussian file: rdf (OpenCV's, usual in PLY files), rub (OpenGL's), luf or ldb. Required for
    /// SPZ files, which do not state axes
    #[arg(long, value_name = "AXES", value_parser = Axes::parse_flip)]
    pub(crate) axes: Option<[f32; 3]>,
}

impl ReadingArgs {
    pub(crate) fn reading(&self) -> StoredForm {
        let mut reading = StoredForm::from(self.color_space);
        for (key, value) in &self.read {
            // Each setting was validated when it was parsed, so there can be no error.
            let _ = reading.set(key, value);
        }
        reading
    }
}

fn setting(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or("expected KEY=VALUE")?;
    match StoredForm::default().set(key, value) {
        Ok(true) => Ok((key.to_owned(), value.to_owned())),
        Ok(false) => Err(format!("unknown; known: {}", StoredForm::KEYS.join(", "))),
        Err(error) => Err(error.to_string()),
    }
}
