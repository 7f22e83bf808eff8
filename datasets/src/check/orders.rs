//! Other assignments of pictures to poses.

use std::collections::BTreeSet;

use super::{Effort, evenly_spaced};
use crate::View;

/// Of fewer views any assignment to poses may fit.
const LEAST_VIEWS: usize = 5;

/// Which view's pose a picture has, if any.
pub(super) type PoseOf = Box<dyn Fn(usize) -> Option<usize>>;

/// The first views of the pairs of neighbours that are looked at.
pub(super) fn neighbours(views: usize, effort: Effort) -> impl Iterator<Item = usize> {
    evenly_spaced(views.saturating_sub(1), effort.pairs).into_iter()
}

/// Assignments that come of mistakes, in words: shifts from one of some views on, the reverse order, and the order of spelling
/// for that of numbers.
pub(super) fn orders(views: &[View], mut starts: BTreeSet<usize>) -> Vec<(String, PoseOf)> {
    let n = views.len();
    if n < LEAST_VIEWS {
        return Vec::new();
    }
    let shifted = |by: i64, from: usize| {
        move |i: usize| match i < from {
            true => Some(i),
            false => usize::try_from(i as i64 + by).ok(),
        }
    };
    let id = |i: usize| &views[i].id;
    let mut orders: Vec<(String, PoseOf)> = Vec::new();
    starts.insert(0);
    for by in [-2_i64, -1, 1, 2] {
        let places = if by.abs() == 1 { "" } else { "two places " };
        let side = if by < 0 { "before" } else { "after" };
        for &from in &starts {
            let which = match from {
                0 => "every picture fits".to_owned(),
                from => format!("from about {} on every picture fits", id(from)),
            };
            let text = format!("{which} the pose {places}{side} its own");
            orders.push((text, Box::new(shifted(by, from))));
        }
    }
    let backwards = "the pictures fit the poses in reverse order".to_owned();
    orders.push((backwards, Box::new(move |i| Some(n - 1 - i))));
    let mut spelt: Vec<usize> = (0..n).collect();
    spelt.sort_by(|a, b| id(*a).cmp(id(*b)));
    if spelt.iter().enumerate().any(|(i, j)| i != *j) {
        let mut rank = vec![0; n];
        spelt.iter().enumerate().for_each(|(i, j)| rank[*j] = i);
        let text = "the pictures in the order of their numbers fit the poses in the order of their spelling";
        orders.push((text.to_owned(), Box::new(move |i| spelt.get(i).copied())));
        let text = "the pictures in the order of their spelling fit the poses in the order of their numbers";
        orders.push((text.to_owned(), Box::new(move |i| rank.get(i).copied())));
    }
    orders
}
