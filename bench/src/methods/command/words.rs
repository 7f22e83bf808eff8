//! Finds the files named in a shell command.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

/// Files named in a command line.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct NamedFiles {
    /// Existing files, including matches of patterns and sources of Python modules (`-m`).
    pub(super) found: Vec<PathBuf>,
    /// Words that look like files but do not exist.
    pub(super) absent: Vec<String>,
    /// Words that may stand for further files (folders, command substitutions, braces). These files are not hashed.
    pub(super) unseen: Vec<String>,
}

/// Extensions that mark a word as a file name even if no such file exists.
const ENDINGS: [&str; 19] = [
    "bin",
    "cfg",
    "ckpt",
    "h5",
    "ini",
    "json",
    "npy",
    "npz",
    "onnx",
    "pickle",
    "pkl",
    "pt",
    "pth",
    "py",
    "safetensors",
    "sh",
    "toml",
    "yaml",
    "yml",
];

/// Looks up every word of `line`, including values after `--option=` and `NAME=`. Resolves quotes and variables, and
/// takes paths as relative to `folder` and to the folders that `cd` enters. Words that only the shell can expand
/// (`$(…)`, braces) are returned as unseen.
pub(super) fn named_files(
    line: &str,
    folder: &Path,
    variable: &dyn Fn(&str) -> Option<String>,
) -> NamedFiles {
    let mut named = NamedFiles::default();
    let mut folder = folder.to_owned();
    let mut words = words(line, variable).into_iter().peekable();
    let (mut is_first, mut is_module) = (true, false);
    while let Some(word) = words.next() {
        let Word::Text {
            text,
            is_whole,
            is_opaque,
        } = word
        else {
            is_first = true;
            continue;
        };
        if is_first && text == "cd" {
            if let Some(Word::Text { text, .. }) = words.next_if(|word| *word != Word::Operator) {
                folder.push(text);
            }
            continue;
        }
        // Assignments may precede the command's name.
        is_first &= is_assignment(&text);
        if std::mem::replace(&mut is_module, text == "-m") {
            let module = folder.join(text.replace('.', "/"));
            let files = std::fs::read_dir(&module).into_iter().flatten().flatten();
            let files = files
                .map(|entry| entry.path())
                .chain([module.with_extension("py")]);
            let is_source =
                |path: &PathBuf| path.is_file() && path.extension().is_some_and(|e| e == "py");
            named.found.extend(files.filter(is_source));
            continue;
        }
        let value = text.split_once('=').map(|(_, value)| value.to_owned());
        let candidates: Vec<String> = std::iter::once(text).chain(value).collect();
        let paths = candidates.iter().map(|candidate| folder.join(candidate));
        let is_there = |path: &PathBuf| path.exists();
        match paths.clone().find(is_there) {
            Some(path) if path.is_file() => named.found.push(path),
            // `.` and `..` are working directories, not inputs.
            Some(path) if !is_first && candidates.iter().all(|text| has_name(text)) => {
                if holds_files(&path) {
                    named.unseen.push(path.display().to_string());
                }
            }
            Some(_) => {}
            None if is_opaque => named.unseen.push("$(…)".to_owned()),
            None if candidates[0].contains(['*', '?', '[']) => {
                let matched = paths
                    .clone()
                    .filter_map(|path| super::matching(path.to_str()?).ok());
                named.found.extend(matched.flatten());
            }
            None if candidates[0].contains('{')
                && candidates.iter().any(|text| has_ending(text, &ENDINGS)) =>
            {
                named.unseen.extend(candidates.first().cloned());
            }
            None => {
                let likely = candidates
                    .iter()
                    .rev()
                    .find(|text| !is_whole || looks_like_a_file(text));
                named.absent.extend(likely.cloned());
            }
        }
    }
    named.found.sort();
    named.found.dedup();
    add_imports(&mut named.found);
    named
}

/// Adds the Python modules that the scripts in `found` import from their own folders, and what these modules import.
fn add_imports(found: &mut Vec<PathBuf>) {
    let is_script = |path: &&PathBuf| path.extension().is_some_and(|e| e == "py");
    let mut open: Vec<PathBuf> = found.iter().filter(is_script).cloned().collect();
    // Search for modules next to each script, and for modules of a package next to its other modules.
    let mut roots: BTreeSet<PathBuf> = open.iter().map(|path| folder_of(path)).collect();
    while let Some(path) = open.pop() {
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        roots.insert(folder_of(&path));
        for name in imported(&text) {
            for root in &roots {
                let module = root.join(name.replace('.', "/"));
                let files = [module.with_extension("py"), module.join("__init__.py")];
                for file in files.into_iter().filter(|file| file.is_file()) {
                    if !found.contains(&file) {
                        found.push(file.clone());
                        open.push(file);
                    }
                }
            }
        }
    }
    found.sort();
}

