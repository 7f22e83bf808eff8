//! Finds the convention that reproduces a published number.

use std::str::FromStr;

/// A published number to find. Values are rounded or truncated to its number of decimals before they are compared with
/// it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sought {
    value: f64,
    decimals: i32,
    /// The number as written.
    pub(super) text: String,
}

impl FromStr for Sought {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let value: f64 = text
            .parse()
            .map_err(|_| format!("'{text}' is not a number"))?;
        if !value.is_finite() || text.contains(['e', 'E']) {
            return Err("write it as a decimal number, such as 0.652".to_owned());
        }
        let decimals = text
            .split_once('.')
            .map_or(0, |(_, fraction)| fraction.len());
        Ok(Self {
            value,
            decimals: i32::try_from(decimals).map_err(|_| "too many decimals".to_owned())?,
            text: text.to_owned(),
        })
    }
}

impl Sought {
    /// Whether a value, rounded or truncated to this number's decimals, has the same digits.
    pub(super) fn matches(&self, value: f64) -> bool {
        let unit = 10_f64.powi(-self.decimals);
        let agrees = |shown: f64| (shown * unit - self.value).abs() < 1e-3 * unit;
        agrees((value / unit).round()) || agrees((value / unit).trunc())
    }

    pub(super) fn distance(&self, value: f64) -> f64 {
        (value - self.value).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_agree_to_the_digits_written() {
        let sought: Sought = "0.652".parse().unwrap();
        assert!(sought.matches(0.6516) && sought.matches(0.6524) && sought.matches(0.6529));
        assert!(!sought.matches(0.6514) && !sought.matches(0.6531));
        let sought: Sought = "20".parse().unwrap();
        assert!(sought.matches(20.4) && sought.matches(20.9) && !sought.matches(19.4));
        assert!("1e-3".parse::<Sought>().is_err() && "x".parse::<Sought>().is_err());
        assert!("inf".parse::<Sought>().is_err());
    }
}
