//! Pass `scan`: exclusive prefix sums of counts, used as the start of each part of a list.

/// Clears `starts` and fills it with the start of each of the `counts`, followed by the end of the last one: one entry
/// more than there are counts.
pub(super) fn scan(counts: &[u32], starts: &mut Vec<u32>) {
    starts.clear();
    starts.reserve(counts.len() + 1);
    let mut total = 0;
    starts.push(0);
    for count in counts {
        total += count;
        starts.push(total);
    }
}

#[cfg(test)]
mod tests {
    use super::scan;

    #[test]
    fn starts_and_the_end() {
        let mut starts = vec![9];
        scan(&[3, 0, 2], &mut starts);
        assert_eq!(starts, [0, 3, 3, 5]);
        scan(&[], &mut starts);
        assert_eq!(starts, [0]);
    }
}
