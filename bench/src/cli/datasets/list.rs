//! `datasets list`: describes the known datasets.

use sharp_datasets::DatasetEntry;
use sharp_datasets::registry::ENTRIES;
use sharp_datasets::setting::{PICTURES, Setting};

use crate::cli::{Outcome, output};
use crate::pairs::frame::Frame;

pub(super) fn execute(json: bool) -> anyhow::Result<Outcome> {
    output::print(json, || ENTRIES, text)?;
    Ok(Outcome::Done)
}

fn text() -> String {
    let mut text = String::new();
    for entry in ENTRIES {
        text += &entry_text(entry);
        text.extend(entry.settings.iter().map(setting_text));
        text += "\n";
    }
    text += "settings of every format with picture files\n";
    text.extend(PICTURES.iter().map(setting_text));
    text += &format!(
        "every format also accepts frame=RULE, which resizes the dataset's views ({}), and pairs.KEY=VALUE, \
         a pair option for this dataset only\n",
        Frame::forms()
    );
    text + "open: a value that the paper does not state; proxy: a value known to differ from the paper; reports mark both"
}

fn setting_text(setting: &Setting) -> String {
    let Setting { key, default, .. } = setting;
    let mut text = format!(
        "  setting   {key}={default} by default: {}\n",
        setting.meaning
    );
    for choice in setting.choices {
        let standing = match (choice.proxy, setting.open) {
            (true, _) => " (proxy)",
            (false, true) => " (open)",
            (false, false) => "",
        };
        let value = choice.value;
        text += &format!(
            "              {key}={value}{standing}  {}\n",
            choice.meaning
        );
    }
    text
}

fn entry_text(entry: &DatasetEntry) -> String {
    let mut all = format!("{}  {}\n", entry.format, entry.title);
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
            all += &format!("  {what:<9} {text}\n");
        }
    }
    all
}
