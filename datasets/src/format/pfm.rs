//! Portable float maps as used by Middlebury. Rows are stored bottom to top; +inf marks an unknown disparity. The sign
//! of the scale gives the byte order; the scale's magnitude is ignored.

use std::path::Path;

use super::{FloatMap, FormatError, is_byte_swapped};
use crate::DatasetError;

/// Reads a `Pf` file, or a `PF` file whose three channels are equal. Values are returned as stored, top row first;
/// bytes after the last value are ignored.
///
/// # Errors
/// If the header is invalid, there are fewer bytes than it requires, or the three channels differ.
pub fn parse(bytes: &[u8]) -> Result<FloatMap, FormatError> {
    let mut header = PfmHeader { bytes, at: 0 };
    let channels: usize = match header.token().as_deref() {
        Some("Pf") => 1,
        Some("PF") => 3,
        None => return Err("the file is empty".into()),
        Some(other) => {
            return Err(invalid!(
                "not a PFM file: it starts with '{}' instead of 'Pf' or 'PF'",
                other.chars().take(16).collect::<String>()
            ));
        }
    };
    let width: u32 = header.number("width")?;
    let height: u32 = header.number("height")?;
    let scale: f64 = header.number("scale")?;
    if width == 0 || height == 0 {
        return Err(invalid!("the map is {width}x{height}, so it has no pixels"));
    }
    if scale == 0.0 || !scale.is_finite() {
        return Err(invalid!(
            "the scale is {scale}, but it must be finite and non-zero, because its sign gives the byte order"
        ));
    }

    let values = u64::from(width) * u64::from(height) * channels as u64;
    let needed = values.checked_mul(4).and_then(|n| usize::try_from(n).ok());
    let data = header.data(needed);
    let Some(data) = needed.and_then(|needed| data.get(..needed)) else {
        return Err(FormatError::Truncated {
            what: format!("a {width}x{height} map of {channels} channel(s)"),
            needed: u128::from(values) * 4,
            available: data.len(),
        });
    };
    let read = if scale < 0.0 {
        f32::from_le_bytes
    } else {
        f32::from_be_bytes
    };
    let stored: Vec<f32> = data
        .chunks_exact(4)
        .map(|b| read([b[0], b[1], b[2], b[3]]))
        .collect();
    if is_byte_swapped(&stored) {
        let (said, other) = if scale < 0.0 {
            ("little", "big")
        } else {
            ("big", "little")
        };
        return Err(invalid!(
            "its scale {scale} says that it is {said}-endian, but its values are sensible only as {other}-endian; write \
             the scale {} into the header",
            -scale
        ));
    }
    let row = width as usize * channels;
    let mut map = FloatMap::new(width, height);
    for (into, from) in map
        .chunks_exact_mut(width as usize)
        .zip(stored.chunks_exact(row).rev())
    {
        for (value, pixel) in into.iter_mut().zip(from.chunks_exact(channels)) {
            if pixel.iter().any(|c| c.to_bits() != pixel[0].to_bits()) {
                return Err(
                    "the three channels differ, so this is a colour map, not a depth or \
                            disparity map"
                        .into(),
                );
            }
            *value = pixel[0];
        }
    }
    Ok(map)
}

/// Writes a one-channel little-endian PFM file.
///
/// # Errors
/// If the file cannot be written.
pub fn write(path: &Path, map: &FloatMap) -> Result<(), DatasetError> {
    std::fs::write(path, bytes(map)).map_err(|e| DatasetError::io(path, e))
}

