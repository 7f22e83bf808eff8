//! Seeded changes of bytes, for parsers and for the whole product.

/// A few random changes, mostly near the beginning, where headers are.
pub fn mutate(seed: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    const NUMBERS: [&[u8]; 8] = [
        b"0",
        b"-1",
        b"1e308",
        b"nan",
        b"4294967295",
        b"18446744073709551615",
        b".",
        b"[",
    ];
    let mut bytes = seed.to_vec();
    for _ in 0..=random.below(6) {
        let span = if random.below(3) == 0 {
            bytes.len()
        } else {
            bytes.len().min(160)
        };
        let at = random.below(span.max(1)).min(bytes.len());
        match random.below(9) {
            0 if !bytes.is_empty() => bytes.truncate(at),
            1 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            2 if at < bytes.len() => bytes[at] = [0, 1, 0x7F, 0x80, 0xFF][random.below(5)],
            3 => {
                let end = (at + random.below(16)).min(bytes.len());
                bytes.drain(at..end);
            }
            4 => {
                let number = NUMBERS[random.below(NUMBERS.len())];
                bytes.splice(at..at, number.iter().copied());
            }
            5 => {
                let end = (at + random.below(24)).min(bytes.len());
                let copied = bytes[at..end].to_vec();
                bytes.splice(at..at, copied);
            }
            6 => {
                for (i, b) in u64::MAX
                    .to_le_bytes()
                    .iter()
                    .take(1 + random.below(8))
                    .enumerate()
                {
                    if let Some(byte) = bytes.get_mut(at + i) {
                        *byte = *b;
                    }
                }
            }
            7 if !other.is_empty() => {
                let from = random.below(other.len());
                let end = (from + random.below(64)).min(other.len());
                bytes.splice(at..at, other[from..end].iter().copied());
            }
            _ if at < bytes.len() => bytes[at] = random.below(256) as u8,
            _ => bytes.push(random.below(256) as u8),
        }
    }
    if random.below(4) > 0 {
        mend_checksums(&mut bytes);
    }
    bytes
}

/// Corrects the checksums of a PNG's chunks, so that mutants pass this check.
pub fn mend_checksums(bytes: &mut [u8]) {
    if !bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        return;
    }
    let mut at = 8;
    while let Some(length) = bytes.get(at..at + 4) {
        let length = u32::from_be_bytes([length[0], length[1], length[2], length[3]]) as usize;
        let end = at + 8 + length;
        let Some(checked) = bytes.get(at + 4..end) else {
            return;
        };
        let crc = !checked.iter().fold(u32::MAX, |mut crc, byte| {
            crc ^= u32::from(*byte);
            for _ in 0..8 {
                crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
            }
            crc
        });
        let Some(stored) = bytes.get_mut(end..end + 4) else {
            return;
        };
        stored.copy_from_slice(&crc.to_be_bytes());
        at = end + 4;
    }
}

/// A PNG of 20000 x 20000 black pixels of one bit, in 320 kB.
pub fn bomb() -> Vec<u8> {
    const SIDE: u32 = 20_000;
    let bytes = u64::from(SIDE) * u64::from(SIDE / 8 + 1);
    // Deflate with fixed codes: a zero, then runs that repeat the previous byte 258 times, until
    // all bytes are written.
    let (mut packed, mut bits, mut held) = (vec![0x78, 0x01], 0_u64, 0);
    let mut put = |code: u64, length: u32| {
        bits |= code << held;
        held += length;
        while held >= 8 {
            packed.push(bits as u8);
            bits >>= 8;
            held -= 8;
        }
    };
    put(0b011, 3);
    let literal = |put: &mut dyn FnMut(u64, u32)| put(0b0000_1100, 8);
    literal(&mut put);
    let mut left = bytes - 1;
    while left >= 258 {
        put(0b1010_0011, 8);
        put(0, 5);
        left -= 258;
    }
    for _ in 0..left {
        literal(&mut put);
    }
    put(0, 7);
    put(0, 7);
    packed.extend(((bytes % 65_521) << 16 | 1).to_be_bytes()[4..].iter());
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR".to_vec();
    png.extend(SIDE.to_be_bytes());
    png.extend(SIDE.to_be_bytes());
    png.extend([1, 0, 0, 0, 0, 0, 0, 0, 0]);
    for (name, data) in [(b"IDAT", packed), (b"IEND", Vec::new())] {
        png.extend((data.len() as u32).to_be_bytes());
        png.extend(name);
        png.extend(data);
        png.extend([0; 4]);
    }
    mend_checksums(&mut png);
    png
}

/// A small generator with permanently reproducible numbers: splitmix64.
#[derive(Debug)]
pub struct Random(u64);

impl Random {
    /// The sequence for a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// A number in `0..n`; `n` is not 0.
    pub fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) % n as u64) as usize
    }

    /// A random element.
    pub fn pick<'a, T>(&mut self, things: &'a [T]) -> &'a T {
        &things[self.below(things.len())]
    }
}
