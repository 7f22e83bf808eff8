//! Ways to damage files.

use sharp_tests::mutants::{Random, bomb, mend_checksums, mutate};

use super::case::Case;

/// A damaged file.
pub(crate) struct Spoiled {
    pub(crate) bytes: Vec<u8>,
    pub(crate) how: String,
    /// True if the file's meaning is unchanged, so that numbers must not change.
    pub(crate) harmless: bool,
}

fn spoiled(how: impl Into<String>, bytes: Vec<u8>) -> Spoiled {
    Spoiled {
        bytes,
        how: how.into(),
        harmless: false,
    }
}

const NUMBERS: [&str; 14] = [
    "0",
    "-1",
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e-320",
    "4294967296",
    "99999999999999999999",
    "1e9",
    "x",
    "\"\"",
    "１２",
];

/// Cuts, doubles or re-encodes text, or replaces a number in it.
pub(crate) fn text(bytes: &[u8], random: &mut Random) -> Spoiled {
    let text = String::from_utf8_lossy(bytes).into_owned();
    let lines: Vec<&str> = text.split_inclusive('\n').collect();
    let harmless = |how: &str, text: String| Spoiled {
        harmless: true,
        ..spoiled(how, text.into_bytes())
    };
    match random.below(14) {
        0 => harmless("CRLF", text.replace('\n', "\r\n")),
        1 => harmless("BOM", format!("\u{feff}{text}")),
        2 => harmless("line ends at the end", text.clone() + "\n\n"),
        3 => {
            let keep = random.below(bytes.len().max(1));
            spoiled(format!("cut to {keep} bytes"), bytes[..keep].to_vec())
        }
        4 => {
            let gone = random.below(lines.len().max(1));
            let kept = lines.iter().enumerate().filter(|(at, _)| *at != gone);
            spoiled(
                format!("without line {}", gone + 1),
                kept.map(|(_, line)| *line).collect::<String>().into_bytes(),
            )
        }
        5 => {
            let at = random.below(lines.len().max(1));
            let mut lines = lines.clone();
            lines.insert(at, lines.get(at).copied().unwrap_or("x"));
            spoiled(
                format!("line {} twice", at + 1),
                lines.concat().into_bytes(),
            )
        }
        6 => spoiled(
            "UTF-16",
            text.encode_utf16().flat_map(u16::to_le_bytes).collect(),
        ),
        7 => spoiled("empty", Vec::new()),
        8 => {
            let open = *random.pick(&["[", "{\"a\":", "9", "<a>", " ", "\n"]);
            spoiled(
                format!("100,000 of {open:?} first"),
                (open.repeat(100_000) + &text).into_bytes(),
            )
        }
        9 => spoiled("mutated bytes", mutate(bytes, b"{}", random)),
        _ => {
            let (start, end) = number_in(&text, random);
            let number = *random.pick(&NUMBERS);
            spoiled(
                format!("{number} for {:?} at {start}", &text[start..end]),
                format!("{}{number}{}", &text[..start], &text[end..]).into_bytes(),
            )
        }
    }
}

/// Position of one of the numbers in a text.
fn number_in(text: &str, random: &mut Random) -> (usize, usize) {
    let is_part = |c: char| c.is_ascii_digit() || matches!(c, '.' | '-' | '+' | 'e');
    let mut found = Vec::new();
    let mut start = None;
    for (at, c) in text.char_indices().chain([(text.len(), ' ')]) {
        match (start, is_part(c)) {
            (None, true) => start = Some(at),
            (Some(from), false) => {
                if text[from..at].contains(|c: char| c.is_ascii_digit()) {
                    found.push((from, at));
                }
                start = None;
            }
            _ => {}
        }
    }
    if found.is_empty() {
        (0, 0)
    } else {
        *random.pick(&found)
    }
}

/// Cuts or changes a picture, map or array, or changes its size, or makes it declare far more than
/// it contains.
pub(crate) fn binary(bytes: &[u8], random: &mut Random) -> Spoiled {
    match random.below(10) {
        9 => {
            let said_again = otherwise(bytes);
            Spoiled {
                harmless: said_again.is_some(),
                ..spoiled(
                    "the same, said otherwise",
                    said_again.unwrap_or_else(|| bytes.to_vec()),
                )
            }
        }
        0 => {
            let keep = random.below(bytes.len().max(1));
            spoiled(format!("cut to {keep} bytes"), bytes[..keep].to_vec())
        }
        8 => spoiled("a bomb", bomb()),
        1 => {
            let half = bytes.len() / 2;
            spoiled("cut in half", bytes[..half].to_vec())
        }
        2 => {
            let mut changed = bytes.to_vec();
            let at = random.below(changed.len().max(1));
            let bit = random.below(8);
            if let Some(byte) = changed.get_mut(at) {
                *byte ^= 1 << bit;
            }
            spoiled(format!("bit {bit} of byte {at}"), changed)
        }
        3 => spoiled("empty", Vec::new()),
        4 => spoiled(
            "a page of HTML",
            b"<!DOCTYPE html><html>Not found</html>".to_vec(),
        ),
        5 => spoiled("a header for 60000 x 60000", giant(bytes)),
        6 => spoiled("zeros", vec![0; bytes.len()]),
        _ => spoiled("mutated bytes", mutate(bytes, &[0xFF; 64], random)),
    }
}

