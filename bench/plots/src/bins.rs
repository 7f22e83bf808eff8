//! Bins samples along an axis.

use std::collections::BTreeMap;
use std::fmt;
use std::num::NonZeroUsize;
use std::str::FromStr;

use sharp_statistics::{mean, sample_std};

use super::scale::Step;

/// How an axis is divided into bins.
#[derive(Debug, Clone, PartialEq)]
pub enum Binning {
    /// Bins of a round width, at most the given number.
    Round(usize),
    /// Bins of the given width, with an edge at zero.
    Width(Step),
    /// The given number of bins, with equally many samples each; equal samples share a bin.
    Quantiles(NonZeroUsize),
    /// Bins between the given edges, ascending.
    Edges(Vec<f64>),
}

/// Maximum magnitude of given edges, so that values computed from them stay finite.
const FARTHEST_EDGE: f64 = 1e15;

impl FromStr for Binning {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if let Some(count) = text.strip_prefix("quantile:") {
            let count = count
                .parse()
                .ok()
                .filter(|n: &NonZeroUsize| n.get() <= 1000);
            return count
                .map(Self::Quantiles)
                .ok_or("quantile:N needs N from 1 to 1000");
        }
        if !text.contains(',') {
            let step = Step::parse(text);
            return step.map(Self::Width).ok_or(
                "expected a width above 0 (a decimal of at most 15 digits, without an exponent, such as 0.1), quantile:N with N \
                 from 1 to 1000, or a list of edges, such as 0,0.1,0.5",
            );
        }
        let edges: Result<Vec<f64>, _> = text.split(',').map(|edge| edge.trim().parse()).collect();
        let edges = edges.map_err(|_| "edges must be numbers, as in 0,0.1,0.5")?;
        let ascend = edges.windows(2).all(|two| two[0] < two[1]);
        let bounded = edges.iter().all(|edge| edge.abs() <= FARTHEST_EDGE);
        (ascend && bounded)
            .then_some(Self::Edges(edges))
            .ok_or("edges must ascend and lie between -1e15 and 1e15")
    }
}

/// For captions: `bins of width 0.1`.
impl fmt::Display for Binning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Round(_) => f.write_str("bins of a round width"),
            Self::Width(step) => write!(f, "bins of width {}", step.text(1)),
            Self::Quantiles(n) => write!(f, "{n} bins of equally many pairs"),
            Self::Edges(edges) => {
                let edges: Vec<String> = edges.iter().map(f64::to_string).collect();
                write!(f, "bins between {}", edges.join(", "))
            }
        }
    }
}

/// An axis cut into bins. A bin includes its lower edge; with given edges, the last bin also includes its upper edge.
#[derive(Debug, Clone, PartialEq)]
pub enum Cuts {
    Steps(Step),
    Edges(Vec<f64>),
}

impl Binning {
    /// Cuts the axis for samples at `places`. An axis of [`Self::Round`] bins starts at `low` or below.
    pub fn cuts(&self, places: impl IntoIterator<Item = f64>, low: Option<f64>) -> Cuts {
        let mut places: Vec<f64> = places.into_iter().filter(|x| x.is_finite()).collect();
        places.sort_by(f64::total_cmp);
        let ends = places.first().zip(places.last());
        match self {
            Self::Width(step) => Cuts::Steps(*step),
            Self::Edges(edges) => Cuts::Edges(edges.clone()),
            Self::Round(count) => {
                let span = ends.map_or(0.0, |(first, last)| {
                    let span = last - low.map_or(*first, |low| low.min(*first));
                    // Places that differ only by rounding count as one.
                    if span > ROUNDING * last.abs() {
                        span
                    } else {
                        0.0
                    }
                });
                Cuts::Steps(Step::nice(span, *count))
            }
            Self::Quantiles(count) => {
                let first = |k: usize| places.get(k * places.len() / count.get()).copied();
                let mut edges: Vec<f64> = (0..count.get()).filter_map(first).collect();
                edges.dedup();
                // If the largest places are equal, the last bin has zero width.
                edges.extend(places.last());
                Cuts::Edges(edges)
            }
        }
    }
}

/// A value below an edge counts as lying on the edge if it is off by less than this fraction of the bin's width. Camera
/// centres are rounded, so distances between them are not exact.
const ROUNDING: f64 = 1e-9;

/// Maximum number of steps from zero: beyond it, floating point cannot reliably distinguish a
/// multiple of the step from the next.
const LAST_STEP: u64 = 1 << 50;

