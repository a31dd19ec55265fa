//! Pipelines that are kept for the next frame that needs them, but not all of them for ever.

use super::{Made, Source};

/// Pipelines that are kept: as many as sixteen plans have that share none (a march, both relights and the store each), as a curve of
/// settings is measured with or a person goes back and forth between. One that is gone is compiled again where it is asked for.
pub(super) const MOST: usize = 64;

/// Pipelines by what tells them apart, the least recently used first.
#[derive(Debug)]
pub(super) struct Pipelines<K = Source, V = Made>(Vec<(K, V)>);

impl<K, V> Default for Pipelines<K, V> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<K: PartialEq, V: Clone> Pipelines<K, V> {
    /// The one for `key`, which is now the last that was used.
    pub(super) fn get(&mut self, key: &K) -> Option<V> {
        let at = self.0.iter().position(|(known, _)| known == key)?;
        self.0[at..].rotate_left(1);
        self.0.last().map(|(_, made)| made.clone())
    }

    /// Keeps what was `made` for `key`, or what somebody else has made in the meantime, and lets go of the one that was not used
    /// for longest where there are too many.
    pub(super) fn keep(&mut self, key: K, made: V) -> V {
        if let Some(known) = self.get(&key) {
            return known;
        }
        if self.0.len() >= MOST {
            self.0.remove(0);
        }
        self.0.push((key, made.clone()));
        made
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_used_for_longest_is_let_go() {
        let mut kept = Pipelines::<usize, usize>::default();
        for key in 0..MOST {
            assert_eq!((kept.get(&key), kept.keep(key, 10 * key)), (None, 10 * key));
        }
        assert_eq!(kept.get(&0), Some(0), "the first is used again");
        assert_eq!(kept.keep(MOST, 7), 7);
        assert_eq!((kept.get(&0), kept.get(&1), kept.get(&2)), (Some(0), None, Some(20)), "the second makes room");
        assert_eq!(kept.keep(MOST, 8), 7, "what somebody else has made already");
        for key in MOST..100 * MOST {
            kept.keep(key, key);
        }
        assert_eq!(kept.0.len(), MOST);
    }
}
