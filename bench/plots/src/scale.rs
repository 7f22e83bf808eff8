//! Round steps for ticks and bins, exact in decimal.

/// A step of `mantissa × 10^exponent`. Its multiples are the floating-point numbers nearest to the
/// decimal ones, so that 3 × 0.1 is 0.3 and a sample of 0.3 is exactly on the edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    mantissa: i64,
    exponent: i32,
}

impl Step {
    /// The smallest step of 1, 2 or 5 × 10ⁿ such that at most `count` steps cover `span`; 1 if the
    /// span is not positive.
    pub fn nice(span: f64, count: usize) -> Self {
        let fallback = Self {
            mantissa: 1,
            exponent: 0,
        };
        if !(span.is_finite() && span > 0.0) || count == 0 {
            return fallback;
        }
        let raw = span / count as f64;
        let exponent = raw.log10().floor() as i32 - 1;
        let mut candidates = (exponent..exponent + 4)
            .flat_map(|exponent| [1, 2, 5].map(|mantissa| Self { mantissa, exponent }));
        candidates
            .find(|step| span / step.at(1) <= count as f64 * (1.0 + 1e-12))
            .unwrap_or(fallback)
    }

    /// Parses a positive decimal of at most 15 digits without an exponent, exactly: `0.25`.
    pub fn parse(text: &str) -> Option<Self> {
        let (whole, part) = text.split_once('.').unwrap_or((text, ""));
        let digits = format!("{whole}{part}");
        let plain = !digits.is_empty() && digits.bytes().all(|c| c.is_ascii_digit());
        // Integers below 2⁵³ are exact in floating point.
        let mantissa = digits.parse().ok();
        let mantissa = mantissa.filter(|m| (1..1_000_000_000_000_000).contains(m))?;
        let exponent = -i32::try_from(part.len()).ok()?;
        (plain && exponent >= -22).then_some(Self { mantissa, exponent })
    }

    /// The k-th multiple of the step.
    pub fn at(self, k: i64) -> f64 {
        let multiple = self.mantissa as f64 * k as f64;
        if self.exponent < 0 {
            // A single division rounds only once.
            multiple / 10_f64.powi(-self.exponent)
        } else {
            multiple * 10_f64.powi(self.exponent)
        }
    }

    /// k such that `at(k) <= value < at(k + 1)`.
    pub fn index(self, value: f64) -> i64 {
        let mut k = (value / self.at(1)).floor() as i64;
        // The quotient may be off by one unit in the last place.
        if self.at(k.saturating_add(1)) <= value {
            k = k.saturating_add(1);
        }
        if self.at(k) > value {
            k = k.saturating_sub(1);
        }
        k
    }

    /// Number of decimals that multiples of the step need.
    pub fn decimals(self) -> usize {
        usize::try_from(-self.exponent).unwrap_or(0)
    }

    /// The k-th multiple of the step as text.
    pub fn text(self, k: i64) -> String {
        shown(self.at(k), self.decimals())
    }

    /// The k of all multiples of the step within `low..=high`, at most a thousand.
    pub fn within(self, low: f64, high: f64) -> Vec<i64> {
        let first = -self.index(-low);
        let mut ticks: Vec<i64> = (first.saturating_sub(1)..first.saturating_add(1000))
            .filter(|k| (low..=high).contains(&self.at(*k)))
            .collect();
        ticks.dedup();
        ticks
    }
}

/// Smallest and largest finite value; `None` if no value is finite.
pub fn finite_range(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    let finite = values.into_iter().filter(|value| value.is_finite());
    finite.fold(None, |range, value| match range {
        None => Some((value, value)),
        Some((low, high)) => Some((value.min(low), value.max(high))),
    })
}

/// Powers of ten within `low..=high`, with 2 and 5 times these powers if there are fewer than
/// three. Empty unless `0 < low < high < ∞`.
pub fn log_ticks(low: f64, high: f64) -> Vec<f64> {
    if !(low > 0.0 && high > low && high.is_finite()) {
        return Vec::new();
    }
    let ticks = |mantissas: &[i64]| -> Vec<f64> {
        let exponents = low.log10().floor() as i32..=high.log10().ceil() as i32;
        let all = exponents.flat_map(|exponent| {
            let step = Step {
                mantissa: 1,
                exponent,
            };
            mantissas.iter().map(move |m| step.at(*m))
        });
        all.filter(|tick| (low..=high).contains(tick)).collect()
    };
    let powers = ticks(&[1]);
    match powers.len() {
        0..3 => ticks(&[1, 2, 5]),
        _ => powers,
    }
}

