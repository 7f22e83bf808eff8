//! Everything that decides the results of a run, as command-line options and as a file.

use std::path::{Path, PathBuf};

use clap::{Args, Command};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sharp::render::Backend;
use sharp_datasets::error::nearest_of;
use sharp_metrics::InstructionSet;

use super::error::ConfigError;
use super::metrics::MetricConfig;
use super::pairs::PairConfig;
use super::rendering::{RenderingConfig, backend};
use super::text;
use crate::methods::file_reading::is_transform_file;
use crate::methods::training_views::is_training_list;
use crate::methods::{MethodSpec, SpecError};
use crate::pairs::{DatasetConfig, clap_dataset};

/// The options of `run`, which are also the keys of a `run.toml`. Relative paths in a file are resolved against the
/// file's folder.
#[derive(Debug, Clone, Default, PartialEq, Args, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", default)]
pub struct RunConfig {
    /// A dataset to evaluate on, `[NAME:]FORMAT=PATH[,key=value…]`; repeatable
    #[arg(long = "dataset", value_name = "SPEC", value_parser = clap_dataset)]
    #[serde(rename = "dataset")]
    pub datasets: Vec<DatasetConfig>,
    /// Use only scenes whose id matches this pattern; `*` and `?` are wildcards
    #[arg(long, value_name = "GLOB")]
    pub scenes: Option<String>,
    /// A method to evaluate, `KIND[:key=value,…]`; repeatable
    #[arg(long = "method", value_name = "SPEC", value_parser = clap_method)]
    #[serde(rename = "method")]
    pub methods: Vec<MethodSpec>,
    #[command(flatten)]
    #[serde(flatten)]
    pub metrics: MetricConfig,
    /// Follow a published evaluation's rules for pairs, size, metrics, masks, rounding and averages (`sharp-bench
    /// protocols` lists the evaluations). Conflicting options are an error; the report states where the run differs
    /// from the original
    #[arg(long, value_name = "NAME")]
    pub protocol: Option<String>,
    #[command(flatten)]
    #[serde(flatten)]
    pub pairs: PairConfig,
    /// Evaluate at most N pairs, spread over datasets and scenes. The pairs for a smaller N are a subset of those for a
    /// larger N
    #[arg(long, value_name = "N")]
    pub limit: Option<usize>,
    /// For each pair, score every method only on the part of the target that all methods predict
    #[arg(long)]
    pub common_region: bool,
    /// For methods that provide several scales, score each pair at the scale with the lowest DISTS (the paper's rule
    /// for methods without metric scale); the report says "best of N scales by DISTS"
    #[arg(long)]
    pub scale_sweep: bool,
    /// Which predicted pictures to keep [default: all]
    #[arg(long, value_enum)]
    pub keep: Option<Keep>,
    /// Keep predicted Gaussians, so that other targets or another renderer need no new prediction
    #[arg(long)]
    pub keep_gaussians: bool,
    /// The renderer: cpu, or wgpu (a GPU through Vulkan, Metal or Direct3D 12). A run uses a single
    /// renderer, which is recorded with every result [default: cpu]
    #[arg(long, value_name = "BACKEND")]
    #[serde(with = "text")]
    #[schemars(with = "Option<String>")]
    pub backend: Option<Backend>,
    /// The GPU to render on, by part of its description (`sharp-bench doctor` lists the GPUs)
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    #[command(flatten)]
    #[serde(flatten)]
    pub rendering: RenderingConfig,
    /// Instruction set of the CPU kernels: avx512, avx2 or portable [default: the machine's fastest]. Machines that use
    /// the same set get bit-identical results and can share a run
    #[arg(long, value_name = "SET")]
    #[serde(with = "text")]
    #[schemars(with = "Option<String>")]
    pub simd: Option<InstructionSet>,
}

/// Pictures that are kept in the run folder.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Keep {
    /// All pictures, as 8-bit PNG
    #[default]
    All,
    /// All pictures as 8-bit PNG, and renderings also as EXR (linear RGB and alpha), which some protocols need
    Float,
    /// No pictures
    None,
}

/// Parses a method spec for clap. The error does not repeat the spec, because clap quotes it.
fn clap_method(text: &str) -> Result<MethodSpec, String> {
    text.parse().map_err(|error: SpecError| error.reason())
}

impl RunConfig {
    /// The first method that starts an external program (kind `command`).
    pub(crate) fn program(&self) -> Option<&MethodSpec> {
        let mut methods = self.methods.iter();
        methods.find(|method| method.kind == "command")
    }

