//! Chooses the pairs of a figure.

use std::fmt;
use std::num::NonZeroUsize;
use std::str::FromStr;

use crate::pairs::pair_id::source_of;
use crate::report::board::{Board, DatasetBoard, PairBoard};
use crate::report::choice::{by_badness, most_lost};
use crate::report::column::Column;
use crate::report::error::ReportError;
use sharp_plots::PlotError;

/// Rule for choosing pairs of each dataset by their scores in the first metric.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Choice {
    /// The pairs of median difficulty, where difficulty is the mean score of the ranked methods.
    #[default]
    Median,
    /// The pairs with the worst scores.
    Worst,
    /// The pairs with the best scores.
    Best,
    /// The pairs on which the first method is worse than the second, largest difference first.
    Loses(String, String),
}

impl FromStr for Choice {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split(':').collect::<Vec<_>>()[..] {
            ["median"] => Ok(Self::Median),
            ["worst"] => Ok(Self::Worst),
            ["best"] => Ok(Self::Best),
            ["loses", one, other] => Ok(Self::Loses(one.to_owned(), other.to_owned())),
            _ => Err("expected median, worst, best or loses:METHOD:OTHER"),
        }
    }
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Median => f.write_str("median"),
            Self::Worst => f.write_str("worst"),
            Self::Best => f.write_str("best"),
            Self::Loses(one, other) => write!(f, "loses:{one}:{other}"),
        }
    }
}

/// Selects pairs by their ids, or a number of pairs per dataset.
#[derive(Debug, Clone, clap::Args)]
pub struct PairsChoice {
    /// A pair by its id in pairs.csv; repeatable
    #[arg(long = "pair", value_name = "ID")]
    pub ids: Vec<String>,
    /// Which pairs of each dataset to show without --pair, ranked by the first metric: median, worst or best score, as
    /// the mean over the ranked methods; or the pairs on which METHOD scores worst compared with OTHER (datasets where
    /// METHOD is never worse are left out)
    #[arg(
        long,
        value_name = "median|worst|best|loses:METHOD:OTHER",
        default_value_t
    )]
    pub choose: Choice,
    /// Number of pairs per dataset
    #[arg(long, default_value_t = NonZeroUsize::MIN)]
    pub count: NonZeroUsize,
}

/// Selects targets that share one source view.
#[derive(Debug, Clone, clap::Args)]
pub struct PathChoice {
    /// The source as DATASET/SCENE/VIEW, as in the ids of its pairs [default: the source with the most
    /// targets]
    #[arg(long, value_name = "ID")]
    pub source: Option<String>,
    /// Maximum number of targets, spread over the baselines
    #[arg(long, default_value = "5")]
    pub count: NonZeroUsize,
}

/// One pair of median difficulty per dataset.
impl Default for PairsChoice {
    fn default() -> Self {
        Self {
            ids: Vec::new(),
            choose: Choice::default(),
            count: NonZeroUsize::MIN,
        }
    }
}

#[derive(Clone, Copy)]
pub struct ChosenPair<'a> {
    pub dataset: &'a DatasetBoard<'a>,
    pub pair: &'a PairBoard<'a>,
}