impl Cuts {
    /// Whether `x` falls into a bin.
    pub fn hold(&self, x: f64) -> bool {
        self.bin(x).is_some()
    }

    /// Number, lower edge and upper edge of the bin of `x`; `None` outside all edges or more than [`LAST_STEP`] steps
    /// from zero.
    fn bin(&self, x: f64) -> Option<(i64, f64, f64)> {
        match self {
            Self::Steps(step) => {
                let k = step.index(x + ROUNDING * step.at(1));
                let bin = (k.unsigned_abs() < LAST_STEP).then(|| (k, step.at(k), step.at(k + 1)));
                bin.filter(|(_, low, high)| low.is_finite() && high.is_finite())
            }
            Self::Edges(edges) => {
                let (first, last) = edges.first().zip(edges.last())?;
                let rounding = ROUNDING * (last - first);
                if !(*first - rounding..=*last + rounding).contains(&x) {
                    return None;
                }
                let x = x + rounding;
                // The last edge belongs to the bin below it; a single edge is a bin of its own.
                let above = edges
                    .partition_point(|edge| *edge <= x)
                    .min(edges.len() - 1);
                let below = above.saturating_sub(1);
                Some((below as i64, edges[below], edges[above]))
            }
        }
    }
}

/// A non-empty bin: the samples in one part of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Bin {
    /// Consecutive numbers mean adjacent bins.
    pub number: i64,
    pub low: f64,
    pub high: f64,
    /// Mean position of the samples, where the bin is drawn.
    pub x: f64,
    /// Indices of the samples.
    pub members: Vec<usize>,
    /// Mean of the samples' values; infinite if any value is infinite.
    pub mean: f64,
    /// Sample standard deviation (divisor n − 1); `None` for a single sample or if a value is infinite.
    pub std: Option<f64>,
}

impl Bin {
    /// Number of samples.
    pub fn n(&self) -> usize {
        self.members.len()
    }
}

/// Non-empty bins of `(place, value)` samples, ascending. Skips samples whose place is not finite or outside all bins,
/// or whose value is NaN.
pub fn bins(samples: &[(f64, f64)], cuts: &Cuts) -> Vec<Bin> {
    let mut groups: BTreeMap<i64, (f64, f64, Vec<usize>)> = BTreeMap::new();
    for (i, (x, value)) in samples.iter().enumerate() {
        if x.is_finite()
            && !value.is_nan()
            && let Some((number, low, high)) = cuts.bin(*x)
        {
            let group = groups.entry(number).or_insert((low, high, Vec::new()));
            group.2.push(i);
        }
    }
    let bins = groups
        .into_iter()
        .filter_map(|(number, (low, high, members))| {
            let of = |pick: fn(&(f64, f64)) -> f64| -> Vec<f64> {
                members.iter().map(|i| pick(&samples[*i])).collect()
            };
            let values = of(|sample| sample.1);
            Some(Bin {
                number,
                low,
                high,
                // Clamp, because rounding could move the mean out of the bin.
                x: mean(&of(|sample| sample.0))?.clamp(low, high),
                mean: mean(&values)?,
                std: sample_std(&values),
                members,
            })
        });
    bins.collect()
}