    /// Reads a file and makes its paths absolute.
    ///
    /// # Errors
    /// If the file cannot be read, has an unknown key, or a value that the option does not accept.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let failed = |reason: String| ConfigError::File {
            path: path.to_owned(),
            reason,
        };
        let bytes = sharp::files::read(path).map_err(|error| failed(error.to_string()))?;
        let text = String::from_utf8(bytes).map_err(|error| failed(error.to_string()))?;
        let wrong = |reason: String| ConfigError::Usage(format!("{}: {reason}", path.display()));
        let keys: Map<String, Value> =
            toml::from_str(&text).map_err(|error: toml::de::Error| {
                let at = error.span().map_or(0, |span| span.start);
                let line = text
                    .get(..at)
                    .map_or(0, |before| before.matches('\n').count());
                wrong(format!("line {}: {}", line + 1, error.message()))
            })?;
        let config = Self::of_keys(keys).map_err(wrong)?;
        let absolute = std::path::absolute(path).map_err(|error| failed(error.to_string()))?;
        Ok(config.rooted(absolute.parent().unwrap_or(Path::new("/"))))
    }

    /// Builds a configuration from the keys of a file, leaving paths unchanged.
    ///
    /// # Errors
    /// Those of [`read`](Self::read).
    pub fn from_keys(keys: Map<String, Value>) -> Result<Self, ConfigError> {
        Self::of_keys(keys).map_err(ConfigError::Usage)
    }

    /// Errors do not name the file; the caller adds it.
    fn of_keys(keys: Map<String, Value>) -> Result<Self, String> {
        let options = Self::augment_args(Command::new("run"));
        let known: Vec<&str> = options
            .get_arguments()
            .filter_map(|a| a.get_long())
            .collect();
        match keys.keys().find(|key| !known.contains(&key.as_str())) {
            Some(key) => Err(format!("unknown key '{key}'; {}", nearest_of(key, &known))),
            None => {
                let parsed = |keys| serde_json::from_value::<Self>(Value::Object(keys));
                let wrong = keys.iter().find_map(|(key, value)| {
                    let alone = Map::from_iter([(key.clone(), value.clone())]);
                    let error = parsed(alone).err()?;
                    let reason = error.to_string().replace("usize", "a whole number");
                    Some(format!("{key}: {reason}"))
                });
                wrong.map_or_else(|| parsed(keys).map_err(|e| e.to_string()), Err)
            }
        }
    }

    /// The options, keyed by name; options left at their defaults are omitted.
    ///
    /// # Errors
    /// If a path is not Unicode.
    pub fn keys(&self) -> Result<Map<String, Value>, ConfigError> {
        let mut keys = match serde_json::to_value(self) {
            Ok(Value::Object(keys)) => keys,
            Ok(_) => Map::new(),
            Err(error) => return Err(ConfigError::Usage(error.to_string())),
        };
        keys.retain(|_, value| match value {
            Value::Null | Value::Bool(false) => false,
            Value::Array(items) => !items.is_empty(),
            _ => true,
        });
        Ok(keys)
    }

    /// This configuration, with each option that `over` sets replaced by the value in `over`.
    ///
    /// # Errors
    /// If the combination is not a valid configuration.
    pub fn overlaid(&self, over: &Self) -> Result<Self, ConfigError> {
        let mut keys = self.keys()?;
        keys.extend(over.keys()?);
        Self::from_keys(keys)
    }

    /// Serialises to the contents of a `run.toml`.
    ///
    /// # Errors
    /// If a path is not Unicode.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        toml::to_string(&self.keys()?).map_err(|error| ConfigError::Usage(error.to_string()))
    }

    /// The rendering backend.
    ///
    /// # Errors
    /// If backend and adapter contradict each other.
    pub fn backend(&self) -> Result<Backend, ConfigError> {
        let given = self.backend.clone().unwrap_or_default();
        backend(&given, self.adapter.as_deref())
    }

    /// Resolves relative paths against `folder`, in which programs of methods without `cwd=` also run.
    #[must_use]
    pub fn rooted(mut self, folder: &Path) -> Self {
        let root = |path: &mut PathBuf| *path = folder.join(&path);
        let root_text = |text: &mut String| *text = folder.join(&text).display().to_string();
        for DatasetConfig { spec, pairs, .. } in &mut self.datasets {
            if !spec.path.as_os_str().is_empty() {
                root(&mut spec.path);
            }
            pairs.overlap_depth.as_mut().map(root);
            pairs
                .overlap_checkpoint
                .as_mut()
                .filter(|path| is_file(path))
                .map(root);
            pairs.overlap_config.as_mut().map(root_text);
        }
        for method in &mut self.methods {
            if method.kind == "command" {
                method.options.entry("cwd".to_owned()).or_default();
            }
            // `files=` is not among these options, because its path is relative to the program's
            // working directory.
            for key in ["dir", "checkpoint", "config", "cwd", "transform", "train"] {
                let value = method.options.get_mut(key);
                let is_path = |value: &&mut String| match key {
                    "checkpoint" => is_file(value.as_ref()),
                    "transform" => is_transform_file(value),
                    "train" => is_training_list(value),
                    _ => true,
                };
                value.filter(is_path).map(root_text);
            }
        }
        let PairConfig { pairs, overlap, .. } = &mut self.pairs;
        for path in [pairs, &mut overlap.overlap_depth, &mut overlap.cache] {
            path.as_mut().map(root);
        }
        overlap
            .overlap_checkpoint
            .as_mut()
            .filter(|path| is_file(path))
            .map(root);
        overlap.overlap_config.as_mut().map(root_text);
        for weights in &mut self.metrics.weights {
            if let Some((name, file)) = weights.split_once('=') {
                *weights = format!("{name}={}", folder.join(file).display());
            }
        }
        self
    }
}

