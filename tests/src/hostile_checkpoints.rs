//! Checkpoint files that contain false claims, expand excessively or try to run code.

/// Every hostile file with its name. None exceeds 5 MB, and refusing one may not cost much more
/// memory than that.
pub fn all() -> Vec<(&'static str, Vec<u8>)> {
    let ordered = [
        &b"]q\x00("[..],
        &b"NN\x86".repeat(50_000),
        b"e0ccollections\nOrderedDict\nq\x01",
        &b"h\x01h\x00\x85R".repeat(50_000),
    ]
    .concat();
    let tensor = |shape: &str, end: &str| {
        let json = format!(r#"{{"w":{{"dtype":"F32","shape":{shape},"data_offsets":[0,{end}]}}}}"#);
        let mut file = (json.len() as u64).to_le_bytes().to_vec();
        file.extend(json.as_bytes());
        file.extend([0; 4]);
        file
    };
    vec![
        (
            "code",
            older(b"cposix\nsystem\nX\x0b\x00\x00\x00touch pwned\x85R."),
        ),
        (
            "code in a newer pickle",
            zip_of(&[(
                "m/data.pkl",
                Entry::Stored(b"\x80\x04\x8c\x05posix\x8c\x06system\x93\x8c\x0btouch pwned\x85R."),
            )]),
        ),
        (
            "deep nesting",
            older(&[&b")"[..], &[0x85; 4 << 20], b"."].concat()),
        ),
        (
            "long header",
            [&(1_u64 << 40).to_le_bytes()[..], b"{\"a\":1}"].concat(),
        ),
        ("long string", older(b"X\xff\xff\xff\xffabc")),
        ("long list", older(&[&b"]("[..], &[b'N'; 4 << 20]].concat())),
        ("many lists", older(&[b']'; 4 << 20])),
        ("one list in many dicts", older(&ordered)),
        (
            "a tensor beyond the file",
            tensor("[1099511627776]", "4398046511104"),
        ),
        (
            "a shape that overflows",
            tensor("[4294967296,4294967296]", "4"),
        ),
        ("more values than bytes", tensor("[1048576]", "4")),
        (
            "a deflated entry of 4 GiB",
            zip_of(&[(
                "m/data.pkl",
                Entry::Deflated {
                    claims: u32::MAX - 1,
                },
            )]),
        ),
        (
            "a stored entry of 4 GiB",
            zip_of(&[("m/data.pkl", Entry::Claims(u32::MAX - 1))]),
        ),
        (
            "sixty thousand entries where one is",
            claiming_entries(
                zip_of(&[("m/data.pkl", Entry::Stored(b"N."))]),
                u16::MAX - 1,
            ),
        ),
    ]
}

/// Prepends the three pickles that precede the object in PyTorch's older format.
pub fn older(object: &[u8]) -> Vec<u8> {
    let mut out = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.".to_vec();
    out.extend(b"\x80\x02M\xe9\x03.\x80\x02}.");
    out.extend(object);
    out
}

/// The real or claimed content of an entry of a zip file.
enum Entry {
    Stored(&'static [u8]),
    /// Stored, but with a wrong size.
    Claims(u32),
    /// A few compressed bytes that claim this uncompressed size.
    Deflated {
        claims: u32,
    },
}

fn zip_of(entries: &[(&str, Entry)]) -> Vec<u8> {
    let (mut file, mut directory) = (Vec::new(), Vec::new());
    for (name, entry) in entries {
        let (method, bytes, packed, size): (u16, &[u8], u32, u32) = match entry {
            Entry::Stored(bytes) => (0, bytes, bytes.len() as u32, bytes.len() as u32),
            Entry::Claims(size) => (0, b"N.", *size, *size),
            Entry::Deflated { claims } => (8, b"\xed\xc1\x01\x01", 4, *claims),
        };
        let start = file.len() as u32;
        let mut fields = method.to_le_bytes().to_vec();
        // Time, date and checksum, which are never read.
        fields.extend([0; 8]);
        fields.extend(packed.to_le_bytes());
        fields.extend(size.to_le_bytes());
        fields.extend((name.len() as u16).to_le_bytes());
        fields.extend([0; 2]);
        file.extend(b"PK\x03\x04\x14\0\0\0");
        file.extend(&fields);
        file.extend(name.as_bytes());
        file.extend(bytes);
        directory.extend(b"PK\x01\x02\x14\0\x14\0\0\0");
        directory.extend(&fields);
        directory.extend([0; 10]);
        directory.extend(start.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let (start, count) = (file.len() as u32, entries.len() as u16);
    file.extend(&directory);
    file.extend(b"PK\x05\x06\0\0\0\0");
    file.extend(count.to_le_bytes());
    file.extend(count.to_le_bytes());
    file.extend((directory.len() as u32).to_le_bytes());
    file.extend(start.to_le_bytes());
    file.extend([0; 2]);
    file
}

/// The same zip file with another number of entries in its end record.
fn claiming_entries(mut file: Vec<u8>, count: u16) -> Vec<u8> {
    let at = file.len() - 14;
    file[at..at + 2].copy_from_slice(&count.to_le_bytes());
    file[at + 2..at + 4].copy_from_slice(&count.to_le_bytes());
    file
}