fn folder_of(path: &Path) -> PathBuf {
    path.parent().unwrap_or(Path::new("")).to_owned()
}

/// The modules in the `import` and `from` lines of a Python source, including every parent package.
fn imported(text: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for line in text.lines().map(str::trim_start) {
        let line = line.split('#').next().unwrap_or_default();
        let modules: Vec<String> = if let Some(list) = line.strip_prefix("import ") {
            let first = |name: &str| name.split_whitespace().next().map(str::to_owned);
            list.split(',').filter_map(first).collect()
        } else if let Some((module, list)) = line
            .strip_prefix("from ")
            .and_then(|rest| rest.split_once(" import "))
        {
            let module = module.trim().trim_start_matches('.');
            let of_list = list.split(',').filter_map(|name| {
                let name = name
                    .trim_matches(['(', ')', ' '])
                    .split_whitespace()
                    .next()?;
                Some(format!("{module}.{name}"))
            });
            of_list.chain([module.to_owned()]).collect()
        } else {
            continue;
        };
        for module in modules {
            let module = module.trim_matches('.');
            let ends = module.match_indices('.').map(|(at, _)| at);
            names.extend(
                ends.chain([module.len()])
                    .map(|end| module[..end].to_owned()),
            );
        }
    }
    names.retain(|name| !name.is_empty());
    names
}

fn is_assignment(text: &str) -> bool {
    let name = text.split_once('=').map(|(name, _)| name);
    name.is_some_and(|name| !name.is_empty() && name.chars().all(is_name))
}

fn has_ending(text: &str, endings: &[&str]) -> bool {
    let ending = Path::new(text)
        .extension()
        .and_then(|ending| ending.to_str());
    ending.is_some_and(|ending| endings.contains(&ending))
}

fn has_name(path: &str) -> bool {
    let mut parts = Path::new(path).components();
    parts.any(|part| matches!(part, Component::Normal(_)))
}

fn holds_files(folder: &Path) -> bool {
    let mut entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.any(|entry| entry.path().is_file())
}

fn looks_like_a_file(text: &str) -> bool {
    let is_path = ["/", "./", "../", "~/"]
        .iter()
        .any(|start| text.starts_with(start));
    let is_pattern = text.contains(['*', '?', '$', '`', '(', '{']) || text.contains("://");
    !is_pattern && (is_path || has_ending(text, &ENDINGS))
}

#[derive(Debug, PartialEq, Eq)]
enum Word {
    Text {
        text: String,
        /// False if one of the word's variables has no value.
        is_whole: bool,
        /// Whether the word contains a command substitution.
        is_opaque: bool,
    },
    /// The end of a command: `&&`, `|`, `;`, a newline.
    Operator,
}

/// Splits a command line as a POSIX shell does, without expanding command substitutions and patterns.
fn words(line: &str, variable: &dyn Fn(&str) -> Option<String>) -> Vec<Word> {
    let mut found = Vec::new();
    let (mut text, mut is_open, mut is_whole) = (String::new(), false, true);
    let (mut quote, mut is_first, mut is_opaque) = (None, true, false);
    let mut own: BTreeMap<String, String> = BTreeMap::new();
    let mut letters = line.chars().peekable();
    while let Some(letter) = letters.next() {
        match (quote, letter) {
            (Some(open), letter) if letter == open => quote = None,
            (Some('\''), letter) => text.push(letter),
            (None, '\'' | '"') => (quote, is_open) = (Some(letter), true),
            (_, '\\') => {
                text.extend(letters.next());
                is_open = true;
            }
            (_, '`') => (is_open, is_opaque) = (true, true),
            (_, '$') if letters.peek() == Some(&'(') => (is_open, is_opaque) = (true, true),
            (_, '$')
                if letters
                    .peek()
                    .is_some_and(|next| is_name(*next) || *next == '{') =>
            {
                let braced = letters.next_if_eq(&'{').is_some();
                let name: String =
                    std::iter::from_fn(|| letters.next_if(|next| is_name(*next))).collect();
                if braced {
                    letters.next_if_eq(&'}');
                }
                match own.get(&name).cloned().or_else(|| variable(&name)) {
                    Some(value) => text.push_str(&value),
                    None => {
                        text.push('$');
                        text.push_str(&name);
                        is_whole = false;
                    }
                }
                is_open = true;
            }
            (None, '~') if !is_open && letters.peek().is_none_or(|next| *next == '/') => {
                match variable("HOME") {
                    Some(home) => text.push_str(&home),
                    None => is_whole = false,
                }
                is_open = true;
            }
            (None, letter)
                if letter.is_whitespace()
                    || ['&', '|', ';', '(', ')', '<', '>'].contains(&letter) =>
            {
                if std::mem::take(&mut is_open) {
                    let text = std::mem::take(&mut text);
                    is_first &= is_assignment(&text);
                    if is_first && let Some((name, value)) = text.split_once('=') {
                        own.insert(name.to_owned(), value.to_owned());
                    }
                    found.push(Word::Text {
                        text,
                        is_whole,
                        is_opaque,
                    });
                    (is_whole, is_opaque) = (true, false);
                }
                if ['&', '|', ';', '(', '\n'].contains(&letter) {
                    found.push(Word::Operator);
                    is_first = true;
                }
            }
            (_, letter) => {
                text.push(letter);
                is_open = true;
            }
        }
    }
    if is_open {
        found.push(Word::Text {
            text,
            is_whole,
            is_opaque,
        });
    }
    found
}