/// Whether `checkpoint` is a file rather than the bundled network `mini`.
fn is_file(checkpoint: &Path) -> bool {
    checkpoint != Path::new("mini")
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::FromArgMatches;

    fn of_options(options: &str) -> RunConfig {
        let command = RunConfig::augment_args(Command::new("run"));
        let words = std::iter::once("run").chain(options.split_whitespace());
        let matches = command.try_get_matches_from(words).unwrap();
        RunConfig::from_arg_matches(&matches).unwrap()
    }

    const ALL: &str = "--dataset E:eth3d=a,b/c,images=undistorted,frame=cover:24x24:area,pairs.order=once --dataset synthetic \
        --scenes s* --method copy --method command:label=m,run='p,q',timeout=3 --metrics psnr --weights vgg16=w.pth \
        --device candle-cpu --protocol lvsm --pair-options order=once --overlap-depth d --overlap-checkpoint mini \
        --overlap-config c.json#x --cache k --no-check --limit 3 --common-region --scale-sweep --keep float --keep-gaussians --backend wgpu:X --adapter X \
        --eps2d gsplat --background #0080ff --quantise truncate --simd portable";

    #[test]
    fn a_file_says_what_options_say() {
        let config = of_options(ALL);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.toml");
        std::fs::write(&path, config.to_toml().unwrap()).unwrap();
        let read = RunConfig::read(&path).unwrap();
        assert_eq!(read, config.clone().rooted(folder.path()));
        // Absolute paths are unchanged.
        assert_eq!(read.clone().rooted(Path::new("/elsewhere")), read);
        assert_eq!(
            read.methods[1].options["cwd"],
            format!("{}/", folder.path().display())
        );
        std::fs::write(&path, "eps2d = 0.3\nlimit = 2\n").unwrap();
        assert_eq!(
            RunConfig::read(&path).unwrap(),
            of_options("--eps2d gsplat --limit 2")
        );
    }

    #[test]
    fn the_bundled_network_is_no_path_and_a_folder_of_its_name_is_one() {
        let config = of_options("--method sharp:checkpoint=mini --method imported:dir=mini");
        let rooted = config.rooted(Path::new("/r"));
        assert_eq!(rooted.methods[0].options["checkpoint"], "mini");
        assert_eq!(rooted.methods[1].options["dir"], "/r/mini");
    }

    #[test]
    fn a_transform_is_a_path_unless_it_is_its_numbers() {
        let rooted = |transform: &str| {
            let config = of_options(&format!(
                "--method gaussians:dir=g,space=world,transform={transform}"
            ));
            config.rooted(Path::new("/r")).methods[0].options["transform"].clone()
        };
        assert_eq!(rooted("t.json"), "/r/t.json");
        for own in ["none", "1:0:0:0:1:0:0:0:1:2:3:4", "{scene}/t.json"] {
            assert_eq!(rooted(own), own);
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_path_that_no_file_can_hold_is_refused() {
        use std::os::unix::ffi::OsStrExt;
        let mut config = of_options("--limit 3");
        let path = std::ffi::OsStr::from_bytes(b"list-\xe9.csv");
        config.pairs.pairs = Some(path.into());
        assert!(config.to_toml().is_err() && config.overlaid(&RunConfig::default()).is_err());
    }

    #[test]
    fn every_option_is_a_key() {
        let schema = serde_json::to_value(schemars::schema_for!(RunConfig)).unwrap();
        let keys: std::collections::BTreeSet<&str> = schema["properties"]
            .as_object()
            .unwrap()
            .keys()
            .map(String::as_str)
            .collect();
        let command = RunConfig::augment_args(Command::new("run"));
        let options = command
            .get_arguments()
            .filter_map(|a| a.get_long())
            .collect();
        assert_eq!(keys, options);
    }

    #[test]
    fn options_are_laid_over_a_file() {
        let file =
            of_options("--dataset synthetic --method copy --method mean --limit 3 --no-check");
        let over = of_options("--method target --limit 1 --metrics psnr");
        let expected = "--dataset synthetic --method target --limit 1 --no-check --metrics psnr";
        assert_eq!(file.overlaid(&over).unwrap(), of_options(expected));
    }

    #[test]
    fn mistakes_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.toml");
        for (text, part) in [
            ("limits = 3", "'limits'; did you mean 'limit'"),
            ("limit = \"x\"", "expected a whole number"),
            ("dataset = [\"moonbase=x\"]", "moonbase"),
            ("method = [\"copy:a\"]", "not key=value"),
            ("eps2d = \"sharp\"", "release (0)"),
            ("seed = 1\n\nlimit = ", "line 3"),
        ] {
            std::fs::write(&path, text).unwrap();
            let error = RunConfig::read(&path).unwrap_err().to_string();
            assert!(
                error.contains(part) && error.contains("run.toml"),
                "{text}: {error}"
            );
        }
    }
}