/// The selected pairs, by scores in the first of `metrics` if the selection depends on scores.
///
/// # Errors
/// If there is no pair with a given id, no method with a given name, or no pair on which the first method loses.
pub fn chosen<'a>(
    board: &'a Board<'a>,
    metrics: &[Column],
    PairsChoice { ids, choose, count }: &PairsChoice,
) -> Result<Vec<ChosenPair<'a>>, ReportError> {
    let all = || {
        board.datasets.iter().flat_map(|dataset| {
            dataset
                .pairs
                .iter()
                .map(move |pair| ChosenPair { dataset, pair })
        })
    };
    if !ids.is_empty() {
        let of_id = |id: &String| {
            let found = all().find(|chosen| chosen.pair.facts.pair_id == *id);
            let known = all().map(|chosen| chosen.pair.facts.pair_id.as_str());
            found.ok_or_else(|| ReportError::absent("pair", id, known))
        };
        return ids.iter().map(of_id).collect();
    }
    let method = |label: &String| {
        let mut labels = board.methods.iter().map(|method| method.label.as_str());
        let found = labels.position(|known| known == label);
        found.ok_or_else(|| {
            let known = board.methods.iter().map(|method| method.label.as_str());
            ReportError::absent("method", label, known)
        })
    };
    let loses = match choose {
        Choice::Loses(one, other) => Some((method(one)?, method(other)?)),
        _ => None,
    };
    let chosen = board.datasets.iter().flat_map(|dataset| {
        let worst_first = match loses {
            Some((one, other)) => most_lost(&dataset.pairs, metrics, one, other),
            None => by_badness(board, &dataset.pairs, metrics),
        };
        let n = worst_first.len();
        let count = count.get().min(n);
        let first = match choose {
            Choice::Worst | Choice::Loses(..) => 0,
            Choice::Best => n - count,
            // The pairs around the median. For an even number of pairs, the easier of the two middle ones counts as the
            // median.
            Choice::Median => (n / 2)
                .saturating_sub(count.saturating_sub(1) / 2)
                .min(n - count),
        };
        let pairs = worst_first.into_iter().skip(first).take(count);
        pairs.map(move |pair| ChosenPair { dataset, pair })
    });
    let chosen: Vec<ChosenPair<'_>> = chosen.collect();
    if let (Choice::Loses(one, other), true) = (choose, chosen.is_empty()) {
        let reason = format!("{one} loses no pair against {other} in the first chosen metric");
        return Err(PlotError::new(format!("--choose {choose}"), reason).into());
    }
    Ok(chosen)
}

/// At most `count` pairs of one source, sorted by baseline and spread evenly from the nearest to the farthest. `source`
/// has the form `dataset/scene/view`; by default, it is the first of the sources with the most targets.
///
/// # Errors
/// If no pair has the given source.
pub fn along_path<'a>(
    board: &'a Board<'a>,
    PathChoice { source, count }: &PathChoice,
) -> Result<Vec<ChosenPair<'a>>, ReportError> {
    let id = |pair: &PairBoard<'a>| -> &'a str { source_of(&pair.facts.pair_id) };
    let mut sources: Vec<(&str, Vec<ChosenPair<'a>>)> = Vec::new();
    for dataset in &board.datasets {
        // Pairs are sorted by id, so those of one source are adjacent.
        for pairs in dataset.pairs.chunk_by(|one, other| id(one) == id(other)) {
            let pairs_of = pairs.iter().map(|pair| ChosenPair { dataset, pair });
            sources.push((id(&pairs[0]), pairs_of.collect()));
        }
    }
    let found = match source {
        Some(wanted) => sources.iter().position(|(id, _)| id == wanted),
        None => {
            let most = sources.iter().map(|(_, pairs)| pairs.len()).max();
            sources
                .iter()
                .position(|(_, pairs)| Some(pairs.len()) == most)
        }
    };
    let known = sources.iter().map(|(id, _)| *id);
    let Some(found) = found else {
        return Err(ReportError::absent(
            "source",
            source.as_deref().unwrap_or("any"),
            known,
        ));
    };
    let mut pairs = sources.swap_remove(found).1;
    pairs.sort_by(|a, b| a.pair.facts.baseline_m.total_cmp(&b.pair.facts.baseline_m));
    let (n, count) = (pairs.len(), count.get().min(pairs.len()));
    let at = |k: usize| {
        if count == 1 {
            0
        } else {
            k * (n - 1) / (count - 1)
        }
    };
    Ok((0..count).map(|k| pairs[at(k)]).collect())
}

#[cfg(test)]
mod tests {
    use sharp_metrics::MetricKey;

    use super::*;
    use crate::evaluate::Results;
    use crate::evaluate::record::{Record, Score};
    use crate::evaluate::test_records::record;
    use crate::report::test_results;

    fn results() -> Results {
        let scored = |scene, number: usize, psnr: f64| Record {
            baseline_m: 1.0 / (number + 1) as f64,
            scores: [("psnr".to_owned(), Score::Value(psnr))].into(),
            ..record("d", scene, number)
        };
        let mut records: Vec<Record> = (0..5).map(|i| scored(0, i, 10.0 + i as f64)).collect();
        records.push(scored(1, 0, 30.0));
        test_results::results(&[MetricKey::PSNR], records)
    }