/// Formats a number with `decimals` decimals: `∞` for infinity, no negative zero.
pub fn shown(value: f64, decimals: usize) -> String {
    if value.is_nan() {
        return "nan".into();
    }
    if value.is_infinite() {
        return if value > 0.0 { "∞" } else { "−∞" }.into();
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|c| matches!(c, b'0' | b'.')) => digits.into(),
        _ => text,
    }
}

/// A linear map from data values to pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Data value that is drawn at pixel `from`.
    pub low: f64,
    /// Data value that is drawn at pixel `to`.
    pub high: f64,
    /// Pixel at which `low` is drawn.
    pub from: f64,
    /// Pixel at which `high` is drawn.
    pub to: f64,
}

impl Scale {
    /// Pixel at which `value` is drawn.
    pub fn place(&self, value: f64) -> f64 {
        self.from + (value - self.low) / (self.high - self.low) * (self.to - self.from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round_and_few() {
        let nice = |span, count| Step::nice(span, count).at(1);
        assert_eq!(nice(1.0, 10), 0.1);
        assert_eq!(nice(0.6, 10), 0.1);
        assert_eq!(nice(3.7, 10), 0.5);
        assert_eq!(nice(12.0, 6), 2.0);
        assert_eq!(nice(2e5, 4), 5e4);
        assert_eq!(nice(0.0, 4), 1.0);
        assert_eq!(nice(f64::NAN, 4), 1.0);
        assert_eq!(nice(f64::INFINITY, 4), 1.0);
    }

    #[test]
    fn multiples_are_the_nearest_numbers_to_their_decimals() {
        let tenth = Step::nice(1.0, 10);
        for k in -1000..1000 {
            let decimal: f64 = format!("{}e-1", k).parse().unwrap();
            assert_eq!(tenth.at(k), decimal);
            assert_eq!(tenth.index(decimal), k);
            assert_eq!(tenth.index(decimal.next_down()), k - 1);
        }
        assert_eq!(tenth.text(3), "0.3");
    }

    #[test]
    fn decimals_are_read_exactly() {
        let step = Step::parse("0.25").unwrap();
        assert_eq!(
            (step.at(3), step.index(0.75), step.decimals()),
            (0.75, 3, 2)
        );
        assert_eq!(Step::parse("10").unwrap().at(2), 20.0);
        for wrong in [
            "",
            ".",
            "0",
            "0.0",
            "-1",
            "1e3",
            "+1",
            "nan",
            "1,5",
            "99999999999999999999",
        ] {
            assert_eq!(Step::parse(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn logarithmic_ticks() {
        assert_eq!(log_ticks(0.05, 300.0), [0.1, 1.0, 10.0, 100.0]);
        assert_eq!(log_ticks(0.3, 6.0), [0.5, 1.0, 2.0, 5.0]);
        assert!(log_ticks(0.0, 1.0).is_empty());
    }

    #[test]
    fn ticks_lie_within_the_range() {
        let step = Step::nice(1.0, 5);
        let at = |low, high| -> Vec<f64> {
            step.within(low, high).iter().map(|k| step.at(*k)).collect()
        };
        assert_eq!(at(0.0, 1.0), [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]);
        assert_eq!(at(-0.3, 0.25), [-0.2, 0.0, 0.2]);
        assert!(at(0.05, 0.15).is_empty());
    }

    #[test]
    fn numbers_are_rounded_without_negative_zero() {
        assert_eq!(shown(0.0965, 3), "0.097"); // 0.0965 is stored as 0.09650000000000000022
        assert_eq!(shown(-0.0004, 3), "0.000");
        assert_eq!(shown(-0.5, 0), "0"); // halves go to even
        assert_eq!(shown(-1.26, 1), "-1.3");
        assert_eq!(shown(f64::INFINITY, 2), "∞");
        assert_eq!(shown(f64::NAN, 2), "nan");
    }
}
