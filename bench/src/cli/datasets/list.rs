//! `datasets list`: describes the known datasets.

use std::fmt::{self, Display, Formatter};

use serde::Serialize;
use sharp_datasets::DatasetEntry;
use sharp_datasets::registry::ENTRIES;
use sharp_datasets::setting::{PICTURES, Setting};

use crate::cli::{Outcome, output};
use crate::pairs::frame::Frame;

pub(super) fn execute(json: bool) -> anyhow::Result<Outcome> {
    output::print(&Formats(&ENTRIES), json)?;
    Ok(Outcome::Done)
}

#[derive(Serialize)]
struct Formats(&'static [&'static DatasetEntry]);

impl Display for Formats {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for entry in self.0 {
            write_entry(f, entry)?;
            entry
                .settings
                .iter()
                .try_for_each(|setting| write_setting(f, setting))?;
            writeln!(f)?;
        }
        writeln!(f, "settings of every format with picture files")?;
        PICTURES
            .iter()
            .try_for_each(|setting| write_setting(f, setting))?;
        writeln!(
            f,
            "every format also accepts frame=RULE, which resizes the dataset's views ({}), and pairs.KEY=VALUE, \
             a pair option for this dataset only",
            Frame::forms()
        )?;
        f.write_str(
            "open: a value that the paper does not state; proxy: a value known to differ from the paper; reports mark both",
        )
    }
}

fn write_setting(f: &mut Formatter<'_>, setting: &Setting) -> fmt::Result {
    writeln!(
        f,
        "  setting   {}={} by default: {}",
        setting.key, setting.default, setting.meaning
    )?;
    for choice in setting.choices {
        let standing = match (choice.proxy, setting.open) {
            (true, _) => " (proxy)",
            (false, true) => " (open)",
            (false, false) => "",
        };
        writeln!(
            f,
            "              {}={}{standing}  {}",
            setting.key, choice.value, choice.meaning
        )?;
    }
    Ok(())
}

fn write_entry(f: &mut Formatter<'_>, entry: &DatasetEntry) -> fmt::Result {
    writeln!(f, "{}  {}", entry.format, entry.title)?;
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
            writeln!(f, "  {what:<9} {text}")?;
        }
    }
    Ok(())
}
