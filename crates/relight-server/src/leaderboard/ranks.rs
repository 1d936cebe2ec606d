//! Ranks, where those who are equal share the mean of their places.

/// The rank of each score: 1 is the highest. `None` is an infinite one, higher than all. Ties share the mean of the ranks that they
/// take up (fractional ranking), so the ranks of n scores always add up to n(n+1)/2.
pub(super) fn ranks(scores: &[Option<f64>]) -> Vec<f64> {
    let height = |index: usize| scores[index].unwrap_or(f64::INFINITY);
    let mut order: Vec<usize> = (0..scores.len()).collect();
    order.sort_by(|&a, &b| height(b).total_cmp(&height(a)));
    let mut ranks = vec![0.0; scores.len()];
    let mut start = 0;
    for tied in order.chunk_by(|&a, &b| height(a) == height(b)) {
        let rank = start as f64 + (tied.len() as f64 + 1.0) / 2.0;
        tied.iter().for_each(|&index| ranks[index] = rank);
        start += tied.len();
    }
    ranks
}
