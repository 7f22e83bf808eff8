//! `datasets list`: describes the known datasets.

use sharp_datasets::DatasetEntry;
use sharp_datasets::registry::ENTRIES;
use sharp_datasets::setting::{PICTURES, Setting};

use crate::cli::{Outcome, output};
use crate::pairs::frame::Frame;

pub(super) fn execute(json: bool) -> anyhow::Result<Outcome> {
    if json {
        output::json(&ENTRIES)?;
        return Ok(Outcome::Done);
    }
    for entry in ENTRIES {
        print(entry)?;
        entry.settings.iter().try_for_each(print_setting)?;
        output::line("")?;
    }
    output::line("settings of every format with picture files")?;
    PICTURES.iter().try_for_each(print_setting)?;
    output::line(format!(
        "every format also accepts frame=RULE, which resizes the dataset's views ({}), and pairs.KEY=VALUE, \
         a pair option for this dataset only",
        Frame::forms()
    ))?;
    output::line(
        "open: the paper does not state the value; proxy: known to differ from the paper; reports \
         mark both",
    )?;
    Ok(Outcome::Done)
}

fn print_setting(setting: &Setting) -> anyhow::Result<()> {
    output::line(format!(
        "  setting   {}={} by default: {}",
        setting.key, setting.default, setting.meaning
    ))?;
    for choice in setting.choices {
        let standing = match (choice.proxy, setting.open) {
            (true, _) => " (proxy)",
            (false, true) => " (open)",
            (false, false) => "",
        };
        output::line(format!(
            "              {}={}{standing}  {}",
            setting.key, choice.value, choice.meaning
        ))?;
    }
    Ok(())
}

fn print(entry: &DatasetEntry) -> anyhow::Result<()> {
    output::line(format!("{}  {}", entry.format, entry.title))?;
    for (what, text) in [
        ("page", entry.page),
        ("terms", entry.terms),
        ("download", entry.download),
        ("size", entry.size),
        ("layout", entry.layout),
        ("feeds", entry.paper_column),
        ("unclear", entry.caveat),
    ] {
        if !text.is_empty() {
            output::line(format!("  {what:<9} {text}"))?;
        }
    }
    Ok(())
}