    #[test]
    fn worst_median_best_and_named() {
        let results = results();
        let board = Board::of(&results).unwrap();
        let of = |ids: &[String], (choose, count): (Choice, usize)| {
            let choice = PairsChoice {
                ids: ids.to_vec(),
                choose,
                count: NonZeroUsize::new(count).unwrap(),
            };
            chosen(&board, &board.metrics, &choice)
        };
        let ids = |ids: &[String], how| -> Vec<String> {
            let found = of(ids, how).unwrap().into_iter();
            found.map(|c| c.pair.facts.pair_id.clone()).collect()
        };
        assert_eq!(ids(&[], (Choice::Worst, 2)), ["d/0/s__0", "d/0/s__1"]);
        assert_eq!(ids(&[], (Choice::Best, 1)), ["d/1/s__0"]);
        assert_eq!(ids(&[], (Choice::Median, 1)), ["d/0/s__3"]);
        assert_eq!(ids(&[], (Choice::Median, 99)).len(), 6);
        let named = ["d/1/s__0".to_owned()];
        assert_eq!(ids(&named, (Choice::Worst, 1)), named);
        assert!(of(&["x".to_owned()], (Choice::Worst, 1)).is_err());
    }

    #[test]
    fn pairs_where_a_method_loses_most() {
        let mut records = results().records;
        let method = records[0].method.clone();
        // Better by 0, 2, 4 … dB, except for the last pair.
        let others = records.clone().into_iter().enumerate().map(|(i, record)| {
            let psnr = record.scores["psnr"].value().unwrap();
            let gain = if i == 5 { -1.0 } else { 2.0 * i as f64 };
            Record {
                method: "other".to_owned(),
                scores: [("psnr".to_owned(), Score::Value(psnr + gain))].into(),
                ..record
            }
        });
        records.extend(others.collect::<Vec<_>>());
        let results = test_results::results(&[MetricKey::PSNR], records);
        let board = Board::of(&results).unwrap();
        let lost = |choose: String| {
            let choice = PairsChoice {
                choose: choose.parse().unwrap(),
                count: NonZeroUsize::new(3).unwrap(),
                ..PairsChoice::default()
            };
            chosen(&board, &board.metrics, &choice).map(|all| {
                let ids = all.iter().map(|chosen| chosen.pair.facts.pair_id.clone());
                ids.collect::<Vec<_>>()
            })
        };
        let found = lost(format!("loses:{method}:other")).unwrap();
        assert_eq!(found, ["d/0/s__4", "d/0/s__3", "d/0/s__2"]);
        assert_eq!(lost(format!("loses:other:{method}")).unwrap(), ["d/1/s__0"]);
        assert!(lost("loses:other:other".to_owned()).is_err());
        assert!(lost("loses:other:nobody".to_owned()).is_err());
        assert!("loses:one".parse::<Choice>().is_err());
    }

    #[test]
    fn targets_of_a_source_by_growing_baseline() {
        let results = results();
        let board = Board::of(&results).unwrap();
        let path = |source: Option<&str>, count| PathChoice {
            source: source.map(str::to_owned),
            count: NonZeroUsize::new(count).unwrap(),
        };
        let targets = |source, count| -> Vec<String> {
            let found = along_path(&board, &path(source, count))
                .unwrap()
                .into_iter();
            found.map(|c| c.pair.facts.target.clone()).collect()
        };
        assert_eq!(targets(None, 9), ["4", "3", "2", "1", "0"]);
        assert_eq!(targets(None, 3), ["4", "2", "0"]);
        assert_eq!(targets(Some("d/1/s"), 3), ["0"]);
        assert!(along_path(&board, &path(Some("d/2/s"), 3)).is_err());
        let none = test_results::results(&[], Vec::new());
        let none = Board::of(&none).unwrap();
        assert!(along_path(&none, &path(None, 3)).is_err());
    }
}
