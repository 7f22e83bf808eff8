//! Serialises optional values in the form that the command line accepts.

use std::fmt::Display;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// A text, or a number that is converted to text.
#[derive(Deserialize)]
#[serde(untagged)]
enum Form {
    Text(String),
    Number(f64),
}

pub(super) fn serialize<T: Display, S: Serializer>(
    value: &Option<T>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    value.as_ref().map(T::to_string).serialize(serializer)
}

pub(super) fn deserialize<'de, T, D>(deserializer: D) -> Result<Option<T>, D::Error>
where
    T: FromStr<Err: Display>,
    D: Deserializer<'de>,
{
    let Some(form) = Option::<Form>::deserialize(deserializer)? else {
        return Ok(None);
    };
    let text = match form {
        Form::Text(text) => text,
        Form::Number(number) => number.to_string(),
    };
    text.parse().map(Some).map_err(de::Error::custom)
}