/// Contents of a one-channel little-endian PFM file.
pub fn bytes(map: &FloatMap) -> Vec<u8> {
    let mut bytes = format!("Pf\n{} {}\n-1\n", map.width(), map.height()).into_bytes();
    for row in map.chunks_exact(map.width().max(1) as usize).rev() {
        bytes.extend(row.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}

struct PfmHeader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> PfmHeader<'a> {
    /// The next run of printable characters, skipping white space and `#` comments.
    fn token(&mut self) -> Option<String> {
        loop {
            match self.bytes.get(self.at)? {
                c if c.is_ascii_whitespace() => self.at += 1,
                b'#' => {
                    while *self.bytes.get(self.at)? != b'\n' {
                        self.at += 1;
                    }
                }
                _ => break,
            }
        }
        let rest = &self.bytes[self.at..];
        // Numbers are short, so a longer run is not part of a header.
        let end = rest
            .iter()
            .take(64)
            .position(u8::is_ascii_whitespace)
            .unwrap_or(rest.len().min(64));
        self.at += end;
        Some(String::from_utf8_lossy(&rest[..end]).into_owned())
    }

    fn number<T: std::str::FromStr>(&mut self, what: &str) -> Result<T, FormatError> {
        let token = self
            .token()
            .ok_or_else(|| invalid!("the header ends before the {what}"))?;
        token
            .parse()
            .map_err(|_| invalid!("the {what} in the header is not valid: '{token}'"))
    }

    /// The data after the header, which ends with one byte of white space or with CR LF. The number of bytes needed
    /// reveals whether a lone CR ends the header and the first data byte happens to be LF.
    fn data(&self, needed: Option<usize>) -> &'a [u8] {
        let rest = &self.bytes[self.at..];
        let after_cr = rest.len().saturating_sub(1);
        if rest.starts_with(b"\r\n") && needed != Some(after_cr) {
            &rest[2..]
        } else {
            rest.get(1..).unwrap_or_default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_every_make_are_read() {
        let rows: Vec<u8> = [4.5_f32, 6.0, 1.0, 2.0]
            .iter()
            .flat_map(|v| v.to_be_bytes())
            .collect();
        for header in [
            "Pf\n2 2\n1\n",
            "Pf 2 2 0.25 ",
            "Pf\r\n2 2\r\n1.0\r\n",
            "Pf\n# made by hand\n2 2\n1\n",
        ] {
            let bytes = [header.as_bytes(), &rows].concat();
            let map = parse(&bytes).unwrap();
            assert_eq!(map.as_raw(), &[1.0, 2.0, 4.5, 6.0], "{header:?}");
        }
    }

    #[test]
    fn a_byte_order_that_contradicts_its_sign_is_refused() {
        let values: Vec<f32> = (0..64).map(|k| 20.0 + 0.37 * k as f32).collect();
        let map = FloatMap::from_vec(8, 8, values).unwrap();
        let marked = FloatMap::from_fn(8, 8, |x, y| match x {
            0..5 => image::Luma([f32::INFINITY]),
            _ => *map.get_pixel(x, y),
        });
        for map in [map, marked] {
            let bytes: Vec<u8> = map.as_raw().iter().flat_map(|v| v.to_le_bytes()).collect();
            let with = |header: &[u8]| parse(&[header, &bytes].concat());
            assert!(with(b"Pf\n8 8\n-1\n").is_ok());
            let error = with(b"Pf\n8 8\n1\n").unwrap_err().to_string();
            assert!(error.contains("sensible only as little-endian"), "{error}");
        }
        // Marks only, zeros, or values that are strange in both orders.
        for value in [f32::INFINITY, f32::NAN, 0.0, 1e-30, -1.0] {
            let bytes = value.to_be_bytes().repeat(64);
            assert!(
                parse(&[b"Pf\n8 8\n1\n", &bytes[..]].concat()).is_ok(),
                "{value}"
            );
        }
    }

    #[test]
    fn a_data_byte_that_looks_like_a_line_feed_is_kept() {
        // A f32 whose first little-endian byte is 0x0A, after a header that ends with a lone CR.
        let value = f32::from_le_bytes([0x0A, 0x00, 0x80, 0x3F]);
        let bytes = [b"Pf\r1 1\r-1\r".as_slice(), &value.to_le_bytes()].concat();
        assert_eq!(parse(&bytes).unwrap().as_raw(), &[value]);
    }

    #[test]
    fn broken_headers_are_refused_before_anything_is_allocated() {
        for (bytes, reason) in [
            (b"".as_slice(), "empty"),
            (b"P5\n2 2\n255\n", "starts with 'P5'"),
            (b"Pf\n2", "before the height"),
            (b"Pf\n2 -2\n-1\n", "height in the header is not valid: '-2'"),
            (b"Pf\n0 2\n-1\n", "so it has no pixels"),
            (b"Pf\n2 2\n0\n", "byte order"),
            (
                b"PF\n1 1\n-1\n\0\0\0\0\0\0\x80\x3f\0\0\0\0",
                "channels differ",
            ),
        ] {
            let error = parse(bytes).unwrap_err();
            assert!(error.to_string().contains(reason), "{error}");
        }
        assert_eq!(
            parse(b"Pf\n4000000000 4000000000\n-1\n"),
            Err(FormatError::Truncated {
                what: "a 4000000000x4000000000 map of 1 channel(s)".to_owned(),
                needed: 64_000_000_000_000_000_000,
                available: 0,
            })
        );
    }
}
