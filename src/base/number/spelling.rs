//! Distance between the spellings of two names.

/// Edit distance from `a` to `b`: 2 per inserted, deleted or replaced letter, 1 per swap of neighbours.
#[must_use]
pub fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut before_last: Vec<usize> = Vec::new();
    let mut last: Vec<usize> = (0..=b.len()).map(|column| 2 * column).collect();
    let mut previous = None;
    for letter in a.chars() {
        let mut current = vec![last[0] + 2];
        for (column, &other) in b.iter().enumerate() {
            let kept = if letter == other { last[column] } else { last[column] + 2 };
            let mut least = kept.min(last[column + 1] + 2).min(current[column] + 2);
            if column > 0 && previous == Some(other) && b[column - 1] == letter {
                least = least.min(before_last[column - 1] + 1);
            }
            current.push(least);
        }
        before_last = std::mem::replace(&mut last, current);
        previous = Some(letter);
    }
    last[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swap_costs_less_than_another_letter() {
        assert_eq!(edit_distance("d56", "d65"), 1);
        assert_eq!(edit_distance("d56", "d50"), 2);
        assert_eq!(edit_distance("fl1", "fl11"), 2);
        assert_eq!(edit_distance("", "abc"), 6);
        assert_eq!(edit_distance("kitten", "sitting"), 6);
    }
}
