//! `datasets list`.

use serde_json::{Value, json};
use sharp_datasets::facts::{Facts, facts};
use sharp_datasets::{catalog, spec::Setting};

use crate::cli::{Outcome, output};

pub(super) fn execute(json: bool) -> anyhow::Result<Outcome> {
    let described = facts().iter().zip(catalog::formats());
    if json {
        let all: Vec<Value> = described
            .map(|(facts, format)| {
                let mut entry = json!(facts);
                entry["readings"] = format.settings.iter().map(reading).collect();
                entry
            })
            .collect();
        output::json(&all)?;
        return Ok(Outcome::Done);
    }
    for (facts, format) in described {
        print(facts)?;
        for setting in format.settings {
            output::line(format!(
                "  reading   {}={} unless given: {}",
                setting.key, setting.default, setting.meaning
            ))?;
            for choice in setting.choices {
                let proxy = if choice.proxy { " (proxy)" } else { "" };
                output::line(format!(
                    "              {}={}{proxy}  {}",
                    setting.key, choice.value, choice.meaning
                ))?;
            }
        }
        output::line("")?;
    }
    output::line("proxy: known to differ from what the paper did; reports say so")?;
    Ok(Outcome::Done)
}

fn print(facts: &Facts) -> anyhow::Result<()> {
    output::line(format!("{}  {}", facts.format, facts.title))?;
    for (what, text) in [
        ("page", facts.page),
        ("terms", facts.terms),
        ("download", facts.download),
        ("size", facts.size),
        ("layout", facts.layout),
        ("feeds", facts.table_column),
        ("unclear", facts.caveat),
    ] {
        if !text.is_empty() {
            output::line(format!("  {what:<9} {text}"))?;
        }
    }
    Ok(())
}

fn reading(setting: &Setting) -> Value {
    let choices = setting.choices.iter();
    json!({
        "key": setting.key,
        "meaning": setting.meaning,
        "default": setting.default,
        "other_values": setting.any,
        "choices": choices
            .map(|c| json!({ "value": c.value, "meaning": c.meaning, "proxy": c.proxy }))
            .collect::<Vec<_>>(),
    })
}
