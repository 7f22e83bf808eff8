//! The log of a program's standard error. The middle of a long log is cut out.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Number of bytes kept at each end of a long log.
const KEPT: u64 = 2 << 20;

/// Size at which a log is cut, in bytes: twice as much as is kept, so that cuts are rare.
const LONGEST: u64 = 4 * KEPT;

/// An append-only log file of at most [`LONGEST`] bytes.
#[derive(Debug)]
pub(super) struct ProgramLog {
    file: File,
    len: u64,
    /// Number of bytes cut out since the log was opened.
    cut: u64,
    /// Length of the line that reports the cut, directly after the kept beginning.
    note: u64,
}

impl ProgramLog {
    /// Opens a log, creating it and its folder if needed.
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        let mut options = OpenOptions::new();
        let file = options.create(true).read(true).append(true).open(path)?;
        Ok(Self {
            len: file.metadata()?.len(),
            file,
            cut: 0,
            note: 0,
        })
    }

    pub(super) fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(bytes)?;
        self.len += bytes.len() as u64;
        if self.len > LONGEST {
            self.leave_out_the_middle()
        } else {
            Ok(())
        }
    }

    fn leave_out_the_middle(&mut self) -> io::Result<()> {
        let mut end = Vec::new();
        self.file.seek(SeekFrom::Start(self.len - KEPT))?;
        (&self.file).take(KEPT).read_to_end(&mut end)?;
        // Keep whole lines at the end, unless the first of them is too long.
        let start = end.iter().take(1 << 16).position(|byte| *byte == b'\n');
        let end = &end[start.map_or(0, |at| at + 1)..];
        self.cut += self.len - KEPT - self.note - end.len() as u64;
        let note = format!("\n== at least {} bytes left out here ==\n", self.cut);
        self.file.set_len(KEPT)?;
        self.file.write_all(note.as_bytes())?;
        self.file.write_all(end)?;
        self.note = note.len() as u64;
        self.len = KEPT + self.note + end.len() as u64;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_leaves_both_its_ends_and_how_much_was_between() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("logs/mine.log");
        let mut log = ProgramLog::open(&path).unwrap();
        let lines: u64 = 300_000;
        for i in 0..lines {
            log.write(format!("{i:99}\n").as_bytes()).unwrap();
        }
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.len() as u64 <= LONGEST + 100);
        let kept: Vec<u64> = text
            .lines()
            .filter_map(|line| line.trim().parse().ok())
            .collect();
        assert_eq!((kept[0], kept[kept.len() - 1]), (0, lines - 1));
        let after = kept
            .windows(2)
            .position(|two| two[1] != two[0] + 1)
            .unwrap()
            + 1;
        assert_eq!(after as u64, KEPT / 100);
        assert!((kept.len() - after) as u64 >= KEPT / 100 - 1);
        // All bytes outside the kept parts and the note were cut; the first part may end within a
        // line.
        let note = text.lines().find(|line| line.starts_with("==")).unwrap();
        let cut = lines * 100 - (text.len() - note.len() - 2) as u64;
        assert_eq!(note, format!("== at least {cut} bytes left out here =="));

        drop(log);
        let mut again = ProgramLog::open(&path).unwrap();
        for _ in 0..4 * KEPT / 6000 {
            again.write("again\n".repeat(1000).as_bytes()).unwrap();
        }
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.len() as u64 <= LONGEST + 100 && text.ends_with("again\n"));
        assert!(text.trim_start().starts_with('0') && text.matches("==\n").count() == 1);
    }
}
