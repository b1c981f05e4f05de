//! Designs that no other surpasses.

/// Which of some losses are on the front: no other is as little in all and less in one. Those that are equal are all on it, or none
/// is.
#[must_use]
pub fn flag_losses_on_pareto_front(losses: &[Vec<f64>]) -> Vec<bool> {
    let mut order: Vec<usize> = (0..losses.len()).collect();
    let compare = |a: &[f64], b: &[f64]| {
        let each = a.iter().zip(b).map(|(a, b)| a.total_cmp(b));
        each.into_iter().find(|order| order.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
    };
    order.sort_by(|a, b| compare(&losses[*a], &losses[*b]));
    // In this order nothing surpasses what comes before it.
    let mut is_on = vec![false; losses.len()];
    let mut found: Vec<usize> = Vec::new();
    for own in order {
        if found.iter().all(|other| !dominates(&losses[*other], &losses[own])) {
            found.push(own);
            is_on[own] = true;
        }
    }
    is_on
}

/// Whether one is as little in all losses and less in one.
fn dominates(one: &[f64], other: &[f64]) -> bool {
    one.iter().zip(other).all(|(a, b)| a <= b) && one.iter().zip(other).any(|(a, b)| a < b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use era_model::scene::random::RandomSequence;

    /// The definition, one against all.
    fn by_definition(losses: &[Vec<f64>]) -> Vec<bool> {
        let mut is_on = Vec::new();
        for own in losses {
            let mut beaten = false;
            for other in losses {
                let (mut no_worse, mut better) = (true, false);
                for k in 0..own.len() {
                    if other[k] > own[k] {
                        no_worse = false;
                    }
                    if other[k] < own[k] {
                        better = true;
                    }
                }
                beaten |= no_worse && better;
            }
            is_on.push(!beaten);
        }
        is_on
    }

    #[test]
    fn the_front_is_that_of_its_definition() {
        let mut random = RandomSequence::new(11, 0);
        for case in 0..200 {
            let (count, wishes) = (1 + random.next_below(60) as usize, 1 + random.next_below(4) as usize);
            // Few values, so that some are equal.
            let of = if case % 2 == 0 { 5 } else { 1_000_000 };
            let losses: Vec<Vec<f64>> =
                (0..count).map(|_| (0..wishes).map(|_| f64::from(random.next_below(of))).collect()).collect();
            assert_eq!(flag_losses_on_pareto_front(&losses), by_definition(&losses), "{losses:?}");
        }
        assert!(flag_losses_on_pareto_front(&[]).is_empty());
    }
}
