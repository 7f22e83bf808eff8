//! Other assignments of pictures to poses.

use std::collections::BTreeSet;

use super::{Effort, evenly_spaced};
use crate::View;

/// Fewest views: with fewer, any assignment to poses may fit.
const LEAST_VIEWS: usize = 5;

/// Fewest pairs of neighbours that a shift from a later picture on has to explain better; one may have one wrong pose.
const LEAST_SHIFTED: usize = 2;

/// The view, if any, from which each view takes something.
pub(super) type Assignment = Box<dyn Fn(usize) -> Option<usize>>;

/// The first views of the pairs of neighbours that are looked at.
pub(super) fn neighbours(views: usize, effort: Effort) -> impl Iterator<Item = usize> {
    evenly_spaced(views.saturating_sub(1), effort.pairs).into_iter()
}

/// Assignments that result from mistakes, in words: shifts from one of some views on, reverse order, spelling order in
/// place of numeric order, and exchanges of two. `noun` is what is assigned to the pictures. With each,
/// the fewest pairs of neighbours that it has to explain better.
pub(super) fn orders(
    views: &[View],
    starts: &BTreeSet<usize>,
    exchanged: &[(usize, usize)],
    noun: &str,
) -> Vec<(String, Assignment, usize)> {
    let n = views.len();
    let shifted = |by: i64, from: usize| {
        move |i: usize| match i < from {
            true => Some(i),
            false => usize::try_from(i as i64 + by).ok(),
        }
    };
    let id = |i: usize| &views[i].id;
    let mut orders: Vec<(String, Assignment, usize)> = Vec::new();
    for &(a, b) in exchanged {
        let text = format!(
            "{} fits the {noun} of {}, and the other way round",
            id(a),
            id(b)
        );
        let exchange = move |i: usize| match i {
            i if i == a => Some(b),
            i if i == b => Some(a),
            i => Some(i),
        };
        orders.push((text, Box::new(exchange), 1));
    }
    if n < LEAST_VIEWS {
        return orders;
    }
    let starts: BTreeSet<usize> = starts.iter().copied().chain([0]).collect();
    for by in [-2_i64, -1, 1, 2] {
        let places = if by.abs() == 1 { "" } else { "two places " };
        let side = if by < 0 { "before" } else { "after" };
        for &from in &starts {
            let which = match from {
                0 => "every picture fits".to_owned(),
                from => format!("from about {} on every picture fits", id(from)),
            };
            let text = format!("{which} the {noun} {places}{side} its own");
            let pairs = if from == 0 { 1 } else { LEAST_SHIFTED };
            orders.push((text, Box::new(shifted(by, from)), pairs));
        }
    }
    let backwards = format!("the pictures fit the {noun}s in reverse order");
    orders.push((backwards, Box::new(move |i| Some(n - 1 - i)), 1));
    let mut spelt: Vec<usize> = (0..n).collect();
    spelt.sort_by(|a, b| id(*a).cmp(id(*b)));
    if spelt.iter().enumerate().any(|(i, j)| i != *j) {
        let mut rank = vec![0; n];
        spelt.iter().enumerate().for_each(|(i, j)| rank[*j] = i);
        let text = |pictures: &str, others: &str| {
            format!(
                "the pictures in the order of their {pictures} fit the {noun}s in the order of their {others}"
            )
        };
        let to_spelling = text("numbers", "spelling");
        orders.push((to_spelling, Box::new(move |i| spelt.get(i).copied()), 1));
        let to_numbers = text("spelling", "numbers");
        orders.push((to_numbers, Box::new(move |i| rank.get(i).copied()), 1));
    }
    orders
}
