//! Optional values in files by their printed form, which is the one of the command line.

use std::fmt::Display;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// What a file may hold: a text, or a number where the text would be one.
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
