//! `.splat`: 32 bytes per Gaussian, without a header and without view-dependent colour.

use crate::ply::{
    Decoded, PlyReason, StoredColors, StoredForm, StoredOpacity, StoredScales, Suspicion,
};

/// Bytes per Gaussian: position and standard deviations as f32, colour and opacity as bytes, the quaternion w, x, y, z
/// as bytes for −1..1.
const ROW: usize = 32;
/// A quaternion counts as not normalised if its length differs from 1 by more than this; quantisation alone causes at
/// most 0.02. More than one such quaternion in twenty gives a warning.
const MAX_LENGTH_DEVIATION: f32 = 0.1;

pub(super) fn decode(bytes: &[u8]) -> Result<Decoded, PlyReason> {
    let (rows, rest) = bytes.as_chunks::<ROW>();
    if !rest.is_empty() {
        return Err(PlyReason::Damaged {
            format: ".splat",
            what: format!(
                "{} bytes are not a multiple of {ROW}, the size of a Gaussian (truncated?)",
                bytes.len()
            ),
        });
    }
    let mut out = Decoded {
        form: StoredForm {
            opacity: Some(StoredOpacity::Byte),
            scales: Some(StoredScales::Linear),
            colors: Some(StoredColors::Rgb255),
            ..StoredForm::default()
        },
        ..Decoded::default()
    };
    let stored = &mut out.stored;
    for row in rows {
        let (floats, bytes) = row.split_at(24);
        let floats = floats.as_chunks::<4>().0;
        let of = |first: usize| [0, 1, 2].map(|k| f32::from_le_bytes(floats[first + k]));
        stored.means.push(of(0));
        stored.scales.push(of(3));
        stored.colors.push([0, 1, 2].map(|k| f32::from(bytes[k])));
        stored.opacities.push(f32::from(bytes[3]));
        let turn = [4, 5, 6, 7].map(|k| f32::from(bytes[k]) / 127.5 - 1.0);
        stored.quaternions.push(turn);
    }
    out.doubts
        .extend(broken_quaternions(&out.stored.quaternions));
    Ok(out)
}

/// Warns about quaternions whose length is not 1. Quaternions shorter than [`MAX_LENGTH_DEVIATION`] are not counted,
/// because they may be quantised zeros.
fn broken_quaternions(quaternions: &[[f32; 4]]) -> Option<Suspicion> {
    let lengths = quaternions
        .iter()
        .map(|q| q.map(|v| v * v).iter().sum::<f32>().sqrt());
    let off = lengths.filter(|length| {
        *length > MAX_LENGTH_DEVIATION && (length - 1.0).abs() > MAX_LENGTH_DEVIATION
    });
    let off = off.count();
    (20 * off > quaternions.len()).then(|| {
        let text = format!(
            "{:.0} % of its quaternions do not have length 1, so these Gaussians are rotated wrongly; perhaps they \
             were not normalised, or their bytes overflowed (the format stores 128 + 128 q of unit quaternions, \
             clamped to 0..255)",
            100.0 * off as f64 / quaternions.len() as f64
        );
        Suspicion::new("quaternion bytes", text)
    })
}
