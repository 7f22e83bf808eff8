//! Detection of views whose focal length, depth or pose unit differs from the other views' by a
//! common factor.

use std::collections::BTreeMap;

use super::advice::{evidence, number};
use super::change::{Change, Focal};
use super::compare::{MIN_GAIN_OF_VIEWS, forward, landed, mean_loss};
use super::explained::{Explained, Reading};
use super::neighbours::Neighbours;
use super::search::{is_reportable, least};

/// A quantity that may differ by a factor: its name; the number of factors tried in each direction and the ratio
/// between consecutive ones; and the interpretation for given factors of two views, the projected one first.
type Quantity = (&'static str, (i32, f64), fn([f64; 2]) -> Reading);

const DEPTH: &str = "depth";
const TRANSLATION: &str = "translation";

const QUANTITIES: [Quantity; 3] = [
    ("focal length", (10, 1.08), |factors| Reading {
        focal: factors.map(|factor| Focal::Both.times(factor)),
        ..Reading::AS_READ
    }),
    (DEPTH, (10, 1.08), |factors| Reading {
        depth_times: factors,
        ..Reading::AS_READ
    }),
    (TRANSLATION, (30, 1.2589), |factors| Reading {
        pose_times: factors,
        ..Reading::AS_READ
    }),
];

/// Applying a factor to some views is equivalent to applying its inverse to all others. A message
/// names a correction of the others as an alternative if it leaves at most this multiple of the
/// least loss.
const MAX_LOSS_OF_ALTERNATIVE: f64 = 1.1;
/// Samples per view in the search for a factor.
const SAMPLES: usize = 400;

/// Statistics of the projections, with the factor applied to neither of the two views, to the first, to the second,
/// and to both.
type Choices<'a> = [&'a [Explained]; 4];

impl Neighbours<'_> {
    /// For each quantity, the factor that explains the views best and the views to which it
    /// applies, with the statistics of the projections after the change.
    pub(super) fn some_views(&self) -> Vec<(Change, Vec<Explained>)> {
        let found = QUANTITIES
            .iter()
            .filter_map(|quantity| self.factor(quantity));
        found.collect()
    }

    /// The factor of a quantity that explains the views best.
    fn factor(&self, quantity: &Quantity) -> Option<(Change, Vec<Explained>)> {
        let (what, (steps, step), with) = quantity;
        let rough = self.stride_of(SAMPLES);
        let as_read = [rough, self.stride].map(|at| self.explained(&Reading::AS_READ, at));
        let least_landed = 3 * landed(&as_read[0]) / 10;
        let chosen = |factor: f64, as_read: &[Explained], stride: usize| {
            let factors = [[factor, 1.0], [1.0, factor], [factor, factor]];
            let [first, second, both] =
                factors.map(|factors| self.explained(&with(factors), stride));
            self.best_choice([as_read, &first, &second, &both])
        };
        let factor = least(*steps, *step, &|factor, _| {
            let (_, explained) = chosen(factor, &as_read[0], rough);
            if landed(&explained) < least_landed {
                1.0
            } else {
                mean_loss(&explained)
            }
        });
        let (views, explained) = chosen(factor, &as_read[1], self.stride);
        if !is_reportable(factor) || views.is_empty() {
            return None;
        }
        let (others, otherwise) = chosen(1.0 / factor, &as_read[1], self.stride);
        let is_open = mean_loss(&otherwise) <= MAX_LOSS_OF_ALTERNATIVE * mean_loss(&explained);
        let is_gain = mean_loss(&explained) <= (1.0 - MIN_GAIN_OF_VIEWS) * mean_loss(&as_read[1]);
        if is_open
            && is_gain
            && let Some(wider) = self.wider()
            && let Some((change, explained)) = wider.factor(quantity)
        {
            let own = wider.carries.iter().zip(explained);
            let own = own.filter(|(carry, _)| self.carries.contains(carry));
            return Some((change, own.map(|(_, one)| one).collect()));
        }
        let ids = |views: &[usize]| -> String {
            let ids: Vec<&str> = views.iter().map(|i| self.views[*i].id.as_str()).collect();
            ids.join(", ")
        };
        let its = if views.len() == 1 { "its" } else { "their" };
        let said = evidence(&forward(&as_read[1]), &forward(&explained));
        let [times, inverse] = [factor, 1.0 / factor].map(number);
        // If no projection connects views with the factor to views without it, a factor of depth is
        // equivalent to the inverse factor of poses.
        let has = |view: &usize| views.contains(view);
        let or = match self.carries.iter().all(|(a, b)| has(a) == has(b)) {
            true if *what == DEPTH => format!(", or {its} {TRANSLATION} by {inverse}"),
            false if is_open => format!(", or that of {} by {inverse}", ids(&others)),
            _ => String::new(),
        };
        let ids = ids(&views);
        let sentence = format!("{ids}: {its} {what} should be multiplied by {times}{or} ({said})");
        Some((Change::Views(sentence), explained))
    }

    /// These views and those around them, with every pair of neighbours. `None` in a thorough check, or if there are no
    /// views around them.
    fn wider(&self) -> Option<Self> {
        let around = self.around.iter().filter(|(_, view)| view.has_depth());
        let around = around.map(|(i, view)| (*i, (view.clone(), view.samples().collect())));
        let mut small = self.small.clone();
        small.extend(around);
        let pairs = small.keys().filter(|i| small.contains_key(&(*i + 1)));
        let carries: Vec<_> = pairs.flat_map(|i| [(*i, i + 1), (i + 1, *i)]).collect();
        (!self.thorough && small.len() > self.small.len()).then_some(Self {
            small,
            carries,
            around: BTreeMap::new(),
            ..*self
        })
    }

    /// Chooses the views to apply the factor to: the set of at least one and at most half of the views with the smallest
    /// mean loss. Returns it with the statistics of the projections.
    fn best_choice(&self, choices: Choices<'_>) -> (Vec<usize>, Vec<Explained>) {
        let views: Vec<usize> = self.small.keys().copied().collect();
        let all = 1..1_u32 << views.len();
        let few = all.filter(|set| 2 * set.count_ones() as usize <= views.len());
        let explained = few.map(|set| {
            let has = |view: &usize| {
                let at = views.iter().position(|i| i == view);
                usize::from(at.is_some_and(|at| set & 1 << at != 0))
            };
            let carries = self.carries.iter().enumerate();
            let carries = carries.map(|(i, (a, b))| choices[has(a) + 2 * has(b)][i]);
            (set, carries.collect::<Vec<_>>())
        });
        let best = explained.min_by(|(_, a), (_, b)| mean_loss(a).total_cmp(&mean_loss(b)));
        let Some((set, explained)) = best else {
            return (Vec::new(), choices[0].to_vec());
        };
        let has = |(at, view): (usize, &usize)| (set & 1 << at != 0).then_some(*view);
        (
            views.iter().enumerate().filter_map(has).collect(),
            explained,
        )
    }
}
