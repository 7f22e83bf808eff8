//! Days and minutes in ISO 8601.

use std::time::{SystemTime, UNIX_EPOCH};

/// The UTC day of a moment, `YYYY-MM-DD`.
pub(crate) fn day(moment: SystemTime) -> String {
    let since = moment.duration_since(UNIX_EPOCH).unwrap_or_default();
    // Count years from March, so that the leap day comes last. Dates repeat every 400 years; one
    // cycle of 400 years began on 1 March 0000, 719 468 days before the epoch.
    let days = since.as_secs() / 86_400 + 719_468;
    let (cycle, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let from_march = (5 * day + 2) / 153;
    let month = (from_march + 2) % 12 + 1;
    let year = 400 * cycle + year + u64::from(month <= 2);
    format!(
        "{year}-{month:02}-{:02}",
        day - (153 * from_march + 2) / 5 + 1
    )
}

/// The UTC minute of a moment, `YYYY-MM-DDTHH:MM`.
pub(crate) fn minute(moment: SystemTime) -> String {
    let since = moment.duration_since(UNIX_EPOCH).unwrap_or_default();
    let minutes = since.as_secs() / 60;
    let (hour, minute) = (minutes / 60 % 24, minutes % 60);
    format!("{}T{hour:02}:{minute:02}", day(moment))
}

/// Whether a text is a valid `YYYY-MM-DD` or `YYYY-MM-DDTHH:MM`.
pub(crate) fn is_date(text: &str) -> bool {
    // The parser also accepts lower case, and a space instead of the T; only the canonical form is
    // printed back unchanged.
    let parsed = text.parse::<toml::value::Datetime>();
    let is_form = |date: toml::value::Datetime| date.date.is_some() && date.to_string() == text;
    matches!(text.len(), 10 | 16) && parsed.is_ok_and(is_form)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn days_and_minutes_are_those_of_the_calendar() {
        let at = |seconds| day(UNIX_EPOCH + Duration::from_secs(seconds));
        assert_eq!(at(0), "1970-01-01");
        assert_eq!(at(951_782_399), "2000-02-28");
        assert_eq!(at(951_782_400), "2000-02-29");
        assert_eq!(at(1_735_689_599), "2024-12-31");
        assert_eq!(at(1_735_689_600), "2025-01-01");
        assert_eq!(at(4_107_542_400), "2100-03-01");
        let minute = minute(UNIX_EPOCH + Duration::from_secs(951_782_399));
        assert_eq!(minute, "2000-02-28T23:59");
        assert!(is_date(&minute));
    }

    #[test]
    fn dates_have_one_form_and_exist() {
        for date in ["2024-02-29", "2000-02-29T00:00", "2026-12-31T23:59"] {
            assert!(is_date(date), "{date}");
        }
        for date in [
            "",
            "today",
            "2025-02-29",
            "1900-02-29",
            "2025-04-31",
            "2025-13-01",
            "2025-00-10",
            "2025-01-00",
            "2025-1-01",
            "25-01-01",
            "2025-01-01 10:00",
            "2025-01-01T24:00",
            "2025-01-01T10:60",
            "2025-01-01T10:00Z",
            "２０２５-01-01",
        ] {
            assert!(!is_date(date), "{date}");
        }
    }
}
