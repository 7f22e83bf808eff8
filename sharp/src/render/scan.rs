//! Pass `scan`: exclusive prefix sums of the lengths of a list's parts, i.e. where each part starts.

/// Overwrites `starts` with the start of each part, given the lengths `counts`, followed by the end of the last part.
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