fn is_name(letter: char) -> bool {
    letter == '_' || letter.is_ascii_alphanumeric()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_found_however_they_are_written() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path().canonicalize().unwrap();
        std::fs::create_dir_all(root.join("a b")).unwrap();
        for name in ["my.py", "w.txt", "a b/w.txt"] {
            std::fs::write(root.join(name), "x").unwrap();
        }
        let at = root.display();
        let variable = |name: &str| match name {
            "V" | "HOME" => Some(at.to_string()),
            _ => None,
        };
        let found = |line: &str| {
            let named = named_files(line, Path::new(""), &variable);
            assert_eq!(named.absent, Vec::<String>::new(), "{line}");
            let names = named.found.iter().map(|path| path.canonicalize().unwrap());
            let names = names.map(|path| path.strip_prefix(&root).unwrap().display().to_string());
            names.collect::<Vec<_>>()
        };
        for line in [
            format!("python3 {at}/my.py {at}/w.txt"),
            format!("python3 {at}/my.py --weights={at}/w.txt --fast"),
            format!("cd {at}&&python3 my.py w.txt; cd 'a b'"),
            format!("cd \"{at}/a b\" && W=../w.txt python3 ../my.py | cat"),
            "python3 $V/my.py ${V}/w.txt -m some.module 0.5 org/model".to_owned(),
            "python3 ~/my.py ~/w.txt 2>&1 https://x.org/w.pt *.json".to_owned(),
        ] {
            assert_eq!(found(&line), ["my.py", "w.txt"], "{line}");
        }
        assert_eq!(
            found(&format!("cat '{at}/a b/w.txt' {at}/a\\ b")),
            ["a b/w.txt"]
        );
    }

    #[test]
    fn modules_beside_a_script_are_files_of_it() {
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        write(
            "m.py",
            "import os, helper as h\nfrom net.model import (Net, other)\nfrom net import heads  # x\n",
        );
        write("helper.py", "def f():\n    from . import deep\n");
        write("deep.py", "import helper\n");
        write("net/__init__.py", "");
        write("net/model.py", "import helper\n");
        write("net/heads.py", "");
        write("unused.py", "");
        let line = format!("python3 {}/m.py", dir.path().display());
        let found = named_files(&line, Path::new(""), &|_| None).found;
        let names = found
            .iter()
            .map(|path| path.strip_prefix(dir.path()).unwrap());
        let names: Vec<_> = names.map(|path| path.display().to_string()).collect();
        let expected = [
            "deep.py",
            "helper.py",
            "m.py",
            "net/__init__.py",
            "net/heads.py",
            "net/model.py",
        ];
        assert_eq!(names, expected);
    }

    #[test]
    fn what_looks_like_a_file_and_is_not_there_is_named() {
        let absent = |line: &str| named_files(line, Path::new(""), &|_| None).absent;
        assert_eq!(
            absent("run --weights=gone.pt ./model $UNSET/w --n=3 -x"),
            ["gone.pt", "./model", "$UNSET/w"]
        );
        let unseen = |line: &str| named_files(line, Path::new(""), &|_| None).unseen;
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("a.bin"), "x").unwrap();
        let weights = dir.path().display().to_string();
        for line in [
            "run W",
            "run --weights=W",
            "run $(ls W/*)",
            "run `ls`",
            "run W/{a,b}.bin",
        ] {
            let line = line.replace('W', &weights);
            assert_eq!(unseen(&line).len(), 1, "{line}");
        }
        for line in [
            "run .",
            "run '{\"a\": 1}'",
            "awk '{print $1}'",
            "run .. --lr {0}",
        ] {
            assert_eq!(unseen(line), Vec::<String>::new(), "{line}");
        }
        assert_eq!(
            absent("python3 -m pkg.mod --lr 0.1 'two words' a=b $(cat x.json)"),
            ["x.json"]
        );
    }
}
