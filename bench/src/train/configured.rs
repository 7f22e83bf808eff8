//! A configuration with values overridden on the command line.

use std::path::Path;

use sharp::files::read_text;
use sharp_train::config::{ConfigError, TrainingConfig};
use toml::Table;

use super::TrainError;
use crate::io::atomic_files::FileError;

/// The text and the parsed form of a configuration file, after applying the overrides in `set`.
///
/// # Errors
/// [`TrainError::Config`] if the file itself is invalid; [`TrainError::Set`] if an override is
/// invalid.
pub(super) fn configured(
    file: &Path,
    set: &[String],
) -> Result<(String, TrainingConfig), TrainError> {
    let text = read_text(file).map_err(FileError::new(file, "read"))?;
    let config = TrainingConfig::parse(&text, file)?;
    if set.is_empty() {
        return Ok((text, config));
    }
    let fault = |set: &str, reason: String| TrainError::Set {
        set: set.to_owned(),
        reason,
    };
    let all = set.join(" --set ");
    let mut table: Table = toml::from_str(&text).map_err(|e| fault(&all, e.to_string()))?;
    for one in set {
        change(&mut table, one).map_err(|reason| fault(one, reason))?;
    }
    // Validate all overrides together: a stage with fewer steps may need a shorter warm-up.
    let text = table.to_string();
    let config = TrainingConfig::parse(&text, file).map_err(|error| {
        let reason = match error {
            ConfigError::Parse { reason, .. } => reason,
            ConfigError::Value { key, reason, .. } => format!("`{key}` {reason}"),
            read @ ConfigError::Read { .. } => read.to_string(),
        };
        fault(&all, reason)
    })?;
    Ok((text, config))
}

/// Applies `KEY=VALUE`; an empty value resets the key to its default.
fn change(table: &mut Table, set: &str) -> Result<(), String> {
    let (key, value) = set.split_once('=').ok_or("expected KEY=VALUE")?;
    let (key, value) = (key.trim(), value.trim());
    let mut names: Vec<&str> = key.split('.').collect();
    let last = names.pop().unwrap_or_default();
    if value.is_empty() {
        let mut place = Some(table);
        for name in names {
            place = place.and_then(|table| table.get_mut(name)?.as_table_mut());
        }
        let removed = place.and_then(|table| table.remove(last));
        return removed
            .map(drop)
            .ok_or_else(|| format!("the configuration does not set `{key}`"));
    }
    let chooses = matches!(names.last(), Some(&("network" | "data")));
    let mut place = table;
    for name in names {
        let inner = place.entry(name).or_insert_with(|| Table::new().into());
        // For example, setting `network.file` when `network` is a name.
        if !inner.is_table() {
            *inner = Table::new().into();
        }
        place = inner.as_table_mut().ok_or("it is not a table")?;
    }
    // Setting one of several alternative keys removes the alternatives.
    if chooses {
        place.clear();
    }
    // A value that is not valid TOML is taken as text without quotes.
    let parsed = toml::from_str(&format!("value = {value}")).ok();
    let parsed = parsed.and_then(|mut table: Table| table.remove("value"));
    place.insert(last.to_owned(), parsed.unwrap_or_else(|| value.into()));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "zeros_return = true\n[stage1]\nsteps = 900\nbatch = 2\nschedule.warmup_steps = 300\n[stage2]\nsteps = 0\n";

    fn configure(set: &[&str]) -> Result<TrainingConfig, String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), TEXT).unwrap();
        let set: Vec<String> = set.iter().map(|&one| one.to_owned()).collect();
        let (text, config) = configured(file.path(), &set).map_err(|error| error.to_string())?;
        // The saved text parses to the same configuration.
        assert_eq!(
            TrainingConfig::parse(&text, file.path()).unwrap().sha256(),
            config.sha256()
        );
        Ok(config)
    }

    #[test]
    fn values_take_the_place_of_the_files() {
        let config = configure(&[
            "stage1.steps=30",
            "stage1.schedule.warmup_steps = 3",
            "aligned=false",
            "losses.percep=0",
            "trained=x",
            "zeros_return=",
            "trained.alignment=false",
            "initial=first/weights.safetensors",
            "stage1.data={ photographs = \"a\" }",
            "stage1.data.datasets=[\"colmap=desk\"]",
        ])
        .unwrap();
        assert_eq!((config.stage1.steps, config.stage1.batch), (30, 2));
        assert_eq!(config.stage1.schedule.warmup_steps, 3);
        assert!(!config.aligned && !config.zeros_return);
        assert_eq!(config.losses.percep, 0.0);
        assert!(!config.trained.alignment && config.trained.gaussian_decoder);
        assert_eq!(
            config.initial.as_deref(),
            Some(Path::new("first/weights.safetensors"))
        );
        assert_ne!(config.stage1.data, Default::default());
        assert_eq!(configure(&[]).unwrap().stage1.steps, 900);
    }

    #[test]
    fn what_cannot_be_set_is_named() {
        for (set, reason) in [
            ("stage1.steps", "expected KEY=VALUE"),
            ("zeros_return.a=1", "expected a boolean"),
            ("stage1.steps=200", "warmup_steps` must be less"),
            ("stage1.stesp=200", "stesp"),
            ("stage1.stesp=", "does not set `stage1.stesp`"),
            ("stage2.seed=", "does not set `stage2.seed`"),
            ("losses.percep=much", "much"),
        ] {
            let error = configure(&[set]).unwrap_err();
            assert!(
                error.starts_with(&format!("--set {set}: ")) && error.contains(reason),
                "{error}"
            );
        }
    }
}
