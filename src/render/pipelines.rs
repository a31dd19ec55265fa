//! A cache of pipelines.

use super::{Made, Source};

/// Capacity of the cache: the pipelines of sixteen plans that share none (a march, both relights and the store each),
/// enough to measure a curve of settings or to switch between settings. An evicted pipeline is compiled again when
/// needed.
pub(super) const MOST: usize = 64;

/// Pipelines by key, the least recently used first.
#[derive(Debug)]
pub(super) struct Pipelines<K = Source, V = Made>(Vec<(K, V)>);

impl<K, V> Default for Pipelines<K, V> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<K: PartialEq, V: Clone> Pipelines<K, V> {
    /// Returns the pipeline of `key`, which becomes the most recently used.
    pub(super) fn get(&mut self, key: &K) -> Option<V> {
        let at = self.0.iter().position(|(known, _)| known == key)?;
        self.0[at..].rotate_left(1);
        self.0.last().map(|(_, made)| made.clone())
    }

    /// Adds the pipeline `made` of `key`, unless another thread has added one in the meantime, and returns the cached
    /// one. Evicts the least recently used pipeline if the cache is full.
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