/// Splits bins into runs of adjacent bins, with no empty bin inside a run.
pub fn neighbours<T>(bins: &[T], bin: impl Fn(&T) -> &Bin) -> impl Iterator<Item = &[T]> {
    bins.chunk_by(move |one, next| bin(one).number.checked_add(1) == Some(bin(next).number))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(text: &str, samples: &[(f64, f64)]) -> Vec<(f64, f64, usize, f64)> {
        let binning: Binning = text.parse().unwrap();
        let cuts = binning.cuts(samples.iter().map(|s| s.0), None);
        let bins = bins(samples, &cuts).into_iter();
        bins.map(|b| (b.low, b.high, b.n(), b.mean)).collect()
    }

    #[test]
    fn edges_belong_to_the_bin_above_and_empty_bins_are_skipped() {
        let samples = [
            (0.0, 1.0),
            (0.1, 2.0),
            (0.0999, 3.0),
            (0.3, 4.0),
            (0.7, 5.0),
        ];
        let cuts = "0.1".parse::<Binning>().unwrap().cuts([], None);
        let found = bins(&samples, &cuts);
        let shown = found
            .iter()
            .map(|b| (b.number, b.low, b.n(), b.mean, b.std));
        assert_eq!(
            shown.collect::<Vec<_>>(),
            [
                (0, 0.0, 2, 2.0, Some(2_f64.sqrt())),
                (1, 0.1, 1, 2.0, None),
                (3, 0.3, 1, 4.0, None),
                (7, 0.7, 1, 5.0, None),
            ]
        );
        // This sum is rounded to slightly less than 0.3.
        let below = [(0.1 + 0.7 - 0.5, 1.0)];
        assert!(below[0].0 < 0.3);
        assert_eq!(cut("0.1", &below), [(0.3, 0.4, 1, 1.0)]);
        assert_eq!(cut("0,0.3,1", &below), [(0.3, 1.0, 1, 1.0)]);
        assert_eq!(found[0].members, [0, 2]);
        assert_eq!(found[0].x, 0.0999 / 2.0);
        let runs: Vec<usize> = neighbours(&found, |bin| bin).map(<[_]>::len).collect();
        assert_eq!(runs, [2, 1, 1]);
    }

    #[test]
    fn given_edges_leave_out_what_is_beyond_and_the_last_is_closed() {
        let samples = [(-0.1, 9.0), (0.0, 1.0), (0.5, 2.0), (1.0, 4.0), (1.1, 9.0)];
        assert_eq!(
            cut("0, 0.5, 1", &samples),
            [(0.0, 0.5, 1, 1.0), (0.5, 1.0, 2, 3.0)]
        );
    }

    #[test]
    fn quantiles_hold_equally_many_and_ties_stay_together() {
        let at = |places: &[f64]| -> Vec<(f64, f64)> { places.iter().map(|x| (*x, *x)).collect() };
        let counts = |count: &str, places: &[f64]| -> Vec<(f64, f64, usize)> {
            let found = cut(&format!("quantile:{count}"), &at(places)).into_iter();
            found.map(|(low, high, n, _)| (low, high, n)).collect()
        };
        assert_eq!(
            counts("3", &[7.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            [(1.0, 3.0, 2), (3.0, 5.0, 2), (5.0, 7.0, 3)]
        );
        assert_eq!(
            counts("4", &[1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 3.0, 3.0]),
            [(1.0, 3.0, 6), (3.0, 3.0, 2)]
        );
        assert_eq!(counts("5", &[2.0, 2.0, 2.0]), [(2.0, 2.0, 3)]);
        assert_eq!(counts("5", &[2.0]), [(2.0, 2.0, 1)]);
        // More bins than samples: each sample has its own.
        assert_eq!(
            counts("9", &[1.0, 2.0, 4.0]),
            [(1.0, 2.0, 1), (2.0, 4.0, 1), (4.0, 4.0, 1)]
        );
        assert!(counts("5", &[]).is_empty());
    }

    #[test]
    fn what_no_step_reaches_is_in_no_bin() {
        let far = [(1e30, 1.0), (0.25, 2.0), (-1e30, 3.0)];
        assert_eq!(cut("0.1", &far), [(0.2, 0.3, 1, 2.0)]);
        let cuts = |low: f64, high: f64| Binning::Round(10).cuts([low, high], None);
        assert!(!cuts(0.0, f64::MAX).hold(f64::MAX));
        assert!(cuts(0.0, 1e30).hold(1e30));
        // Both values count as one position. If their rounding difference counted as a distance, they would be far more
        // than ten steps from zero.
        let close = [0.75, 0.75_f64.next_up()];
        assert_eq!(
            bins(&close.map(|x| (x, 1.0)), &cuts(close[0], close[1])).len(),
            1
        );
    }

    #[test]
    fn infinite_and_missing_values() {
        let samples = [
            (0.05, f64::INFINITY),
            (0.06, 30.0),
            (0.07, f64::NAN),
            (f64::NAN, 1.0),
        ];
        assert_eq!(cut("0.1", &samples), [(0.0, 0.1, 2, f64::INFINITY)]);
        assert!(cut("0.1", &[]).is_empty());
    }

    #[test]
    fn what_is_no_binning_is_refused() {
        for wrong in [
            "",
            "0",
            "-1",
            "quantile:0",
            "quantile:",
            "1,0",
            "0,0",
            "0,inf",
            "0,x",
            "0,1e16",
            "1e3",
            "0.1234567890123456",
        ] {
            assert!(wrong.parse::<Binning>().is_err(), "{wrong}");
        }
    }
}
