//! A list of ours in someone's form.

use std::collections::BTreeMap;

use super::ListForm;
use super::forms::{Content, Flash3dRow, Index, IndexEntry, ManifestLine, SevaSplit};
use crate::pairs::pair_list::ResolvedPair;

/// The pairs in a form, scenes by their ids in the order of the pairs. Positions count the scene's views from 0.
///
/// # Errors
/// The bare reason: the form cannot hold these pairs.
pub fn written(pairs: &[ResolvedPair<'_>], form: ListForm) -> Result<Vec<u8>, String> {
    let mut scenes: BTreeMap<&str, Vec<(u32, u32)>> = BTreeMap::new();
    for pair in pairs {
        let at = |id: &str| {
            let place = pair.scene.views.iter().position(|view| view.id == id);
            place.unwrap_or_default() as u32
        };
        let places = (at(&pair.source.id), at(&pair.target.id));
        scenes.entry(&pair.scene.id).or_default().push(places);
    }
    let of_one_source = |scene: &str, places: &[(u32, u32)]| {
        let source = places.first().map_or(0, |(source, _)| *source);
        match places.iter().all(|(other, _)| *other == source) {
            true => Ok((source, places.iter().map(|(_, target)| *target).collect())),
            false => Err(format!(
                "scene '{scene}' has pairs of several sources, and this form one entry a scene: --form unisharp or flash3d \
                 holds them"
            )),
        }
    };
    let content = match form {
        ListForm::Index => {
            let entries = scenes.iter().map(|(scene, places)| {
                let (source, mut target): (u32, Vec<u32>) = of_one_source(scene, places)?;
                target.sort_unstable();
                let context = vec![source];
                Ok(((*scene).to_owned(), Some(IndexEntry { context, target })))
            });
            Content::Index(Index(entries.collect::<Result<_, String>>()?))
        }
        ListForm::Seva => {
            let mut all = scenes.iter();
            let (Some((scene, places)), None) = (all.next(), all.next()) else {
                return Err(format!(
                    "a split is of one scene, and the list has {}: --scenes chooses",
                    scenes.len()
                ));
            };
            let (source, mut test_ids): (u32, Vec<u32>) = of_one_source(scene, places)?;
            test_ids.sort_unstable();
            Content::Seva(SevaSplit {
                train_ids: vec![source],
                test_ids,
            })
        }
        ListForm::Flash3d => {
            let rows = scenes.iter().flat_map(|(scene, places)| {
                places.iter().map(|&(source, target)| Flash3dRow {
                    key: (*scene).to_owned(),
                    source,
                    targets: [target; 3],
                })
            });
            let rows: Vec<Flash3dRow> = rows.collect();
            if let Some(row) = rows.iter().find(|row| row.key.contains(' ')) {
                return Err(format!(
                    "scene '{}' has a space, which ends a field",
                    row.key
                ));
            }
            Content::Flash3d(rows)
        }
        ListForm::Unisharp => {
            let mut lines: Vec<ManifestLine> = Vec::new();
            for pair in pairs {
                let names = [&pair.scene.id, &pair.source.id, &pair.target.id];
                if let Some(name) = names.iter().find(|name| name.contains(['|', ',', '\n'])) {
                    return Err(format!("'{name}' holds a character that ends a field"));
                }
                let fields = vec![pair.scene.id.clone()];
                let (source, target) = (&pair.source.id, pair.target.id.clone());
                match lines.last_mut() {
                    Some(line) if line.fields == fields && line.source == *source => {
                        line.targets.push(target);
                    }
                    _ => lines.push(ManifestLine {
                        fields,
                        source: source.clone(),
                        targets: vec![target],
                    }),
                }
            }
            Content::Unisharp(lines)
        }
        ListForm::Mine => {
            return Err(
                "MINE's form holds time stamps and three targets a source, which pairs of ours do not have"
                    .to_owned(),
            );
        }
    };
    Ok(content.bytes())
}
