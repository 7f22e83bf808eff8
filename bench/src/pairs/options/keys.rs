//! The keys of the text form, in one table for reading, writing and help.

use clap::ValueEnum;

use super::{MissingDepth, OverlapDepth, OverlapDirection, PairOptions, PairOrder};
use crate::pairs::overlap::{Denominator, DepthLookup, OverlapTest};
use crate::pairs::sampling::SamplingRule;
use crate::pairs::sets::{Grouping, Remainder};

/// A choice with a text form. Errors do not name the key.
pub(super) trait OptionValue {
    /// The accepted values, for help and errors.
    fn values(&self) -> String;
    fn text(&self) -> String;
    fn set(&mut self, text: &str) -> Result<(), String>;
}

/// Meaning of each key, in the order of the text form.
pub(super) const MEANINGS: [&str; 20] = [
    "which views of a scene share a set; pairs are formed within sets",
    "number of views in a set, 2 or more",
    "whether to keep a last set with fewer views than the others",
    "maximum number of sets per scene; the first sets are used",
    "whether two views make pairs in both directions, or only from the earlier to the later view",
    "what to do with views without depth: exclude them from pairs, accept their pairs without measuring overlap, or \
     leave them out before sets are formed",
    "source of the depth that decides overlap; sparse alone means sparse:8",
    "when a pixel counts as seen, given its depth z in the other view and that view's depth D at the same place: \
     consistent, if |D - z| <= RELATIVE * z; frustum, always; absolute, if |D - z| < METRES + RELATIVE * z and z > \
     NEAREST, both in metres; map-anything, like absolute with MapAnything's values",
    "how the other view's depth is read at a projected position",
    "what the number of seen pixels is divided by: the pixels with depth, all pixels, or the other view's pixels with \
     depth",
    "only every N-th pixel of every N-th row is projected; N is 1 or more",
    "longer side, in pixels, to which depth maps are downscaled first",
    "which of a pair's two overlaps the threshold applies to",
    "minimum overlap, 0 or more",
    "whether an overlap equal to the threshold qualifies",
    "minimum distance of the two cameras, metres, 0 or more; pairs at exactly this distance qualify",
    "maximum distance of the two cameras, metres; pairs at exactly this distance qualify",
    "maximum number of evaluated pairs per dataset",
    "how the evaluated pairs are drawn: from all pairs, from each scene in turn, from each of ten bins of baseline in \
     turn, or the first ones by id",
    "seed for drawing the evaluated pairs",
];

impl PairOptions {
    /// Every choice with its key, in the order of the text form.
    pub(super) fn choices(&mut self) -> [(&'static str, &mut dyn OptionValue); MEANINGS.len()] {
        [
            ("sets", &mut self.sets.grouping),
            ("size", &mut self.sets.size),
            ("remainder", &mut self.sets.remainder),
            ("max-sets", &mut self.sets.max_sets),
            ("order", &mut self.order),
            ("missing-depth", &mut self.missing_depth),
            ("overlap", &mut self.depth),
            ("test", &mut self.overlap.test),
            ("lookup", &mut self.overlap.lookup),
            ("denominator", &mut self.overlap.denominator),
            ("stride", &mut self.overlap.stride),
            ("max-side", &mut self.overlap.max_side),
            ("direction", &mut self.direction),
            ("threshold", &mut self.threshold),
            ("at-threshold", &mut self.threshold_qualifies),
            ("min-baseline", &mut self.min_baseline_m),
            ("max-baseline", &mut self.max_baseline_m),
            ("limit", &mut self.sampling.limit),
            ("sampling", &mut self.sampling.rule),
            ("seed", &mut self.sampling.seed),
        ]
    }
}

fn number<T: std::str::FromStr>(text: &str) -> Result<T, String> {
    let number = text.parse();
    number.map_err(|_| "not a number, or out of range".to_owned())
}

/// Comma-separated names of an enum's values.
fn words<T: ValueEnum>() -> String {
    let words: Vec<String> = T::value_variants().iter().map(word_of).collect();
    words.join(", ")
}

fn word_of<T: ValueEnum>(value: &T) -> String {
    let named = value.to_possible_value();
    named.map_or_else(String::new, |word| word.get_name().to_owned())
}

fn from_word<T: ValueEnum>(text: &str, values: &str) -> Result<T, String> {
    T::from_str(text, false).map_err(|_| format!("expected one of {values}"))
}

macro_rules! numbers {
    ($($type:ty)+) => {
        $(impl OptionValue for $type {
            fn values(&self) -> String {
                "a number".to_owned()
            }

            fn text(&self) -> String {
                self.to_string()
            }

            fn set(&mut self, text: &str) -> Result<(), String> {
                *self = number(text)?;
                Ok(())
            }
        })+
    };
}

/// Text form of optional limits, with a word for no limit.
macro_rules! limits {
    ($($type:ty, $none:literal;)+) => {
        $(impl OptionValue for Option<$type> {
            fn values(&self) -> String {
                concat!($none, " or a number").to_owned()
            }

            fn text(&self) -> String {
                self.map_or_else(|| $none.to_owned(), |limit| limit.to_string())
            }

            fn set(&mut self, text: &str) -> Result<(), String> {
                *self = match text {
                    $none => None,
                    number_text => Some(number(number_text)?),
                };
                Ok(())
            }
        })+
    };
}

macro_rules! enums {
    ($($type:ty)+) => {
        $(impl OptionValue for $type {
            fn values(&self) -> String {
                words::<Self>()
            }

            fn text(&self) -> String {
                word_of(self)
            }

            fn set(&mut self, text: &str) -> Result<(), String> {
                *self = from_word(text, &self.values())?;
                Ok(())
            }
        })+
    };
}

numbers! { usize u32 u64 f64 }
// Limits for the number of sets or pairs, the side of a map in pixels, and distances in metres.
limits! { usize, "all"; u32, "full"; f64, "none"; }
enums! { Remainder PairOrder MissingDepth Denominator OverlapDirection SamplingRule }

impl OptionValue for bool {
    fn values(&self) -> String {
        "out, in".to_owned()
    }

