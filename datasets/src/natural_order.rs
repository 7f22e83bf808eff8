//! Natural order: `frame2` before `frame10`. Implemented here because published pair lists depend on it, and existing
//! crates (`natord`) skip blanks and treat different names as equal.

use std::cmp::Ordering;

/// Compares two names: runs of ASCII digits (of any length) by value, everything else byte by byte. Names that differ
/// only in leading zeros are ordered bytewise, so that only identical names compare equal.
pub fn compare(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    loop {
        match (x.first(), y.first()) {
            (None, None) => return a.cmp(b),
            (None, Some(_)) => return Ordering::Less,
            (Some(_), None) => return Ordering::Greater,
            (Some(p), Some(q)) if p.is_ascii_digit() && q.is_ascii_digit() => {
                let (m, n);
                (m, x) = split_number(x);
                (n, y) = split_number(y);
                let order = m.len().cmp(&n.len()).then_with(|| m.cmp(n));
                if order != Ordering::Equal {
                    return order;
                }
            }
            (Some(p), Some(q)) if p == q => (x, y) = (&x[1..], &y[1..]),
            (Some(p), Some(q)) => return p.cmp(q),
        }
    }
}

/// Splits off the leading digits, and drops their leading zeros; returns digits and rest.
fn split_number(text: &[u8]) -> (&[u8], &[u8]) {
    let end = text
        .iter()
        .position(|c| !c.is_ascii_digit())
        .unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    let zeros = digits
        .iter()
        .position(|&c| c != b'0')
        .unwrap_or(digits.len());
    (&digits[zeros..], rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_ordered_by_value() {
        let mut names = [
            "img10",
            "img2",
            "img02",
            "img",
            "img1b",
            "img1a12",
            "img1a3",
            "z",
            "99999999999999999999999",
            "100000000000000000000000",
        ];
        names.sort_by(|a, b| compare(a, b));
        assert_eq!(
            names,
            [
                "99999999999999999999999",
                "100000000000000000000000",
                "img",
                "img1a3",
                "img1a12",
                "img1b",
                "img02",
                "img2",
                "img10",
                "z",
            ]
        );
    }

    #[test]
    fn only_equal_names_compare_equal() {
        assert_eq!(compare("a01", "a1"), Ordering::Less);
        assert_eq!(compare("a1", "a01"), Ordering::Greater);
        assert_eq!(compare("a1", "a1"), Ordering::Equal);
    }
}