/// The same pixels or numbers in another file; `None` if there is no other form here.
fn otherwise(bytes: &[u8]) -> Option<Vec<u8>> {
    match bytes {
        // A chunk of text before the pixels.
        [0x89, b'P', b'N', b'G', ..] if bytes.len() > 33 => {
            let text = b"\0\0\0\x07tEXtA\0hello\0\0\0\0";
            let mut out = [&bytes[..33], text, &bytes[33..]].concat();
            mend_checksums(&mut out);
            Some(out)
        }
        // A comment.
        [0xFF, 0xD8, ..] => Some([&bytes[..2], b"\xFF\xFE\0\x07hello", &bytes[2..]].concat()),
        // The other byte order.
        [b'P', b'f', b'\n', ..] => {
            let ends = bytes.iter().enumerate().filter(|(_, byte)| **byte == b'\n');
            let end = ends.map(|(at, _)| at + 1).nth(2)?;
            let header = std::str::from_utf8(&bytes[..end]).ok()?;
            let (size, scale) = header.trim_end().rsplit_once('\n')?;
            let scale = scale.strip_prefix('-')?;
            let mut out = format!("{size}\n{scale}\n").into_bytes();
            out.extend(bytes[end..].chunks(4).flat_map(|four| four.iter().rev()));
            Some(out)
        }
        // A comment in the header.
        [b'p', b'l', b'y', ..] => {
            let at = bytes.windows(8).position(|w| w == b"\nelement")?;
            Some([&bytes[..at], b"\ncomment hello", &bytes[at..]].concat())
        }
        _ => None,
    }
}

/// The same file with a header that claims 60000 x 60000.
fn giant(bytes: &[u8]) -> Vec<u8> {
    let side = 60_000_u32;
    let mut out = bytes.to_vec();
    match bytes {
        [0x89, b'P', b'N', b'G', ..] if out.len() > 24 => {
            out[16..20].copy_from_slice(&side.to_be_bytes());
            out[20..24].copy_from_slice(&side.to_be_bytes());
            mend_checksums(&mut out);
        }
        [0xFF, 0xD8, ..] => {
            let frame = (0..out.len() - 9)
                .find(|at| out[*at] == 0xFF && matches!(out[at + 1], 0xC0 | 0xC2));
            if let Some(at) = frame {
                out[at + 5..at + 9].copy_from_slice(&[0xEA, 0x60, 0xEA, 0x60]);
            }
        }
        [b'P', b'f' | b'F', ..] => {
            out = [
                &bytes[..2],
                b"\n60000 60000\n-1\n",
                &bytes[bytes.len() / 2..],
            ]
            .concat();
        }
        [0x93, b'N', ..] => {
            let shape = out
                .windows(9)
                .position(|w| w == b"'shape': ")
                .map(|at| at + 9);
            let end =
                shape.and_then(|at| out[at..].iter().position(|b| *b == b')').map(|n| at + n));
            if let (Some(at), Some(end)) = (shape, end) {
                let new = b"(60000,60000".iter().copied();
                // Padding keeps the header's length.
                let length = end - at;
                if length >= 12 || out[end..].iter().take(40).filter(|b| **b == b' ').count() > 12 {
                    out.splice(at..end, new);
                    let spaces = out.windows(12).position(|w| w == b"            ");
                    if let Some(spaces) = spaces {
                        out.drain(spaces..spaces + 12 - length.min(12));
                    }
                }
            }
        }
        [0x76, 0x2F, 0x31, 0x01, ..] => {
            for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
                if let Some(at) = out.windows(name.len()).position(|w| w == name) {
                    let corner = at + name.len() + 4 + 8;
                    if let Some(field) = out.get_mut(corner..corner + 8) {
                        field[..4].copy_from_slice(&(side - 1).to_le_bytes());
                        field[4..].copy_from_slice(&(side - 1).to_le_bytes());
                    }
                }
            }
        }
        _ => {}
    }
    out
}

/// Removes a file of a case, or replaces it by a folder, a link or damaged bytes; returns true if
/// numbers must not change.
pub(crate) fn file(case: &mut Case, name: &str, spoil: fn(&[u8], &mut Random) -> Spoiled) -> bool {
    let path = case.path(name);
    let bytes = std::fs::read(&path).unwrap();
    let short = name.rsplit('/').next().unwrap();
    let remove = || std::fs::remove_file(&path).unwrap();
    let link = |to: &str| std::os::unix::fs::symlink(to, &path).unwrap();
    let how = match case.random.below(20) {
        0 => {
            remove();
            "removed"
        }
        1 => {
            remove();
            std::fs::create_dir(&path).unwrap();
            "a folder"
        }
        2 => {
            remove();
            link("/dev/zero");
            "a link to /dev/zero"
        }
        3 => {
            remove();
            link(short);
            "a link to itself"
        }
        _ => {
            let made = spoil(&bytes, &mut case.random);
            std::fs::write(&path, made.bytes).unwrap();
            case.note(format!("{name}: {}", made.how), short);
            return made.harmless;
        }
    };
    case.note(format!("{name}: {how}"), short);
    false
}
