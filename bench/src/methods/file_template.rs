//! Templates for the location of a method's files.

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

use super::method::MethodError;
use crate::pairs::pair_id::{PairName, path_of};

/// A path below the method's folder with placeholders for the names of a pair, such as `{scene}/point_cloud.ply`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct FileTemplate(String);

/// Placeholders; `pair` is the pair's id.
const NAMES: [&str; 5] = ["dataset", "scene", "source", "target", "pair"];

impl FileTemplate {
    /// Parses a template. The error lists the placeholders.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let needed = || {
            let names = NAMES.map(|name| format!("{{{name}}}"));
            format!(
                "file={text}: expected a path below the folder, with placeholders among {}",
                names.join(" ")
            )
        };
        let mut rest = text.to_owned();
        for name in NAMES {
            rest = rest.replace(&format!("{{{name}}}"), "x");
        }
        if is_below(Path::new(&rest)) && !rest.contains(['{', '}']) {
            Ok(Self(text.to_owned()))
        } else {
            Err(needed())
        }
    }

    /// Whether the template contains the placeholder of any of `names`.
    pub(super) fn names(&self, names: &[&str]) -> bool {
        let is_there = |name: &&str| self.0.contains(&format!("{{{name}}}"));
        names.iter().any(is_there)
    }

    pub(super) fn text(&self) -> &str {
        &self.0
    }

    /// Paths in `folder` where the file for `id` (a pair or a source) may be: first with plain names, then with names
    /// encoded as in ids. The files need not exist.
    pub(super) fn candidates(&self, folder: &Path, id: &str) -> Vec<PathBuf> {
        let encoded = path_of(id);
        let plain = if id.contains("__") {
            PairName::decode(id)
        } else {
            // A source's id has no target. Add a dummy `x`, which templates for a source's files do not use.
            PairName::decode(&format!("{id}__x"))
        };
        let mut of_parts = encoded.splitn(3, '/');
        let mut part = || of_parts.next().unwrap_or_default();
        let (dataset, scene, views) = (part(), part(), part());
        let (source, target) = views.split_once("__").unwrap_or((views, ""));
        let by_id = self.filled([dataset, scene, source, target, &encoded]);
        let by_name = plain.ok().map(|name| {
            let PairName {
                dataset,
                scene,
                source,
                target,
            } = &name;
            self.filled([dataset, scene, source, target, &encoded])
        });
        let all = by_name.into_iter().chain([by_id]);
        all.filter(|path| is_below(path))
            .map(|path| folder.join(path))
            .collect()
    }

    /// The first [candidate](Self::candidates) that exists. Otherwise, the error says that `what` is missing, and names
    /// the option `key`, which sets the template.
    pub(super) fn find(
        &self,
        folder: &Path,
        id: &str,
        is_there: impl Fn(&Path) -> bool,
        (what, key): (&str, &str),
    ) -> Result<PathBuf, MethodError> {
        let named = self.candidates(folder, id);
        let found = named.iter().find(|path| is_there(path)).cloned();
        found.ok_or_else(|| {
            let path = named.first().map_or(folder, PathBuf::as_path);
            MethodError::file(path, format!("{what} ({key}={})", self.0))
        })
    }

    fn filled(&self, values: [&str; 5]) -> PathBuf {
        let mut out = String::new();
        let mut rest = self.0.as_str();
        // Replace placeholders in a single pass, so that braces within a substituted name remain.
        while let Some((before, after)) = rest.split_once('{') {
            let (name, after) = after.split_once('}').unwrap_or((after, ""));
            let value = NAMES.iter().position(|known| *known == name);
            out.push_str(before);
            out.push_str(value.map_or("", |place| values[place]));
            rest = after;
        }
        out.push_str(rest);
        out.into()
    }
}

/// Whether a relative path stays below the folder it is joined to.
fn is_below(path: &Path) -> bool {
    let mut parts = path.components();
    parts.clone().next().is_some() && parts.all(|part| matches!(part, Component::Normal(_)))
}

/// Suggests a value for `file=`, as a message: the template that finds the largest number of the pairs' files in the
/// folder. `None` if no template finds any. `extensions` are the extensions of files that the method reads.
pub(super) fn suggestion(
    folder: &Path,
    ids: &BTreeSet<String>,
    extensions: &[&str],
) -> Option<String> {
    const STEMS: [&str; 10] = [
        "{scene}",
        "{source}",
        "{target}",
        "{scene}/{source}",
        "{scene}/{target}",
        "{scene}/{source}__{target}",
        "{dataset}/{scene}",
        "{dataset}/{scene}/{target}",
        "{scene}/point_cloud",
        "{scene}/point_cloud/iteration_30000/point_cloud",
    ];
    let templates = STEMS.into_iter().flat_map(|stem| {
        let named = extensions.iter();
        named.map(move |extension| FileTemplate(format!("{stem}.{extension}")))
    });
    let found = templates.filter_map(|template| {
        let files: Vec<PathBuf> = ids
            .iter()
            .map(|id| template.candidates(folder, id))
            .collect::<Vec<_>>()
            .concat();
        let distinct: BTreeSet<PathBuf> = files.into_iter().collect();
        let there = distinct.iter().filter(|path| path.is_file()).count();
        (there > 0).then_some((there, distinct.len(), template))
    });
    let (there, all, template) = found.max_by_key(|(there, ..)| *there)?;
    Some(format!(
        "none of its files were found; with file={}, {there} of {all} exist",
        template.text()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn templates_name_files_by_names_and_by_encoded_names() {
        let folder = Path::new("dir");
        let template = FileTemplate::parse("{scene}/point_cloud.ply").unwrap();
        let found = template.candidates(folder, "d/my%20scene/a");
        let expected = [
            "dir/my scene/point_cloud.ply",
            "dir/my%20scene/point_cloud.ply",
        ];
        assert_eq!(found, expected.map(PathBuf::from));
        let pair = FileTemplate::parse("{pair}.png").unwrap();
        let found = pair.candidates(folder, "d/s/a__b");
        assert_eq!(found[0], Path::new("dir/d/s/a__b.png"));
        // A scene's name must not lead out of the folder.
        let out = FileTemplate::parse("{scene}/x.ply").unwrap();
        let found = out.candidates(folder, "d/%2E%2E%2Fother/a");
        assert_eq!(found, [Path::new("dir/%2E%2E%2Fother/x.ply")]);
    }

    #[test]
    fn wrong_templates_say_what_is_needed() {
        for text in ["../{scene}.ply", "/{scene}.ply", "{view}.ply", "", "{scene"] {
            let error = FileTemplate::parse(text).unwrap_err();
            assert!(error.contains("{dataset} {scene} {source}"), "{error}");
        }
        let template = FileTemplate::parse("{target}.png").unwrap();
        assert!(template.names(&["source", "target"]) && !template.names(&["pair"]));
    }

    #[test]
    fn the_template_that_finds_most_files_is_suggested() {
        let folder = tempfile::tempdir().unwrap();
        for scene in ["a", "b"] {
            std::fs::write(folder.path().join(format!("{scene}.png")), "").unwrap();
        }
        let ids = BTreeSet::from(["d/a/0__1", "d/a/0__2", "d/b/0__1"].map(str::to_owned));
        let of = |extensions| suggestion(folder.path(), &ids, extensions);
        let found = of(&["png"]).unwrap();
        assert!(
            found.ends_with("with file={scene}.png, 2 of 2 exist"),
            "{found}"
        );
        assert_eq!(of(&["jpg"]), None);
    }
}
