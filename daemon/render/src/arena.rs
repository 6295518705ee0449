//! Which ranges of a buffer are free: places for blocks, in elements.

use std::collections::BTreeMap;

/// Hands out ranges of `0..capacity`, the lowest that fits first.
#[derive(Clone, Debug)]
pub(crate) struct Arena {
    capacity: u64,
    /// First element of each free range and its length; no two touch.
    free: BTreeMap<u64, u64>,
}

impl Arena {
    /// All of it free.
    pub(crate) fn new(capacity: u64) -> Self {
        let free = if capacity > 0 { [(0, capacity)].into() } else { BTreeMap::new() };
        Self { capacity, free }
    }

    /// How many elements there are.
    pub(crate) fn capacity(&self) -> u64 {
        self.capacity
    }

    /// A place for `count` elements, or `None` where no free range is as long. Nothing lies at 0.
    pub(crate) fn place(&mut self, count: u64) -> Option<u64> {
        if count == 0 {
            return Some(0);
        }
        let (first, length) = self.free.iter().find(|(_, length)| **length >= count).map(|(f, l)| (*f, *l))?;
        self.free.remove(&first);
        if length > count {
            self.free.insert(first + count, length - count);
        }
        Some(first)
    }

    /// Takes back a range that [`Arena::place`] gave.
    pub(crate) fn release(&mut self, first: u64, count: u64) {
        if count == 0 {
            return;
        }
        let (mut from, mut until) = (first, first + count);
        if let Some((before, length)) = self.free.range(..first).next_back().map(|(f, l)| (*f, *l))
            && before + length == first
        {
            self.free.remove(&before);
            from = before;
        }
        if let Some(length) = self.free.remove(&until) {
            until += length;
        }
        self.free.insert(from, until - from);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_given_back_is_one_piece_again() {
        let mut arena = Arena::new(100);
        let places: Vec<_> = [30, 30, 40].map(|n| arena.place(n).unwrap()).into();
        assert_eq!((places.as_slice(), arena.place(1), arena.place(0)), ([0, 30, 60].as_slice(), None, Some(0)));
        arena.release(0, 30);
        arena.release(60, 40);
        assert_eq!(arena.place(41), None, "70 are free, in two pieces");
        arena.release(30, 30);
        assert_eq!(arena.place(100), Some(0));
    }

    /// Against a map of every element, over a random walk.
    #[test]
    fn no_element_is_given_twice_or_lost() {
        let mut arena = Arena::new(200);
        let (mut taken, mut held, mut seed) = ([false; 200], Vec::<(u64, u64)>::new(), 1u64);
        for _ in 0..5000 {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let random = seed >> 33;
            if random.is_multiple_of(2) || held.is_empty() {
                let count = 1 + random / 2 % 40;
                let longest = taken.split(|t| *t).map(<[bool]>::len).max().unwrap_or(0) as u64;
                let place = arena.place(count);
                assert_eq!(place.is_some(), count <= longest);
                if let Some(first) = place {
                    let range = &mut taken[first as usize..(first + count) as usize];
                    assert!(range.iter().all(|t| !t));
                    range.fill(true);
                    held.push((first, count));
                }
            } else {
                let (first, count) = held.swap_remove(random as usize / 2 % held.len());
                taken[first as usize..(first + count) as usize].fill(false);
                arena.release(first, count);
            }
        }
    }
}
