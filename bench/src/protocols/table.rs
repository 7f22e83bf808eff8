//! The presets. The facts are from reading the original code at the stated commits; no code is copied.

use std::sync::LazyLock;

use toml::Table;

use super::Protocol;

/// All presets; see [`Protocol::named`]. A preset with `like = NAME` in the file inherits all
/// values that it does not set itself from the preset NAME.
pub static PROTOCOLS: LazyLock<Vec<Protocol>> = LazyLock::new(|| {
    let file: Table = include_str!("../../data/protocols.toml")
        .parse()
        .unwrap_or_default();
    let entries = file.get("protocol").and_then(|entries| entries.as_array());
    let mut complete: Vec<Table> = Vec::new();
    for own in entries
        .into_iter()
        .flatten()
        .filter_map(|entry| entry.as_table())
    {
        let like = own.get("like");
        let like = complete
            .iter()
            .find(|other| like.is_some() && other.get("name") == like);
        let mut table = like.cloned().unwrap_or_default();
        table.extend(own.clone());
        table.remove("like");
        complete.push(table);
    }
    complete
        .into_iter()
        .filter_map(|table| table.try_into().ok())
        .collect()
});