    fn text(&self) -> String {
        if *self { "in" } else { "out" }.to_owned()
    }

    fn set(&mut self, text: &str) -> Result<(), String> {
        *self = match text {
            "in" => true,
            "out" => false,
            _ => return Err("expected one of out, in".to_owned()),
        };
        Ok(())
    }
}

impl OptionValue for Grouping {
    fn values(&self) -> String {
        format!("{}, random:SEED", words::<Self>())
    }

    fn text(&self) -> String {
        match self {
            Self::Random { seed } => format!("random:{seed}"),
            other => word_of(other),
        }
    }

    fn set(&mut self, text: &str) -> Result<(), String> {
        *self = match text.split_once(':') {
            Some(("random", seed)) => Self::Random {
                seed: number(seed)?,
            },
            _ => from_word(text, &self.values())?,
        };
        Ok(())
    }
}

impl OptionValue for DepthLookup {
    fn values(&self) -> String {
        format!("{}, window:PIXELS", words::<Self>())
    }

    fn text(&self) -> String {
        match self {
            Self::Window { radius } => format!("window:{radius}"),
            other => word_of(other),
        }
    }

    fn set(&mut self, text: &str) -> Result<(), String> {
        *self = match text.split_once(':') {
            Some(("window", radius)) => Self::Window {
                radius: number(radius)?,
            },
            _ => from_word(text, &self.values())?,
        };
        Ok(())
    }
}

impl OptionValue for OverlapTest {
    fn values(&self) -> String {
        "consistent:RELATIVE, frustum, absolute:METRES:RELATIVE:NEAREST or map-anything".to_owned()
    }

    fn text(&self) -> String {
        match *self {
            Self::MAP_ANYTHING => "map-anything".to_owned(),
            Self::Frustum => "frustum".to_owned(),
            Self::Consistent { relative } => format!("consistent:{relative}"),
            Self::AbsoluteRelative {
                absolute_m,
                relative,
                min_depth_m,
            } => format!("absolute:{absolute_m}:{relative}:{min_depth_m}"),
        }
    }

    fn set(&mut self, text: &str) -> Result<(), String> {
        *self = match text.split(':').collect::<Vec<_>>()[..] {
            ["frustum"] => Self::Frustum,
            ["map-anything"] => Self::MAP_ANYTHING,
            ["consistent", relative] => Self::Consistent {
                relative: number(relative)?,
            },
            ["absolute", absolute_m, relative, min_depth_m] => Self::AbsoluteRelative {
                absolute_m: number(absolute_m)?,
                relative: number(relative)?,
                min_depth_m: number(min_depth_m)?,
            },
            _ => return Err(format!("expected {}", self.values())),
        };
        Ok(())
    }
}

impl OptionValue for OverlapDepth {
    fn values(&self) -> String {
        "auto, ground-truth, sparse:PIXELS, given, given-metric, sharp-release or depth-pro"
            .to_owned()
    }

    fn text(&self) -> String {
        self.to_string()
    }

    fn set(&mut self, text: &str) -> Result<(), String> {
        *self = match text.split_once(':') {
            Some(("sparse", radius)) => Self::Sparse {
                radius: number(radius)?,
            },
            _ if text == "sparse" => Self::Sparse { radius: 8 },
            _ => from_word(text, "").map_err(|_| format!("expected {}", self.values()))?,
        };
        Ok(())
    }
}
